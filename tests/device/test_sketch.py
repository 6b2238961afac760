"""The exported sketch, compiled by avr-gcc and run in a simulated Uno: the bits of the host, and its costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.device.exported_sketch import FAST, MISSING, Talk, exported, printed_rows, saved, step_us, without_zeros
from tests.support.board import FLAT_OUT, read_lines
from tests.support.exported_program import FUSION
from tests.support.textbook import ByHand
from tests.support.waiting import wait_until

from kalscope import FilterParams, kalman_filter
from kalscope.export.board import FixedFilter, check_board, commands, is_refusal, read_answer
from kalscope.export.float32 import filter_float32, float32_params, float32_tuning
from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, OneEuro
from kalscope.sources.live.source import LiveSource
from kalscope.tuning.tuning import ChannelTuning
from kalscope_app.live import send_setting
from kalscope_app.session.changes import opened_live, refreshed, set_sent
from kalscope_app.studies.checks import compare_with_board

TRIPLES = [(0.01, 4.0, None), (0.05, 0.3, 0.0), (0.0, 4.0, 50.0), (0.7, 0.0, 3.0), (1e-10, 3.3, 12.0)]
TRIPLES += [(2e-37, 1e-36, 2e-38), (1e36, 1e37, 1e38)]


def counts(n, channels=1, spoiled=True):
    """What analogRead reads, shape (n, channels), or (n,) of one; if spoiled, with spikes and missing samples."""
    rng = np.random.default_rng(5)
    z = np.clip(np.rint(512 + 300 * np.sin(np.arange(n) / 90) + rng.normal(0, 15, (channels, n))), 1, 1023).T
    if spoiled:
        z[rng.random(z.shape) < 0.03] = 1023  # for gate and median
        z[rng.random(z.shape) < 0.03] = 0  # no sample
        z[:4, : channels - 1] = 0
    return z.astype(int) if channels > 1 else z[:, 0].astype(int)


OTHER_UNIT = (r"#ifndef KALSCOPE_UNITS_DONE\n#error .*\n#endif\n", "")
"""What the user deletes once readSensor() returns the unit of the tuning."""


MOMENTA = [(0.01, 4.0, None, 20.0), (0.3, 25.0, 1000.0, 0.0), (0.05, 30.0, None, 1e5), (2.0, 2.0, 1.0, 0.4)]


@pytest.mark.parametrize(
    ("momentum", "settings"), [(0.0, [(*one, 0.0) for one in TRIPLES]), (7.0, MOMENTA)], ids=["plain", "momentum"]
)
def test_a_board_gives_the_bits_of_the_host_also_after_changes_while_it_runs(
    start_board, workshop, momentum, settings
):
    """After each command the filter goes on, with constants that the board computed itself; p restarts it."""
    readings = counts(1500, spoiled=False)
    firmware = exported(workshop, ChannelTuning("raw", "", 0.5, 9.0, momentum=momentum))
    talk, sent = Talk(start_board(firmware, readings, *FLAT_OUT)), []
    talk.until("raw,filtered")
    for q, r, p0, tau in settings:
        talk.follow(60)
        wanted = float32_params(FilterParams(q, r, p0, momentum=tau))
        for text in commands(wanted, knows_momentum=momentum > 0.0):
            answer = read_answer(*talk.ask(text, "bits="))
            sent.append((len(talk.rows), text[0], answer, (q, r, np.inf if p0 is None else p0, tau)))
            if text.startswith("t"):
                talk.follow(50)
    talk.follow(300)
    params, at, expected = float32_params(FilterParams(0.5, 9.0, momentum=momentum)), 0, []
    oracle, z = ByHand(params), np.resize(readings, len(talk.rows))
    for row, command, answer, wanted in sent:
        expected += [oracle.update(one) for one in z[at:row]]
        params, at = answer.applied_to(params), row
        oracle.use(params)
        if command == "p":
            said = (params.q, params.r, params.p0, params.momentum.momentum if params.momentum else 0.0)
            np.testing.assert_allclose(said, wanted, rtol=3e-7)
            oracle = ByHand(params)
    expected += [oracle.update(one) for one in z[at:]]
    np.testing.assert_array_equal(np.array(talk.rows, "f4"), np.column_stack([z, expected]).astype("f4"))


GATED = ChannelTuning("*/ #define A0 1", "mV", 0.01, 40.0, gate=9.0)
THREE = (GATED, replace(GATED, q=3e-15, p0=1.2e-6, x0=400.0), ChannelTuning("temp", "", 1e-3, 25.0, 1000.0))


@pytest.mark.parametrize("momenta", [(0.0, 0.0, 0.0), (30.0, 1e4, 0.0)], ids=["plain", "momentum"])
def test_gate_start_and_missing_samples_on_three_channels(start_board, workshop, momenta):
    channels = [replace(one, momentum=momentum) for one, momentum in zip(THREE, momenta, strict=True)]
    readings = counts(1000, 3)
    readings[100:130, 0] = 1000  # a step: the gate gives in after five
    firmware = exported(workshop, *channels, edits=(*FAST, MISSING, OTHER_UNIT))
    printed = printed_rows(start_board(firmware, readings, *FLAT_OUT), 800)
    z = without_zeros(readings, len(printed))
    np.testing.assert_array_equal(printed[:, ::2], z)
    for c, channel in enumerate(channels):
        np.testing.assert_array_equal(printed[:, 2 * c + 1], filter_float32(z[:, c], channel.params))


def test_every_float_from_a_sixteenth_up_is_printed_so_that_it_is_read_back(start_board, workshop):
    readings = counts(500, spoiled=False)
    scaled = (
        r"return analogRead\((.*)\);",
        "static uint8_t n = 0; int z = analogRead(PINS[channel]) - 512; return z * 0.0628f * (1UL << n++ % 22);",
    )
    firmware = exported(workshop, ChannelTuning("raw", "", 0.1, 4.0), edits=(*FAST, scaled))
    printed = printed_rows(start_board(firmware, readings, *FLAT_OUT), 450)[:, 0]
    n = np.arange(len(printed)) % 256 % 22
    sent = (readings[: len(printed)] - 512).astype(np.float32) * np.float32(0.0628) * (2.0**n).astype(np.float32)
    assert np.abs(sent[sent != 0]).min() < 1e-7 * np.abs(sent).max()
    np.testing.assert_array_equal(printed, sent)


def test_a_sketch_for_another_unit_compiles_only_when_its_sensor_is_written(workshop, tmp_path):
    sketch = saved(tmp_path, ChannelTuning("tilt", "g", 0.1, 4.0))
    with pytest.raises(RuntimeError, match=r"#error .*analogRead\(\) returns counts"):
        workshop.sketch(sketch)
    in_g = (r"return analogRead\((.*)\);", "return analogRead(PINS[channel]) * (2.0f / 1023);")
    assert workshop.sketch(sketch, in_g, OTHER_UNIT).flash > 0
    assert exported(workshop, ChannelTuning("tilt", "ADC counts", 0.1, 4.0), edits=()).flash > 0


def test_the_minimal_sketch_prints_raw_and_filtered_and_is_smaller(start_board, workshop, tmp_path):
    tuning = ChannelTuning("light", "", 0.1, 10.0)
    small = workshop.sketch(saved(tmp_path, tuning, minimal=True))
    assert small.flash < exported(workshop, tuning, edits=()).flash
    counts = [500, 510, 490, 505]
    board = start_board(small, counts, *FLAT_OUT)
    lines = [line.decode().split(",") for line in read_lines(board.port, 4)]
    assert [float(raw) for raw, _ in lines] == counts
    x = kalman_filter(np.array(counts), tuning.params).x
    np.testing.assert_allclose([float(filtered) for _, filtered in lines], x, atol=0.006)


REFUSED = {
    0.0: (
        ("q", "q x", "q -1", "r nan", "q inf", "x 1", "", "q 0.5 7", "3 q 1", "q" * 10 + " 1", "q 1" + "0" * 40),
        "# light q=2.500000e-1 r=4.000000 p=inf bits=3E800000,40800000,7F800000",
    ),
    0.25: (
        ("t", "t -1", "t 1e-4", "t 100001", "t nan", "t inf", "q 3e38", "r x"),
        "# light q=2.500000e-1 r=4.000000 p=inf t=2.500000e-1 bits=3E800000,40800000,7F800000,3E800000",
    ),
}


@pytest.mark.parametrize("momentum", REFUSED)
def test_what_a_board_cannot_take_changes_nothing(start_board, workshop, momentum):
    lines, used = REFUSED[momentum]
    firmware = exported(workshop, ChannelTuning("light", "", 0.25, 4.0, momentum=momentum))
    board = start_board(firmware, 500, *FLAT_OUT)
    talk = Talk(board)
    for line in lines:
        talk.said.clear()
        talk.port.write(line.encode() + b"\n")
        assert talk.ask("?", "bits=") == [used], line
        assert sum(is_refusal(text) for _, text in talk.said) == int(line != ""), line


def test_three_sensors_with_gaps_and_spikes_are_fused_to_the_bit(start_board, workshop):
    fusion = replace(FUSION, unit="")
    readings = np.array(fusion.offset) + np.array(fusion.gain) * counts(700, spoiled=False)[:, None]
    readings = np.clip(np.rint(readings), 1, 1023).astype(int)
    spoiled = counts(700, 3)
    readings = np.where((spoiled == 0) | (spoiled == 1023), spoiled, readings)
    readings[[0, 300]] = 0
    missing = (MISSING[0], MISSING[1].replace("channel", "sensor"))
    printed = printed_rows(
        start_board(exported(workshop, fusion, edits=(*FAST, missing)), readings, *FLAT_OUT), 501
    )
    z = without_zeros(readings, len(printed))
    np.testing.assert_array_equal(printed[:, :3], z)
    np.testing.assert_array_equal(printed[:, 3], filter_float32(z, fusion.params))


LIGHT = ChannelTuning("light", "", 0.01, 4.0)
LEVEL = ChannelTuning("level", "", 0.5, (9.0, 18.0, 27.0), sensors=("a", "b", "c"))
ROW = "float row[KALSCOPE_SENSORS]; for (uint8_t j = 0; j < KALSCOPE_SENSORS; j++) row[j] = z + j;"
FILTER = "x = running ? filter.update(z) : z;", "KalscopeFilter filter(KALSCOPE_TUNING_LIGHT);"
FUSE = f"{ROW} x = running ? fusion.update(row) : row[0];", "KalscopeFusion fusion(KALSCOPE_FUSION_LEVEL);"
SHIFTED = {"offset": (0.0, 1.0, 2.0)}
TAKE = "if (running) one.take(z);", "KalscopeCalibration one;", "one.start(20000, KalscopeReadings{1, 0, 1023});"


@pytest.mark.parametrize(
    ("channel", "timed", "step", "flash", "ram", "us"),
    [
        (LIGHT, {}, FILTER, 7648, 311, 109),
        (LIGHT, {}, ("if (running) z = analogRead(A0);",), 7648, 311, 112),
        (replace(LIGHT, momentum=20.0), {}, FILTER, 9774, 379, 305),
        (LIGHT, {}, TAKE, 14972, 487, 490 - 109),
        (LEVEL, SHIFTED, FUSE, 5170, 320, 343),
        (replace(LEVEL, momentum=20.0), SHIFTED | {"gain": (1.0, 1.05, 1.0)}, FUSE, 5976, 388, 694 + 3 * 29),
    ],
)
def test_flash_memory_and_time_are_what_we_say(
    start_board, workshop, tmp_path, channel, timed, step, flash, ram, us
):
    kind = {"calibration": step is TAKE}
    firmware = exported(workshop, channel, edits=(), **kind)
    assert (firmware.flash, firmware.ram) == pytest.approx((flash, ram), rel=0.05)
    sketch = saved(tmp_path, replace(channel, **timed), **kind)
    assert step_us(start_board, workshop, sketch, *step) == pytest.approx(us, rel=0.05)


CHANNELS = (
    ChannelTuning("flex", "", 0.3, 40.0, gate=9.0, momentum=30.0, chain=Chain(5)),
    ChannelTuning("tilt", "", 1.0, 1.0, chain=Chain(3, OneEuro(0.004, 2e-4, 0.05))),
    ChannelTuning("hum", "", 1.0, 1.0, chain=Chain(then=Butterworth(0.02))),
    ChannelTuning("light", "", 0.01, 40.0, 1000.0),
    ChannelTuning("rest", "", 0.01, 40.0, fast=1e5, spikes=0.01),
)


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
    z = counts(200)
    firmware = exported(workshop, channel, edits=(*FAST, MISSING))
    assert (firmware.flash, firmware.ram) == pytest.approx((4972, 244 + 4 * 342), rel=0.05)
    talk = Talk(start_board(firmware, z, *FLAT_OUT))
    talk.ask("q 0.5\r", "not understood; these filters take no values")
    talk.follow(80)
    assert sum(is_refusal(text) for _, text in talk.said) == 1
    printed = np.array(talk.rows, np.float32)
    np.testing.assert_array_equal(printed[:, 1], filter_float32(printed[:, 0], channel))


TIMED = [None, Chain(5), Chain(then=MovingAverage(25)), Chain(then=Exponential(0.1)), Chain(3, Exponential(0.125))]
TIMED += [Chain(then=one) for one in (Median(21), Butterworth(0.02), OneEuro(0.01, 0.02, 0.05))]
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
    channels = tuple(ChannelTuning(f"chain{i}", "", 0.01, 4.0, chain=chain) for i, chain in enumerate(TIMED))
    channels += tuple(ChannelTuning(f"rest{i}", "", 0.01, 4.0, fast=1e4, spikes=i / 100) for i in (0, 1))
    saved(tmp_path, *channels)
    names = ", ".join(f"KALSCOPE_TUNING_{channel.name.upper()}" for channel in channels)
    (tmp_path / "timing.ino").write_text(TIMING.replace("TUNINGS", names))
    board = start_board(workshop.sketch(tmp_path / "timing.ino"), 0, *FLAT_OUT)
    found = [int(line) / 256 for line in read_lines(board.port, len(channels))]
    said = [109, 163, 88, 80, 80 + 42, 116, 163, 240, 589, 980]  # µs, those of docs/device.md
    np.testing.assert_allclose(found, said, rtol=0.1, err_msg=str(found))


def grown(source, state, condition):
    """The state once enough samples have arrived."""

    def enough():
        nonlocal state
        state = refreshed(state, source.snapshot())
        return condition(state)

    wait_until(enough, pause=0.05)
    return state


def assert_obeys(state):
    check = compare_with_board(state)
    assert check.rows > 150
    assert check.different == 0


def test_a_board_that_runs_already_can_be_sent_to_though_it_has_told_no_names(start_board, workshop):
    firmware = exported(workshop, ChannelTuning("light", "counts", 0.5, 20.0), edits=())
    board = start_board(firmware, np.random.default_rng(8).integers(300, 700, 4000))
    read_lines(board.port, 3)  # its header has gone
    with LiveSource(board.port) as source:
        state = grown(source, opened_live(source, "board"), lambda state: len(state.recording) > 150)
        assert state.recording.names == ("value 1", "value 2")
        state = state.with_tuning(q=0.037, r=11.3)
        state = set_sent(send_setting(state, source))(state)
        assert state.board == "value 2"
        rows = state.sent.row + 200
        state = grown(source, state, lambda state: len(state.recording) > rows)
    assert_obeys(state)


@pytest.mark.parametrize(("before", "after"), [(0.0, 0.0), (20.0, 5.0)])
def test_only_the_channel_on_screen_gets_the_values_and_computes_what_we_do(start_board, workshop, before, after):
    light = ChannelTuning("light", "counts", 0.5, 20.0)
    temp = ChannelTuning("temp", "counts", 0.01, 9.0, 4.0, momentum=before)
    firmware = exported(workshop, light, temp, edits=())
    counts = np.random.default_rng(8).integers(300, 700, (4000, 2))
    board = start_board(firmware, counts, "--wait-open")
    with LiveSource(board.port) as source:
        state = grown(source, opened_live(source, "board"), lambda state: len(state.recording) > 150)
        assert state.recording.names == ("light", "light_filtered", "temp", "temp_filtered")
        state = replace(state, channel="temp").with_tuning(q=0.037, r=11.3, momentum=after)
        state = replace(state, sent=send_setting(state, source))
        rows = state.sent.row + 200
        state = grown(source, state, lambda state: len(state.recording) > rows)
    assert_obeys(state)
    column = state.recording.channel
    other = check_board(column("light"), column("light_filtered"), float32_params(light.params))
    assert (other.rows, other.different) == (len(state.recording), 0)
