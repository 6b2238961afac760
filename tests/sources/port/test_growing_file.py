"""A file that another program still writes: whole lines, replaced files, and times that are its own."""

import os

import numpy as np
import pytest
from tests.sources.scripted_port import kept

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port.far_side import GrowingFile
from kalscope.sources.reading.recording_file import read_recording

pytestmark = pytest.mark.usefixtures("no_thread_left")


@pytest.fixture
def log(tmp_path):
    return tmp_path / "log.csv"


def add(path, text):
    with path.open("a") as file:
        file.write(text)


def test_a_file_that_was_moved_is_read_to_its_end(log):
    log.write_text("a\n")
    file = GrowingFile(str(log))
    file.read()
    moved = log.rename(log.with_suffix(".1"))
    assert file.read() == b""
    add(moved, "b\n")
    assert file.read() == b"b\n"
    file.close()


def test_what_is_no_file_is_refused_and_a_fifo_holds_up_nobody(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for name, why in (("none", "No such"), ("fifo", "must be a file"), (".", "must be a file"), ("\0", "null")):
        with pytest.raises((OSError, ValueError), match=why):
            GrowingFile(str(tmp_path / name))
        with pytest.raises((BadDevice, BadSetting)):
            LiveSource(f"file:{tmp_path / name}").start(require=True)


RECORDED = """# kalscope recording 0.1.0
# source: serial:/dev/ttyACM0@115200
# started: 2026-11-21T10:46:04.123456Z
# host time: s since the start, by this computer's monotonic clock; the rest as the board sent it
host time [s],device time [ms],temp [°C],light
"""


@pytest.mark.slow
@pytest.mark.parametrize(("head", "row", "options"), [
    *((RECORDED, "{:.6f},{},{},7\n", {}), ("millis,heat\n", "{1},{2}\n", {})),
    *(("t,heat\n", "{1},{2}\n", {"time_unit": "ms"}), ("heat;light\n", "{2},5;1,5\n", {})),
    ("heat,light\n", "{2},1.5\n", {"rate": 50.0}), ("time,heat\n", "2026-11-21 10:46:{0:09.6f},{2}\n", {}),
])  # fmt: skip
def test_a_followed_file_is_what_it_is_when_it_is_opened(log, wait_for, head, row, options):
    ticks = [20 * i + (40_000 if i >= 500 else 0) for i in range(900)]  # the board was unplugged for 40 s
    rows = [row.format(tick / 1000, tick, i % 50) for i, tick in enumerate(ticks)]
    log.write_text(head + "".join(rows[:800]))
    with LiveSource(f"file:{log}", ReadOptions(**options)) as live:
        wait_for(lambda: kept(live) == 800)
        add(log, "".join(rows[800:]))
        wait_for(lambda: kept(live) == 900)
        seen, whole = live.snapshot().recording, read_recording(str(log), ReadOptions(**options))
    assert (seen.names, seen.units) == (whole.names, whole.units)
    np.testing.assert_array_equal(seen.values, whole.values)
    np.testing.assert_allclose(seen.time - seen.time[0], whole.time - whole.time[0], atol=1e-6)
    assert live.status().rejected == 0


@pytest.mark.slow
@pytest.mark.parametrize("is_moved", [False, True])
def test_a_replaced_file_is_a_gap_and_its_new_lines_follow(log, wait_for, is_moved):
    log.write_text("t [s],heat\n0,1\n0.1,2\n0.2,")
    with LiveSource(f"file:{log}") as live:
        wait_for(lambda: kept(live) == 2)
        if is_moved:
            log.rename(log.with_suffix(".1"))
        log.write_text("t [s],heat\n0,3\n0.1,4\n0.2")
        wait_for(lambda: kept(live) == 5)
        live.close()
        live.start()
        add(log, ",5\n")  # the half of a line that was read before is completed
        wait_for(lambda: kept(live) == 6)
        recording = live.snapshot().recording
        np.testing.assert_array_equal(recording.values[:, 0], [1, 2, np.nan, 3, 4, 5])
        assert (np.diff(recording.time) > 0).all()
        status = live.status()
        assert (status.received, status.accepted, status.rejected, status.dropped) == (8, 5, 0, 3)
        with pytest.raises(BadDevice, match="nothing can be sent there: it is only read"):
            live.send("q1")
