"""A live source over a pseudo-terminal: snapshots, counts, reconnecting, sending."""

import math
import threading
import time
from functools import partial
from itertools import cycle

import numpy as np
import pytest
from tests.sources.scripted_port import ScriptedPort, kept, lines, source_of
from tests.support.waiting import PATIENCE

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.reading.recording_file import read_recording

pytestmark = pytest.mark.usefixtures("no_thread_left")


def received(live, count):
    return lambda: live.status().accepted >= count and kept(live) >= count


@pytest.mark.slow
def test_every_sample_arrives_exactly_with_the_names_of_the_board(board, live, wait_for):
    board.say(b"x\nheat [mV],light\n" + lines(0, 20_000) + b"nan,ovf\ninf,-inf\n")
    wait_for(received(live, 20_002))
    recording = live.snapshot().recording
    assert (recording.names, recording.units) == (("heat", "light"), ("mV", ""))
    np.testing.assert_array_equal(recording.values[:-2], np.column_stack([np.arange(20_000), -np.arange(20_000)]))
    assert np.isnan(recording.values[-2:]).all()  # what an Arduino prints for no number
    assert (np.diff(recording.time) > 0).all()
    assert recording.time[0] == 0.0
    status = live.status()
    assert (status.received, status.accepted, status.rejected, status.dropped) == (20_004, 20_002, 0, 2)


def test_other_columns_are_a_new_generation_and_the_same_header_is_none(board, live, wait_for, monkeypatch):
    board.say(b"x\na,b\n" + lines(0, 100))
    wait_for(received(live, 100))
    first = live.snapshot()
    board.say(b"a,b\n" + lines(0, 100))
    wait_for(received(live, 200))
    assert live.snapshot().generation == first.generation
    monkeypatch.setattr("kalscope.sources.live.lines.BOOT_SECONDS", 0.0)  # the board has started long ago
    board.say(b"c,d,e\n" + b"1,2,3\n" * 100)
    wait_for(lambda: live.snapshot().generation > first.generation and kept(live) == 100)
    assert (live.snapshot().recording.names, live.snapshot().first) == (("c", "d", "e"), 0)
    np.testing.assert_array_equal(first.recording.values[:, 0], np.arange(100))


@pytest.mark.slow
def test_a_board_plugged_in_again_goes_on_with_the_true_pause_and_one_missing_row(board, live, wait_for, tmp_path):
    begin = time.monotonic()
    live.record(tmp_path / "run.csv")
    board.say(b"x\na,b\n" + lines(0, 100))
    wait_for(received(live, 100))
    board.unplug()
    wait_for(lambda: live.status().word == "disconnected, waiting")
    assert live.status().hint
    time.sleep(0.3)
    board.plug()
    wait_for(lambda: live.status().word == "connected")
    board.say(b"50,1\n" + lines(100, 200))
    wait_for(lambda: kept(live) == 201)
    whole, status = time.monotonic() - begin, live.status()
    live.close()
    for recording in (read_recording(tmp_path / "run.csv"), live.snapshot().recording):
        values = recording.values[np.isfinite(recording.values).all(axis=1)]
        np.testing.assert_array_equal(values[:, 0], np.arange(200))
        assert recording.names == ("a", "b")
    assert np.isnan(recording.values[100]).all()
    assert 0.3 <= recording.time[101] - recording.time[99] <= whole
    assert (status.reconnects, status.dropped, status.hint, status.recording.error) == (1, 3, "", "")
    assert (tmp_path / "run.csv").read_text().count("# gap unplug ") == 1


def test_close_frees_the_port_and_start_goes_on_with_the_same_samples(board, live, wait_for):
    board.say(b"x\n" + lines(0, 10))
    wait_for(received(live, 10))
    live.close()
    live.close()
    assert live.status().word == "closed"
    live.start(require=True)
    board.say(b"x\n" + lines(10, 20))
    wait_for(lambda: kept(live) == 21)


@pytest.mark.slow
def test_noise_is_named_as_a_wrong_baud_rate(board, live, wait_for):
    rng = np.random.default_rng(0)
    while "baud" not in live.status().hint:
        board.say(rng.integers(128, 256, 200, dtype=np.uint8).tobytes())
        time.sleep(0.05)
    assert "115200" in live.status().hint
    assert live.snapshot() is None


