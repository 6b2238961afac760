"""Sensors of one quantity as a user fuses them: ticked, one dropped out, tuned, saved, and loaded again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kalscope import estimate_fusion, fuse, load_tuning, open_source

SOURCE = "synthetic:sine?n=400&sigmas=0.1,0.2,0.4&offsets=0,0.3,-0.2&drop_outs=0.02"


def test_sensors_are_fused_one_drops_out_and_the_file_brings_them_back(start, tmp_path):
    z = open_source(SOURCE).values
    found = estimate_fusion(z, names=("a", "b", "c")).params
    screen = start(SOURCE)
    screen.open_more()
    screen.page.get_by_text("Fuse sensors", exact=True).click()
    for name in ("a", "b", "c"):
        screen.tick(name)
    screen.press("Fuse")
    screen.wait_for_line("fused", fuse(z, found).x, 1e-9)
    screen.wait_for_value("channel", "fused")
    assert screen.text_box("measurement noise r").count() == 0
    assert np.array_equal(screen.line("b")[1], z[:, 1], equal_nan=True)

    screen.tick("c")
    two = found.only([0, 1])
    screen.wait_for_line("fused", fuse(z[:, :2], two).x, 1e-9)
    screen.page.get_by_label(f"a: share {100 * two.shares[0]:.0f} %", exact=True).wait_for()
    screen.type("process noise q", "0.001")
    tuned = fuse(z[:, :2], replace(two, q=0.001)).x
    screen.wait_for_line("fused", tuned, 1e-9)
    screen.tab("Export")
    screen.download("Download tuning file", tmp_path / "tuning.toml")
    saved = load_tuning(tmp_path / "tuning.toml").fusion
    assert (saved.sensors, saved.q) == (("a", "b"), 0.001)
    np.testing.assert_allclose(fuse(z[:, :2], saved.params).x, tuned, rtol=0, atol=1e-9)

    screen.tab("Tune")
    screen.press("Stop fusing")
    screen.text_box("measurement noise r").wait_for()
    screen.tab("Source")
    screen.upload("Upload a file", tmp_path / "tuning.toml")
    screen.wait_for_line("fused", tuned, 1e-9)
    screen.tab("Tune")
    screen.press("Undo")
    screen.text_box("measurement noise r").wait_for()
