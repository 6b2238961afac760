"""The verdict as a user meets it: a headline, a button that does what it advises, Undo; the spikes in the chart."""

from __future__ import annotations

import numpy as np
from tests.browser.screen import FIND
from tests.support.waiting import wait_until

from kalscope import FilterParams, estimate, kalman_filter, open_source
from kalscope.estimation.request import starting_params
from kalscope_app.views.goal import MORE_FOLDER

SPIKY = "synthetic:random_walk?n=3000&sample_period=0.01&sigma=0.2&outliers=0.01&outlier_size=4"


def test_advice_is_taken_by_its_button_and_spikes_are_marked(start):
    z = open_source(SPIKY).values[:, 0]
    first, best = starting_params(z), estimate(z)
    screen = start(SPIKY)
    screen.page.get_by_role("button", name=MORE_FOLDER).click()
    screen.type("outlier gate", "off")  # it opens with one
    screen.page.get_by_role("button", name="spikes").click()  # the verdict; the reasons stay open
    spikes = screen.page.get_by_text("The record has spikes: single readings far from those around them.").first
    spikes.wait_for()
    screen.page.get_by_role("button", name="Switch the gate on (4 σ)").click()
    spikes.wait_for(state="detached")  # after it the sentence is another one
    screen.wait_for_value("outlier gate", "4")
    screen.wait_for_line("filtered", kalman_filter(z, FilterParams(first.q, first.r, gate=16.0)).x, 1e-9)
    screen.page.get_by_role("button", name="Undo").click()
    spikes.wait_for()
    screen.wait_for_value("outlier gate", "off")

    screen.choose("goal", "best fit")
    screen.page.get_by_role("button", name="Apply", exact=True).click()
    aside = f"set aside ({best.outliers.sum()})"
    screen.wait(f"(name) => ({FIND})(name)", aside)
    assert np.array_equal(np.isfinite(screen.line(aside)[1]), best.outliers)
    screen.wait_for_line("filtered", kalman_filter(z, best.params).x, 1e-9)
    wait_until(lambda: screen.text_box("outlier gate").input_value() == "4", "the gate of the fit")
    screen.page.get_by_text(f"{best.outliers.sum()} of 3\u202f000 samples are spikes").wait_for()
    screen.page.get_by_text("The filter fits").first.wait_for()
    screen.shot("advice")
    screen.page.get_by_role("button", name="Undo").click()
    screen.wait(f"(name) => !({FIND})(name)", aside)
