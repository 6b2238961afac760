"""A fleet as a user opens it: the table, a device by name, a device by a click in the map."""

from __future__ import annotations

import re

import numpy as np
import pytest
from tests.support.fleet_folder import NOISY, finished_fleet
from tests.support.required import not_here
from tests.support.waiting import wait_until

from kalscope.fleet.results import read_fleet, reopen
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.session.changes import at_device, open_fleet
from kalscope_app.session.opening import opened
from kalscope_app.studies.tuning_map import compute_map

try:
    import pyarrow  # noqa: F401
except ImportError:
    not_here("pyarrow is not installed")

pytestmark = pytest.mark.browser


@pytest.fixture
def screen(start):
    """The page where a fleet is opened."""
    page = start("demo")
    page.tab("Source")
    return page


def wait_for_values(screen, expected):
    """Until the tab Tune shows this pair of q and r; the tab Source is open before and after."""
    screen.tab("Tune")
    wait_until(lambda: values(screen) == pytest.approx(expected, rel=1e-6), f"q and r of {expected}")
    screen.tab("Source")


def values(screen):
    return [float(screen.text_box(name).input_value()) for name in ("process noise q", "measurement noise r")]


def mark(page):
    """Where the mark of the present values is, in shares of the map; it moves with the map too."""
    style = page.locator(".kalscope-mark").evaluate("({style}) => [style.left, style.top]")
    return [float(length.removesuffix("%") or -100) / 100 for length in style]


def share_of(frame, pair):
    """Where a pair of q and r is on a map, in shares of it."""
    x, y = frame.pixel(tuple(np.log10(pair)))
    return [x / frame.width, y / frame.height]


def test_a_fleet_is_listed_and_its_devices_open_from_the_table_and_the_map(screen, tmp_path):
    folder = finished_fleet(tmp_path)
    fleet = read_fleet(folder)
    page = screen.page
    assert page.get_by_text("sort by").count() == 0
    screen.type("path", str(folder))
    page.get_by_text(re.compile(r"13 rows: 12 with q and r, 1 failed")).wait_for()
    assert "dev03.csv" in page.locator("table", has_text="device").locator("tr").nth(1).inner_text()
    for name, first in ("CSV", b'"id","channel"'), ("page", b"<!doctype html>"):
        content = screen.download(f"Download {name}")
        assert content.startswith(first)
        assert all(f"dev{i:02d}.csv".encode() in content for i in range(12))
    assert b"13 rows: 12 with q and r, 1 failed" in content
    sheet = page.locator(".kalscope-map > div")
    sheet.wait_for()
    screen.shot("fleet-open")

    screen.type("find device", "DEV03")
    page.locator("table", has_text="device").locator("tr").nth(2).wait_for(state="detached")
    screen.choose("open device", "1. dev03.csv")
    own = [fleet.devices.q[NOISY], fleet.devices.r[NOISY]]
    wait_for_values(screen, own)

    state = open_fleet(fleet)(opened(reopen(fleet.devices.ids[NOISY], fleet.devices.sources[NOISY], fleet.note)))
    state = at_device(fleet, NOISY)(state)
    shown = compute_map(state, Cache())
    frame = shown.frame
    wait_until(lambda: mark(page) == pytest.approx(share_of(frame, own), abs=1e-4), "the map of this device")
    far = max((i for i in range(12) if i != NOISY), key=lambda i: abs(np.log(fleet.devices.q[i] / 0.04)))
    at = frame.pixel((np.log10(fleet.devices.q[far]), np.log10(fleet.devices.r[far])))
    picked = shown.fleet.nearest(frame, at)
    box = sheet.bounding_box()
    place = box["x"] + box["width"] * at[0] / frame.width, box["y"] + box["height"] * at[1] / frame.height
    page.mouse.click(*place)
    page.get_by_text(fleet.devices.ids[picked]).locator("visible=true").first.wait_for()
    wait_for_values(screen, [fleet.devices.q[picked], fleet.devices.r[picked]])
    screen.shot("fleet-device-from-map")

    page.get_by_role("button", name="Close fleet").click()
    page.get_by_text("sort by").wait_for(state="detached")


def test_a_folder_of_something_else_is_refused_in_one_sentence(screen, tmp_path):
    screen.type("path", str(tmp_path))
    screen.notification("must be the folder of a finished fleet").wait_for()
    assert screen.page.get_by_text("sort by").count() == 0
