"""Sensors of one quantity as a user fuses them: ticked, one dropped out, tuned, saved, and loaded again."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from kalscope import estimate_fusion, fuse, load_tuning, open_source
from kalscope_app.views.goal import MORE_FOLDER

SOURCE = "synthetic:sine?n=400&sigmas=0.1,0.2,0.4&offsets=0,0.3,-0.2&drop_outs=0.02"


def tick(screen, name):
    screen.pause()
    screen.page.get_by_label(re.compile(f"^{name}(: share .*)?$")).click()


def press(screen, name):
    """By the keyboard: what is written above a button may move it away from the mouse."""
    screen.pause()
    screen.page.get_by_role("button", name=name, exact=True).press("Enter")


def wait_for_share(screen, name, share):
    screen.page.get_by_label(f"{name}: share {share}", exact=True).wait_for()


def test_sensors_are_fused_one_drops_out_and_the_file_brings_them_back(start, tmp_path):
    z = open_source(SOURCE).values
    found = estimate_fusion(z, names=("a", "b", "c")).params
    screen = start(SOURCE)
    screen.page.get_by_role("button", name=MORE_FOLDER).click()
    screen.page.get_by_text("Fuse sensors", exact=True).click()
    for name in ("a", "b", "c"):
        tick(screen, name)
    press(screen, "Fuse")
    screen.wait_for_line("fused", fuse(z, found).x, 1e-9)
    screen.wait_for_value("channel", "fused")
    assert screen.text_box("measurement noise r").count() == 0
    assert np.array_equal(screen.line("b")[1], z[:, 1], equal_nan=True)
    screen.shot("fusion")

    tick(screen, "c")
    two = found.only([0, 1])
    screen.wait_for_line("fused", fuse(z[:, :2], two).x, 1e-9)
    wait_for_share(screen, "a", f"{100 * two.shares[0]:.0f} %")
    screen.type("process noise q", "0.001")
    tuned = fuse(z[:, :2], replace(two, q=0.001)).x
    screen.wait_for_line("fused", tuned, 1e-9)
    screen.tab("Export")
    screen.download("Download tuning file", tmp_path / "tuning.toml")
    saved = load_tuning(tmp_path / "tuning.toml").fusion
    assert (saved.sensors, saved.q) == (("a", "b"), 0.001)
    np.testing.assert_allclose(fuse(z[:, :2], saved.params).x, tuned, rtol=0, atol=1e-9)

    screen.tab("Tune")
    press(screen, "Stop fusing")
    screen.text_box("measurement noise r").wait_for()
    screen.tab("Source")
    screen.upload("Upload a file", tmp_path / "tuning.toml")
    screen.wait_for_line("fused", tuned, 1e-9)
    screen.tab("Tune")
    press(screen, "Undo")
    screen.text_box("measurement noise r").wait_for()
