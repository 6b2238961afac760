"""The sketch that makers flash, in a simulated Uno: what it sends, and what a live source makes of it."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.board import FLAT_OUT, SKETCHES, read_lines
from tests.support.waiting import PATIENCE
from tests.support.waiting import wait_until as wait_for

from kalscope.sources.live import lines
from kalscope.sources.live.source import LiveSource
from kalscope.sources.reading.line_parser import LineParser

SKETCH = SKETCHES / "kalscope_stream/kalscope_stream.ino"
THREE_CHANNELS = (r'\{"A0", A0\},\n    // \{"A1", A1\},', '{"light", A0}, {"heat [mV]", A2}, {"x", A5},')


def parsed(lines):
    parser = LineParser()
    parser.feed(b"".join(lines))
    return list(parser), parser.layout


def rate(samples_per_second):
    return (r"(?<=SAMPLES_PER_SECOND = )200", str(samples_per_second))


def test_channels_carry_the_names_the_board_gives_them_and_its_clock(start_board, workshop):
    clock = (r"(?<=BOARD_TIME = )false", "true")
    firmware = workshop.sketch(SKETCH, THREE_CHANNELS, clock)
    counts = np.random.default_rng(4).integers(0, 1024, (100, 6))
    events, layout = parsed(read_lines(start_board(firmware, counts, *FLAT_OUT).port, 101))
    names = [f"{column.name} {column.unit} {column.role}" for column in layout.columns]
    assert names == ["time_us us time", "light  channel", "heat mV channel", "x  channel"]
    rows = np.array([event.rows[0] for event in events[1:]])
    np.testing.assert_array_equal(rows[:, 1:], counts[:, [0, 2, 5]])
    np.testing.assert_allclose(np.diff(rows[:, 0]), 5000, atol=20)


def test_no_flipped_bit_gets_past_the_checksum(start_board, stream_sketch):
    lines = read_lines(start_board(stream_sketch, range(1000, 1024), *FLAT_OUT).port, 60)[1:]
    whole = lines[20:]
    damaged = []
    for i, line in enumerate(whole):
        at, bit = i % (len(line) - 2), i % 8  # the newline stays
        damaged.append(line[:at] + bytes([line[at] ^ 1 << bit]) + line[at + 1 :])
    events, _ = parsed(lines[:20] + damaged)
    assert {event.kind for event in events[:20]} == {"row"}
    # A flip from B to b in the checksum itself leaves it true: what is believed is what was sent.
    believed = [event.text.upper().encode() + b"\r\n" for event in events[20:] if event.kind == "row"]
    assert len(believed) < len(whole) / 10
    assert set(believed) <= set(whole)


@pytest.mark.parametrize("samples_per_second", [200, 300])
def test_the_rate_is_kept_without_drift(start_board, workshop, tmp_path, samples_per_second):
    firmware = workshop.sketch(SKETCH, rate(samples_per_second))
    times = tmp_path / "times"
    board = start_board(firmware, 512, *FLAT_OUT, "--seconds", 3, "--adc-times", times)
    read_lines(board.port, 2 * samples_per_second)
    board.wait()
    taken = np.loadtxt(times)
    late = taken - taken[0] - np.arange(len(taken)) / samples_per_second
    assert len(taken) >= 2.9 * samples_per_second
    assert np.abs(late).max() < 100e-6  # micros() steps by 4 µs, and the timer's interrupt takes 7


def test_a_rate_that_the_line_cannot_carry_is_said_and_the_grid_kept(start_board, workshop, tmp_path):
    firmware = workshop.sketch(SKETCH, (r"(?<=BAUD = )115200", "9600"), rate(200))
    times = tmp_path / "times"
    board = start_board(firmware, 512, *FLAT_OUT, "--seconds", 4, "--adc-times", times)
    events, _ = parsed(read_lines(board.port, 230, 9600))
    board.wait()
    remarks = [i for i, event in enumerate(events) if event.kind == "comment"]
    said = [events[i].text for i in remarks[1:]]
    sent = remarks[-1] - len(said)  # samples before the last remark, which counts all that were left out by then
    taken = np.loadtxt(times)
    slot = np.floor((taken - taken[0]) * 200)
    assert len(said) >= 2
    assert said[0].endswith("raise BAUD, or lower SAMPLES_PER_SECOND")
    assert slot[sent - 1] == sent - 1 + sum(int(text.split()[3]) for text in said)
    assert {event.kind for event in events} == {"comment", "row"}


def test_all_1024_counts_arrive_exactly_under_the_name_the_board_gives(start_board, workshop, monkeypatch):
    monkeypatch.setattr(lines, "_SILENCE", PATIENCE)  # a stall inside a line would look like a reset there
    counts = np.random.default_rng(5).permutation(1024)
    board = start_board(workshop.sketch(SKETCH, rate(900)), counts, *FLAT_OUT)
    with LiveSource(board.port) as live:
        wait_for(lambda: live.status().accepted >= 1024)
        recording, status = live.snapshot().recording, live.status()
    assert recording.names == ("A0",)
    np.testing.assert_array_equal(recording.values[:1024, 0], counts)
    assert status.rejected == 0
    assert status.received == status.accepted + status.dropped


def test_pulling_the_plug_and_plugging_in_again_is_one_gap(start_board, stream_sketch):
    board = start_board(stream_sketch, 512, "--speed", "1", "--wait-open")
    with LiveSource(board.port) as live:
        wait_for(lambda: live.status().accepted >= 100)
        board.unplug()
        wait_for(lambda: live.status().word == "disconnected, waiting")
        before = live.status().accepted
        start_board(stream_sketch, 700, "--speed", "1", "--wait-open")
        wait_for(lambda: live.status().accepted >= before + 100)
        recording, status = live.snapshot().recording, live.status()
    (gap,) = np.flatnonzero(np.isnan(recording.values[:, 0]))
    assert (set(recording.values[:gap, 0]), set(recording.values[gap + 1 :, 0])) == ({512.0}, {700.0})
    assert (np.diff(recording.time) > 0).all()
    assert (status.reconnects, status.hint) == (1, "")


def test_the_reset_button_makes_no_new_generation(start_board, stream_sketch):
    board = start_board(stream_sketch, 512, "--speed", "1", "--wait-open")
    with LiveSource(board.port) as live:
        wait_for(lambda: live.status().accepted >= 50)
        first = live.snapshot()
        board.reset()
        before = live.status().accepted
        wait_for(lambda: live.status().accepted >= before + 100)
        later, status = live.snapshot(), live.status()
    assert later.generation == first.generation
    assert set(later.recording.values[:, 0]) == {512.0}
    assert status.reconnects == 0
