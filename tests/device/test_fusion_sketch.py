"""The exported sketch of a fusion in a simulated Uno: the bits of the float32 fusion, and what it costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from board import FLAT_OUT, read_lines
from exported_program import FUSION
from exported_sketch import FAST, MISSING, exported, saved, step_us

from kalscope import ChannelTuning
from kalscope.export.float32 import filter_float32


def test_three_sensors_with_gaps_and_spikes_are_fused_to_the_bit(start_board, workshop):
    fusion = replace(FUSION, unit="")
    rng = np.random.default_rng(5)
    x = 500.0 + 200.0 * np.sin(np.arange(700) / 60.0)
    counts = np.array(fusion.offset) + np.array(fusion.gain) * x[:, None] + rng.normal(size=(700, 3)) * 8.0
    counts = np.clip(np.rint(counts), 1, 1023).astype(int)
    counts[rng.random(counts.shape) < 0.03] = 1023  # for the gate
    counts[rng.random(counts.shape) < 0.05] = 0  # no reading
    counts[[0, 300]] = 0
    missing = (MISSING[0], MISSING[1].replace("channel", "sensor"))
    board = start_board(exported(workshop, fusion, edits=(*FAST, missing)), counts, *FLAT_OUT)
    lines = read_lines(board.port, 501, 1_000_000)
    board.stop()
    assert lines[0].strip() == b"# a,b,c,level"
    rows = [line for line in lines if not line.startswith(b"#")]
    printed = np.array([[float(cell) for cell in line.split(b",")] for line in rows], dtype=np.float32)
    z = np.where(counts[: len(printed)] == 0, np.nan, counts[: len(printed)])
    np.testing.assert_array_equal(printed[:, :3], z.astype(np.float32))
    np.testing.assert_array_equal(printed[:, 3], filter_float32(z, fusion.params))


@pytest.mark.parametrize(
    ("momentum", "gain", "flash", "ram", "us"),
    [(0.0, 1.0, 5170, 320, 343), (20.0, 1.05, 5976, 388, 694 + 3 * 29)],
    ids=["five lines", "momentum and gains"],
)
def test_time_flash_and_memory_are_what_we_say(start_board, workshop, tmp_path, momentum, gain, flash, ram, us):
    plain = ChannelTuning("level", "", 0.5, (9.0, 18.0, 27.0), sensors=("a", "b", "c"), momentum=momentum)
    firmware = exported(workshop, plain, edits=())
    assert firmware.flash == pytest.approx(flash, rel=0.05)
    assert firmware.ram == pytest.approx(ram, rel=0.05)
    timed = replace(plain, offset=(0.0, 1.0, 2.0), gain=(1.0, gain, 1.0))
    row = "float row[KALSCOPE_SENSORS]; for (uint8_t j = 0; j < KALSCOPE_SENSORS; j++) row[j] = z + j;"
    step = f"{row} x = running ? fusion.update(row) : row[0];"
    declared = "KalscopeFusion fusion(KALSCOPE_FUSION_LEVEL);"
    assert step_us(start_board, workshop, saved(tmp_path, timed), step, declared) == pytest.approx(us, rel=0.05)
