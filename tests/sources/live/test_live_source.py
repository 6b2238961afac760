"""A live source over a pseudo-terminal: snapshots, counts, reconnecting, sending."""

import math
import threading
import time

import numpy as np
import pytest
from scripted_port import ScriptedPort, scripted
from waiting import PATIENCE

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port.reader import PortReader
from kalscope.sources.port.registry import PortSpec

pytestmark = pytest.mark.usefixtures("no_thread_left")


def lines(begin, end):
    return b"".join(b"%d,%d\r\n" % (i, -i) for i in range(begin, end))


def received(live, count):
    return lambda: live.status().accepted >= count and live.snapshot() is not None and kept(live) >= count


def kept(live):
    snapshot = live.snapshot()
    return 0 if snapshot is None else snapshot.first + len(snapshot.recording)


def test_every_sample_arrives_exactly_with_the_names_of_the_board(board, live, wait_for):
    board.say(b"x\nheat [mV],light\n" + lines(0, 20_000))
    wait_for(received(live, 20_000))
    recording = live.snapshot().recording
    assert recording.names == ("heat", "light")
    assert recording.units == ("mV", "")
    np.testing.assert_array_equal(recording.values, np.column_stack([np.arange(20_000), -np.arange(20_000)]))
    assert (np.diff(recording.time) > 0).all()
    assert recording.time[0] == 0.0
    status = live.status()
    assert (status.received, status.accepted, status.rejected, status.dropped) == (20_002, 20_000, 0, 2)


def test_what_an_arduino_prints_for_no_number_is_a_missing_sample(board, live, wait_for):
    board.say(b"x\n1,2\nnan,ovf\ninf,-inf\n3,4\n")
    wait_for(received(live, 4))
    expected = [[1, 2], [math.nan] * 2, [math.nan] * 2, [3, 4]]
    np.testing.assert_array_equal(live.snapshot().recording.values, expected)
    assert live.status().rejected == 0


def test_other_columns_are_a_new_generation_and_the_same_header_is_none(board, live, wait_for):
    board.say(b"x\na,b\n" + lines(0, 100))
    wait_for(received(live, 100))
    first = live.snapshot()
    board.say(b"a,b\n" + lines(0, 100))
    wait_for(received(live, 200))
    assert live.snapshot().generation == first.generation
    time.sleep(2.1)  # no longer the time in which a board starts
    board.say(b"c,d,e\n" + b"1,2,3\n" * 100)
    wait_for(lambda: live.snapshot().recording.names == ("c", "d", "e"))
    wait_for(lambda: kept(live) == 100)
    assert live.snapshot().generation > first.generation
    assert live.snapshot().first == 0
    np.testing.assert_array_equal(first.recording.values[:, 0], np.arange(100))


def test_a_board_plugged_in_again_goes_on_with_the_true_pause_and_one_missing_row(board, live, wait_for):
    begin = time.monotonic()
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
    whole = time.monotonic() - begin
    recording = live.snapshot().recording
    assert np.isnan(recording.values[100]).all()
    np.testing.assert_array_equal(recording.values[101:, 0], np.arange(100, 200))
    assert 0.3 <= recording.time[101] - recording.time[99] <= whole
    status = live.status()
    assert (status.reconnects, status.dropped, status.hint) == (1, 3, "")
    assert recording.names == ("a", "b")


def test_close_frees_the_port_and_start_goes_on_with_the_same_samples(board, live, wait_for):
    board.say(b"x\n" + lines(0, 10))
    wait_for(received(live, 10))
    for _ in range(2):
        live.close()
        live.close()
    assert live.status().word == "closed"
    live.start(require=True)
    board.say(b"x\n" + lines(10, 20))
    wait_for(lambda: kept(live) == 21)


@pytest.mark.slow
def test_a_board_that_is_not_there_is_waited_for_or_refused(tmp_path, wait_for):
    path = str(tmp_path / "ttyNONE")
    live = LiveSource(path)
    with pytest.raises(BadDevice, match="plugged in"):
        live.start(require=True)
    live.start()
    wait_for(lambda: live.status().word == "disconnected, waiting")
    assert "plugged in" in live.status().hint
    live.close()


def test_noise_is_named_as_a_wrong_baud_rate(board, live, wait_for):
    rng = np.random.default_rng(0)
    while "baud" not in live.status().hint:
        board.say(rng.integers(128, 256, 200, dtype=np.uint8).tobytes())
        time.sleep(0.05)
    assert "115200" in live.status().hint
    assert live.snapshot() is None


