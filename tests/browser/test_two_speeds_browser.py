"""Two speeds and a notch as a user meets them: offered by the verdict, seen, set, saved, and undone."""

from __future__ import annotations

import numpy as np
from tests.browser.screen import FIND

from kalscope import FilterParams, estimate, kalman_filter
from kalscope.estimation.request import Request, find_parameters
from kalscope.filtering.classic import ChainFilter
from kalscope_app.views.goal import MORE_FOLDER


def test_two_speeds_are_added_from_the_verdict_seen_dragged_and_undone(start, tmp_path):
    rng = np.random.default_rng(3)
    x = np.cumsum((rng.random(900) < 0.01) * rng.normal(0.0, 15.0, 900))
    z = np.round(x + rng.normal(size=900), 4)
    log = tmp_path / "steps.csv"
    log.write_text("t_s,level\n" + "".join(f"{i / 100:.2f},{one}\n" for i, one in enumerate(z.tolist())))
    screen = start(str(log))
    screen.page.get_by_role("button", name="no filter needed").click()
    screen.page.get_by_role("button", name="Add two speeds").click()
    params = estimate(z, two_speeds=True).params
    expected = kalman_filter(z, params)
    screen.wait_for_line("filtered", expected.x, 1e-9)
    screen.wait_for_line("probability of moving", expected.moving, 1e-9)
    screen.page.get_by_text("Two speeds explain this record clearly better than one.").first.wait_for()
    screen.shot("two-speeds")
    screen.page.get_by_role("button", name=MORE_FOLDER).click()
    screen.type("fast factor", "1000")
    slower = FilterParams(params.q, params.r, fast=1000.0, spikes=params.spikes)
    screen.wait_for_line("filtered", kalman_filter(z, slower).x, 1e-9)
    screen.page.get_by_role("slider", name="log₁₀ fast").focus()
    screen.page.keyboard.press("Home")
    screen.wait_for_line("filtered", kalman_filter(z, FilterParams(params.q, params.r)).x, 1e-9)
    screen.wait(f"() => !({FIND})('probability of moving')")
    for _ in range(3):
        screen.page.get_by_role("button", name="Undo", exact=True).click()
    screen.page.get_by_role("button", name="no filter needed").wait_for()


def test_a_notch_is_added_from_the_verdict_and_undone(start, tmp_path):
    rng = np.random.default_rng(1)
    t = np.arange(1500) / 200
    hum = 2.0 * np.sin(2.0 * np.pi * 50.0 * t)
    z = np.round(20.0 + np.cumsum(0.1 * rng.normal(size=1500)) + rng.normal(size=1500) + hum, 4)
    log = tmp_path / "hum.csv"
    log.write_text("t_s,flex\n" + "".join(f"{i:.3f},{one}\n" for i, one in zip(t, z.tolist(), strict=True)))
    screen = start(str(log))
    screen.page.get_by_role("button", name="model misfit").click()
    screen.page.get_by_text("hum at 50.0 Hz").wait_for()
    screen.page.get_by_role("button", name="Add a notch").click()
    found = find_parameters(z, Request(notch="auto"))
    expected = ChainFilter(found.chain, found.params).denoise(z)
    screen.wait_for_line("filtered", expected, 1e-9)
    screen.shot("notch")
    screen.page.get_by_role("button", name="Undo", exact=True).click()
    screen.page.get_by_role("button", name="model misfit").wait_for()
