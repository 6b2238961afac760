"""Chains and classic filters in the exported sketch, in a simulated Uno: the host's bits, and what they cost."""

from __future__ import annotations

import numpy as np
import pytest
from tests.device.exported_sketch import FAST, MISSING, Talk, exported, saved, without_zeros
from tests.support.board import FLAT_OUT, read_lines

from kalscope.export.board import FixedFilter, check_board, is_refusal, read_answer
from kalscope.export.float32 import filter_float32, float32_tuning
from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, OneEuro
from kalscope.tuning.tuning import ChannelTuning

CHANNELS = (
    ChannelTuning("flex", "", 0.3, 40.0, gate=9.0, momentum=30.0, chain=Chain(5)),
    ChannelTuning("tilt", "", 1.0, 1.0, chain=Chain(3, OneEuro(0.004, 2e-4, 0.05))),
    ChannelTuning("hum", "", 1.0, 1.0, chain=Chain(then=Butterworth(0.02))),
    ChannelTuning("light", "", 0.01, 40.0, 1000.0),
    ChannelTuning("rest", "", 0.01, 40.0, fast=1e5, spikes=0.01),
)


def counts(n, channels):
    rng = np.random.default_rng(5)
    z = np.clip(np.rint(512 + 300 * np.sin(np.arange(n) / 90) + rng.normal(0, 15, (channels, n))), 1, 1023).T
    z[rng.random(z.shape) < 0.03] = 1023  # for gate and median
    z[rng.random(z.shape) < 0.03] = 0  # no sample
    z[:4, :2] = 0
    return z.astype(int)


def asked(talk, text):
    """What each channel answers."""
    return [read_answer(line) for line in talk.ask(text, "bits=|takes no values", len(CHANNELS))]


def test_five_channels_with_different_filters_print_the_bits_of_the_host_and_say_what_obeys(start_board, workshop):
    z = counts(1200, len(CHANNELS))
    firmware = exported(workshop, *CHANNELS, edits=(*FAST, MISSING))
    board = start_board(firmware, z, *FLAT_OUT)
    talk = Talk(board)
    talk.follow(150)
    first = asked(talk, "?")
    before = len(talk.rows)
    asked(talk, "q 0.7")
    restarted = len(talk.rows)
    last = asked(talk, "p inf")
    talk.follow(120)
    assert [one.name for one in first] == [channel.name for channel in CHANNELS]
    assert [type(one) is FixedFilter for one in first] == [False, True, True, False, True]
    assert [one.median for one in (first[0], first[3])] == [5, 1]
    printed = np.array(talk.rows, dtype=np.float32)
    samples = without_zeros(z, len(printed))
    np.testing.assert_array_equal(printed[:, ::2], samples)
    for c, channel in enumerate(CHANNELS):
        rows = len(printed) if isinstance(first[c], FixedFilter) else before
        expected = filter_float32(samples[:rows, c], channel)
        np.testing.assert_array_equal(printed[:rows, 2 * c + 1], expected, err_msg=channel.name)
    for c in (0, 3):
        params = last[c].applied_to(float32_tuning(CHANNELS[c]))
        check = check_board(samples[restarted:, c], printed[restarted:, 2 * c + 1], params)
        assert (check.different, check.rows > 100, params.q) == (0, True, np.float32(0.7))


def test_a_sketch_without_a_kalman_filter_says_that_it_takes_no_values(start_board, workshop):
    channel = ChannelTuning("light", "", 1.0, 1.0, chain=Chain(then=MovingAverage(342)))  # the longest that fits
    z = counts(200, 1)
    firmware = exported(workshop, channel, edits=(*FAST, MISSING))
    assert firmware.flash == pytest.approx(4972, rel=0.05)
    assert firmware.ram == pytest.approx(244 + 4 * 342, abs=20)
    talk = Talk(start_board(firmware, z, *FLAT_OUT))
    talk.ask("q 0.5\r", "not understood; these filters take no values")
    talk.follow(80)
    assert sum(is_refusal(text) for _, text in talk.said) == 1
    printed = np.array(talk.rows, np.float32)
    np.testing.assert_array_equal(printed[:, 1], filter_float32(printed[:, 0], channel))


TIMED = {
    "plain": None,
    "spiky": Chain(5),
    "mean": Chain(then=MovingAverage(25)),
    "smooth": Chain(then=Exponential(0.1)),
    "power": Chain(3, Exponential(0.125)),
    "middle": Chain(then=Median(21)),
    "steep": Chain(then=Butterworth(0.02)),
    "euro": Chain(then=OneEuro(0.01, 0.02, 0.05)),
}
TIMING = r"""
#include "KalscopeFilter.h"
volatile float z, x;
unsigned long spent(KalscopeFilter *filter) {
  const unsigned long start = micros();
  for (unsigned i = 0; i < 256; i++) {
    z = 500 + (i * 29u & 127);
    x = filter != nullptr ? filter->update(z) : (float)z;
  }
  return micros() - start;
}
void setup() {
  static const KalscopeTuning tunings[] = {TUNINGS};
  Serial.begin(115200);
  for (const KalscopeTuning &tuning : tunings) {
    KalscopeFilter filter(tuning);
    Serial.println(spent(&filter) - spent(nullptr));
  }
}
void loop() {}
"""


def test_the_time_of_each_filter_is_about_what_we_say(start_board, workshop, tmp_path, monkeypatch):
    monkeypatch.setattr("kalscope.export.targets.arduino.ANALOGUE_PINS", len(TIMED) + 2)
    channels = tuple(ChannelTuning(name, "", 0.01, 4.0, chain=chain) for name, chain in TIMED.items())
    channels += tuple(ChannelTuning(f"rest{i}", "", 0.01, 4.0, fast=1e4, spikes=i / 100) for i in (0, 1))
    saved(tmp_path, *channels)
    names = ", ".join(f"KALSCOPE_TUNING_{channel.name.upper()}" for channel in channels)
    (tmp_path / "timing.ino").write_text(TIMING.replace("TUNINGS", names))
    board = start_board(workshop.sketch(tmp_path / "timing.ino"), 0, *FLAT_OUT)
    found = [int(line) / 256 for line in read_lines(board.port, len(channels))]
    said = [109, 163, 88, 80, 80 + 42, 116, 163, 240, 589, 980]  # µs, those of docs/device.md
    np.testing.assert_allclose(found, said, rtol=0.1, err_msg=str(found))
