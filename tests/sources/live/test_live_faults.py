"""What goes wrong on a desk: a second reader, no newline, a slow looker, a cable pulled while recording."""

import threading
import time
from contextlib import suppress

import numpy as np
import pytest
import serial

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
