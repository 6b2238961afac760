"""A fleet as a user opens it: the table, a device by name, a device by a click in the map."""

from __future__ import annotations

import re

import numpy as np
import pytest
from tests.support.fleet_folder import NOISY, finished_fleet
from tests.support.required import needs
from tests.support.waiting import wait_until

from kalscope.fleet.results import read_fleet, reopen
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.session.changes import at_device, open_fleet
from kalscope_app.session.opening import opened
from kalscope_app.studies.tuning_map import compute_map

needs("pyarrow")
pytestmark = pytest.mark.browser


def wait_for_values(screen, expected):
    """Until the tab Tune shows this pair of q and r; the tab Source is open before and after."""
    screen.tab("Tune")
    wait_until(lambda: screen.q_and_r() == pytest.approx(expected, rel=1e-6), f"q and r of {expected}")
    screen.tab("Source")


def mark(page):
    """Where the mark of the present values is, in shares of the map; it moves with the map too."""
    style = page.locator(".kalscope-mark").evaluate("({style}) => [style.left, style.top]")
    return [float(length.removesuffix("%") or -100) / 100 for length in style]


def test_a_fleet_is_listed_and_its_devices_open_from_the_table_and_the_map(start, tmp_path):
    screen = start("demo")
    page = screen.page
    screen.tab("Source")
    assert page.get_by_text("sort by").count() == 0
    screen.type("path", str(tmp_path))
    screen.wait_for_notice("must be the folder of a finished fleet")

    folder = finished_fleet(tmp_path)
    fleet = read_fleet(folder)
    screen.type("path", str(folder))
    page.get_by_text(re.compile(r"13 rows: 12 with q and r, 1 failed")).wait_for()
    page.locator("table", has_text="device").locator("tr").nth(1).get_by_text("dev03.csv").wait_for()
    content = screen.download("Download page")
    assert content.startswith(b"<!doctype html>")
    assert b"13 rows: 12 with q and r, 1 failed" in content
    sheet = page.locator(".kalscope-map > div")
    sheet.wait_for()

    screen.type("find device", "DEV03")
    page.locator("table", has_text="device").locator("tr").nth(2).wait_for(state="detached")
    screen.choose("open device", "1. dev03.csv")
    q, r = fleet.devices.q, fleet.devices.r
    wait_for_values(screen, [q[NOISY], r[NOISY]])

    state = open_fleet(fleet)(opened(reopen(fleet.devices.ids[NOISY], fleet.devices.sources[NOISY], fleet.note)))
    shown = compute_map(at_device(fleet, NOISY)(state), Cache())
    frame = shown.frame

    def share_of(device):
        """Where a device is on the map, in shares of it."""
        x, y = frame.pixel((np.log10(q[device]), np.log10(r[device])))
        return [x / frame.width, y / frame.height]

    wait_until(lambda: mark(page) == pytest.approx(share_of(NOISY), abs=1e-4), "the map of this device")
    far = max((i for i in range(12) if i != NOISY), key=lambda i: abs(np.log(q[i] / 0.04)))
    x, y = share_of(far)
    picked = shown.fleet.nearest(frame, (x * frame.width, y * frame.height))
    box = sheet.bounding_box()
    page.mouse.click(box["x"] + box["width"] * x, box["y"] + box["height"] * y)
    page.get_by_text(fleet.devices.ids[picked]).locator("visible=true").first.wait_for()
    wait_for_values(screen, [q[picked], r[picked]])
    screen.press("Close fleet")
    page.get_by_text("sort by").wait_for(state="detached")
