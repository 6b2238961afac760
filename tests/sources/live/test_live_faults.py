"""What goes wrong on a desk: a second reader, no newline, a slow looker, a cable pulled while recording."""

import threading
import time
from contextlib import suppress

import numpy as np
import pytest
import serial
from waiting import PATIENCE

from kalscope.sources.live import lines
from kalscope.sources.reading.recording_file import read_recording

pytestmark = pytest.mark.usefixtures("no_thread_left")


def numbered(begin, end):
    return b"".join(b"%d,%d\n" % (i, 2 * i) for i in range(begin, end))


def accepted(live, count):
    return lambda: live.status().accepted >= count


def test_a_second_reader_steals_lines_but_no_wrong_value_is_made_of_the_rest(board, live, wait_for):
    with serial.Serial(board.link, timeout=0.01) as thief:
        stop = threading.Event()

        def steal():
            while not stop.is_set():
                with suppress(serial.SerialException):  # what each of two readers meets
                    thief.read(7)

        thread = threading.Thread(target=steal)
        thread.start()
        board.say(b"x\n")
        for i in range(0, 3000, 100):
            board.say(b"".join(b"a:%d,b:%d*%02X\n" % (n, 2 * n, checksum(n)) for n in range(i, i + 100)))
            time.sleep(0.002)
        stop.set()
        thread.join()
    before = live.status().accepted
    while live.status().accepted < before + 10:  # it may just be opening the port again
        board.say(b"a:1,b:2*%02X\n" % checksum(1))
        time.sleep(0.02)
    recording = live.snapshot().recording
    values = recording.values[np.isfinite(recording.values).all(axis=1)]
    a, b = (values[:, recording.index(name)] for name in "ab")  # either label may have been seen first
    np.testing.assert_array_equal(b, 2 * a)
    status = live.status()
    assert status.received == status.accepted + status.rejected + status.dropped


def checksum(n):
    total = 0
    for byte in b"a:%d,b:%d" % (n, 2 * n):
        total ^= byte
    return total


def test_a_megabyte_without_a_newline_is_one_line_that_is_dropped_as_it_comes(board, live, wait_for):
    board.say(b"x\n" + numbered(0, 100))
    wait_for(accepted(live, 100))
    time.sleep(2.1)
    sender = threading.Thread(target=board.say, args=(b"5" * 1_000_000 + b"\n" + numbered(100, 200),))
    sender.start()
    wait_for(accepted(live, 200))
    sender.join()
    status = live.status()
    assert (status.accepted, status.rejected, status.received) == (200, 1, 202)
    np.testing.assert_array_equal(live.snapshot().recording.values[:, 0], np.arange(200))


def test_a_slow_reader_of_snapshots_loses_nothing(board, live, wait_for, monkeypatch):
    # A sender that stalls inside a line looks, soon after the opening, like a board that was reset there.
    monkeypatch.setattr(lines, "_SILENCE", 60.0)
    board.say(b"x\n")
    sender = threading.Thread(target=board.say, args=(numbered(0, 10_000),))
    sender.start()
    held = []

    def look():
        snapshot = live.snapshot()
        if snapshot is not None:
            held.append(snapshot)
            sum(range(300_000))  # a busy reader holds the interpreter
        return snapshot is not None and len(snapshot.recording) >= 10_000

    wait_for(look, "the last line")
    sender.join()
    for snapshot in held:
        count = len(snapshot.recording)
        np.testing.assert_array_equal(snapshot.recording.values[:, 0], np.arange(count))


def test_a_recording_goes_on_in_the_same_file_when_the_board_is_back(board, live, wait_for, tmp_path):
    path = tmp_path / "bench.csv"
    live.record(path)
    board.say(b"x\nheat,light\n" + numbered(0, 500))
    wait_for(accepted(live, 500))
    board.unplug()
    wait_for(lambda: live.status().word == "disconnected, waiting")
    board.plug()
    wait_for(lambda: live.status().word == "connected")
    board.say(b"7\n" + numbered(500, 1000))
    wait_for(accepted(live, 1000))
    status = live.status()
    live.close()
    assert live.recorder is None
    assert status.recording.error == ""
    assert [line.split()[:3] for line in path.read_text().splitlines() if line.startswith("# gap")] != []
    recording = read_recording(path)
    numbers = recording.channel("heat")
    np.testing.assert_array_equal(numbers[np.isfinite(numbers)], np.arange(1000))
    assert (np.diff(recording.time) >= 0).all()


def test_a_port_closed_in_the_middle_of_the_stream_is_free_at_once(board, live, wait_for):
    stop = threading.Event()

    def stream():
        while not stop.is_set():
            board.say(numbered(0, 10))

    sender = threading.Thread(target=stream)
    sender.start()
    wait_for(accepted(live, 100))
    live.close()
    with serial.Serial(board.link, exclusive=True, timeout=PATIENCE) as second:
        came = second.read(100)
        stop.set()
        second.timeout = 0.05
        while sender.is_alive():
            second.read(4096)  # else it would wait for ever for room
    sender.join()
    status = live.status()
    assert len(came) == 100
    assert status.received == status.accepted + status.rejected + status.dropped
