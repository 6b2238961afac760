"""The exported sketch of a fusion in a simulated Uno: the bits of the float32 fusion, and what it costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from board import FLAT_OUT, read_lines

from kalscope import ChannelTuning, Tuning, export_tuning
from kalscope.export.float32 import filter_float32

pytestmark = pytest.mark.device

FAST = ((r"(?<=BAUD = )115200", "1000000"), (r"(?<=PERIOD_US = )\d+", "2000"))
MISSING = (r"return analogRead\((.*)\);", "int n = analogRead(PINS[sensor]); return n > 0 ? n : NAN;")


def saved(folder, fusion):
    """The sketch of an export, as it leaves."""
    tuning = Tuning((ChannelTuning("a", "", 1.0, 1.0),), sample_period=0.005, fusion=fusion)
    for name, text in export_tuning(tuning, "arduino").items():
        (folder / name).write_text(text, encoding="ascii")
    return folder / "kalscope_fusion.ino"


def test_three_sensors_with_gaps_and_spikes_are_fused_to_the_bit(start_board, workshop, tmp_path):
    fusion = ChannelTuning(
        "level",
        "",
        4.0,
        (90.0, 25.0, 400.0),
        sensors=("a", "b", "c"),
        offset=(0.0, 12.5, -30.0),
        gain=(1.0, 1.05, 0.9),
        gate=9.0,
        momentum=20.0,
    )
    rng = np.random.default_rng(5)
    x = 500.0 + 200.0 * np.sin(np.arange(700) / 60.0)
    counts = np.array(fusion.offset) + np.array(fusion.gain) * x[:, None] + rng.normal(size=(700, 3)) * 8.0
    counts = np.clip(np.rint(counts), 1, 1023).astype(int)
    counts[rng.random(counts.shape) < 0.03] = 1023  # for the gate
    counts[rng.random(counts.shape) < 0.05] = 0  # no reading
    counts[[0, 300]] = 0
    board = start_board(workshop.sketch(saved(tmp_path, fusion), *FAST, MISSING), counts, *FLAT_OUT)
    lines = read_lines(board.port, 501, 1_000_000)
    board.stop()
    assert lines[0].strip() == b"# a,b,c,level"
    rows = [line for line in lines if not line.startswith(b"#")]
    printed = np.array([[float(cell) for cell in line.split(b",")] for line in rows], dtype=np.float32)
    z = np.where(counts[: len(printed)] == 0, np.nan, counts[: len(printed)])
    np.testing.assert_array_equal(printed[:, :3], z.astype(np.float32))
    np.testing.assert_array_equal(printed[:, 3], filter_float32(z, fusion.params))


TIMING = r"""
#include "KalscopeFusion.h"
KalscopeFusion fusion(KALSCOPE_FUSION_LEVEL);
volatile float z, x;
unsigned long spent(bool fusing) {
  const unsigned long start = micros();
  for (int i = 0; i < 500; i++) {
    float row[KALSCOPE_SENSORS];
    for (uint8_t j = 0; j < KALSCOPE_SENSORS; j++) row[j] = z = 500 + (i & 31) + j;
    x = fusing ? fusion.update(row) : row[0];
  }
  return micros() - start;
}
void setup() {
  Serial.begin(115200);
  Serial.println(spent(true) - spent(false));
}
void loop() {}
"""


@pytest.mark.parametrize(
    ("momentum", "gain", "flash", "ram", "us"),
    [(0.0, 1.0, 5170, 320, 343), (20.0, 1.05, 5976, 388, 694 + 3 * 29)],
    ids=["five lines", "momentum and gains"],
)
def test_time_flash_and_memory_are_what_we_say(start_board, workshop, tmp_path, momentum, gain, flash, ram, us):
    plain = ChannelTuning("level", "", 0.5, (9.0, 18.0, 27.0), sensors=("a", "b", "c"), momentum=momentum)
    firmware = workshop.sketch(saved(tmp_path, plain))
    assert firmware.flash == pytest.approx(flash, rel=0.05)
    assert firmware.ram == pytest.approx(ram, rel=0.05)
    timed = replace(plain, offset=(0.0, 1.0, 2.0), gain=(1.0, gain, 1.0))
    saved(tmp_path, timed)
    (tmp_path / "timing.ino").write_text(TIMING)
    board = start_board(workshop.sketch(tmp_path / "timing.ino"), 0, *FLAT_OUT)
    assert int(read_lines(board.port, 1)[0]) / 500 == pytest.approx(us, rel=0.05)