def test_a_line_sent_is_answered_by_the_next_line_with_a_hash(board, live, wait_for):
    board.say(b"x\n" + lines(0, 10))
    reply = lines(10, 12) + b"# q=0.01\r\n# r=4\r\n" + lines(12, 14)
    threading.Thread(target=lambda: (board.heard(), board.say(reply))).start()
    assert live.send("q0.01", timeout=PATIENCE) == ("# q=0.01", "# r=4")
    wait_for(received(live, 14))
    np.testing.assert_array_equal(live.snapshot().recording.values[:, 0], np.arange(14))


def test_a_board_that_goes_is_not_waited_for_and_what_an_avr_would_lose_is_not_sent(board, live):
    board.say(lines(0, 10))
    threading.Thread(target=lambda: (board.heard(), board.unplug())).start()
    with pytest.raises(BadDevice, match="was disconnected before it answered"):
        live.send("q0.01", timeout=PATIENCE)
    for line in ("x" * 63, "two\nlines", "\x00"):
        with pytest.raises(BadSetting, match="at most 62 bytes"):
            live.send(line)


@pytest.mark.slow
@pytest.mark.parametrize(("starts", "kept_values", "counts"), [
    ("inside a line", [2, 3, math.nan, 21], (5, 3, 0, 2)), ("at a line", [2, 3, math.nan, 20, 21], (5, 4, 0, 1)),
    ("where it stopped", [2, 3, 20, 21], (5, 4, 0, 1)),
])  # fmt: skip
def test_an_opening_says_where_its_first_byte_is(starts, kept_values, counts, wait_for):
    first = ScriptedPort([b"heat,light\n", b"2,0\n3,0\n", BadDevice("lost")], "at a line")
    second = ScriptedPort([b"20,0\n21,0\n"], starts)
    with source_of(first, second) as live:
        wait_for(lambda: kept(live) >= len(kept_values))
        np.testing.assert_array_equal(live.snapshot().recording.values[:, 0], kept_values)
        status = live.status()
        assert (status.received, status.accepted, status.rejected, status.dropped) == counts


@pytest.mark.slow
def test_what_the_other_side_keeps_is_never_dropped(monkeypatch, wait_for):
    monkeypatch.setattr("kalscope.sources.live.source.MAX_WAITING_BYTES", 10_000)
    monkeypatch.setattr("kalscope.sources.port.reader._KEPT_BYTES", 5_000)
    port = ScriptedPort([lines(i, i + 100) for i in range(0, 10_000, 100)], "at a line", keeps=True)
    with source_of(port) as live:
        wait_for(received(live, 10_000))
        np.testing.assert_array_equal(live.snapshot().recording.values[:, 0], np.arange(10_000))
        assert live.status().overrun == 0


def test_of_a_flood_without_end_whole_lines_are_read_and_others_left_out(monkeypatch, wait_for):
    monkeypatch.setattr("kalscope.sources.live.source.MAX_WAITING_BYTES", 10_000)
    monkeypatch.setattr("kalscope.sources.port.reader._MOST_BYTES", 50_000)
    port = ScriptedPort([], "at a line")
    port.fetch = partial(next, cycle([lines(0, 100)[:501], lines(0, 100)[501:]]))
    with source_of(port) as live:
        wait_for(lambda: min(live.status().accepted, live.status().overrun) > 1000)
        status = live.status()
        assert (status.rejected, status.dropped) == (0, status.overrun)


def test_an_error_in_a_line_is_reported_and_the_next_lines_are_read(monkeypatch, wait_for):
    live = source_of(ScriptedPort([b"1,2\n", b"3,4\n"], "at a line"))
    feed, fails = live._lines.feed, iter([True])
    monkeypatch.setattr(live._lines, "feed", lambda received: 1 / 0 if next(fails, False) else feed(received))
    with live:
        wait_for(lambda: live.status().accepted == 1)
        assert live.status().hint == "an error of Kalscope left lines out (ZeroDivisionError: division by zero)"