def answer(board, reply):
    threading.Thread(target=lambda: (board.heard(), board.say(reply))).start()


def test_a_line_sent_is_answered_by_the_next_line_with_a_hash(board, live, wait_for):
    board.say(b"x\n" + lines(0, 10))
    answer(board, lines(10, 12) + b"# q=0.01\r\n# r=4\r\n" + lines(12, 14))
    assert live.send("q0.01", timeout=PATIENCE) == ("# q=0.01", "# r=4")
    wait_for(received(live, 14))
    np.testing.assert_array_equal(live.snapshot().recording.values[:, 0], np.arange(14))


def test_a_board_that_goes_before_it_answers_is_not_waited_for(board, live):
    board.say(lines(0, 10))
    threading.Thread(target=lambda: (board.heard(), board.unplug())).start()
    with pytest.raises(BadDevice, match="was disconnected before it answered"):
        live.send("q0.01", timeout=PATIENCE)


@pytest.mark.parametrize("line", ["x" * 63, "two\nlines", "\x00"])
def test_what_an_avr_would_lose_is_not_sent(live, line):
    with pytest.raises(BadSetting, match="at most 62 bytes"):
        live.send(line)


LOST = BadDevice("lost")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("starts", "kept_values", "counts"),
    [
        ("inside a line", [2, 3, math.nan, 21], (5, 3, 0, 2)),
        ("at a line", [2, 3, math.nan, 20, 21], (5, 4, 0, 1)),
        ("where it stopped", [2, 3, 20, 21], (5, 4, 0, 1)),
    ],
)
def test_an_opening_says_where_its_first_byte_is(starts, kept_values, counts, wait_for):
    first = ScriptedPort([b"heat,light\n", b"2,0\n3,0\n", LOST], "at a line")
    second = ScriptedPort([b"20,0\n21,0\n"], starts)
    source = LiveSource("x", reader=PortReader(PortSpec("x"), opener=scripted(first, second)))
    with source as live:
        wait_for(lambda: kept(live) >= len(kept_values))
        np.testing.assert_array_equal(live.snapshot().recording.values[:, 0], kept_values)
        status = live.status()
        assert (status.received, status.accepted, status.rejected, status.dropped) == counts


@pytest.mark.slow
def test_the_names_of_a_stream_that_begins_at_a_line_may_change_with_each_opening(wait_for):
    first = ScriptedPort([b"heat,light\n2,0\n3,0\n", LOST], "at a line")
    second = ScriptedPort([b"force,way\n4,0\n5,0\n"], "at a line")
    source = LiveSource("x", reader=PortReader(PortSpec("x"), opener=scripted(first, second)))
    with source as live:
        wait_for(lambda: live.snapshot() is not None and live.snapshot().recording.names == ("force", "way"))


@pytest.mark.slow
def test_what_the_other_side_keeps_is_never_dropped(monkeypatch, wait_for):
    monkeypatch.setattr("kalscope.sources.port.reader.MAX_WAITING_BYTES", 10_000)
    monkeypatch.setattr("kalscope.sources.port.reader._KEPT_BYTES", 5_000)
    port = ScriptedPort([lines(i, i + 100) for i in range(0, 10_000, 100)], "at a line", keeps=True)
    source = LiveSource("x", reader=PortReader(PortSpec("x"), opener=scripted(port)))
    with source as live:
        wait_for(received(live, 10_000))
        np.testing.assert_array_equal(live.snapshot().recording.values[:, 0], np.arange(10_000))
        assert live.status().overrun == 0


def test_bytes_that_a_late_close_left_out_do_not_hold_up_the_next_start(monkeypatch, wait_for):
    monkeypatch.setattr("kalscope.sources.live.source.MAX_CLOSE_S", -1.0)
    monkeypatch.setattr("kalscope.sources.port.reader._KEPT_BYTES", 500)
    first = ScriptedPort([lines(0, 1), lines(1, 201)], "at a line", keeps=True)
    second = ScriptedPort([lines(201, 301)], "at a line", keeps=True)
    live = LiveSource("x", reader=PortReader(PortSpec("x"), opener=scripted(first, second)))
    go_on, feed = threading.Event(), live._lines.feed
    monkeypatch.setattr(live._lines, "feed", lambda received: go_on.wait(PATIENCE) and feed(received))
    live.start()
    wait_for(lambda: not first.script)
    closing = threading.Thread(target=live.close)
    closing.start()
    wait_for(lambda: live._end_by < math.inf)
    go_on.set()
    closing.join()
    with live:
        wait_for(lambda: live.status().received == 301)
        assert live.status().overrun == 200
