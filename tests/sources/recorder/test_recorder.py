"""The recorder: every line in one count, every value back, whatever the disk, the clocks and the names do."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.effort import FUZZ
from tests.support.waiting import wait_until

from kalscope.errors import BadFile
from kalscope.sources import recorder as recorder_module
from kalscope.sources.grammar.line_format import LineFormat
from kalscope.sources.port.reader import Clock
from kalscope.sources.reading.columns import Column
from kalscope.sources.reading.line_parser import LineParser
from kalscope.sources.reading.line_reader import LineEvent
from kalscope.sources.reading.recording_file import read_recording
from kalscope.sources.reading.sniffer import Layout
from kalscope.sources.recorder import Recorder, RecorderCounts

STARTED = 1000.0


def new_recorder(path, now=lambda: STARTED):
    return Recorder(path, "test", clock=Clock(now, lambda: 1_763_678_912.25))


def hand_over(recorder, data, at=STARTED, step=0.001):
    """Give a stream to a recorder line by line, `step` s apart."""
    parser = LineParser()
    parser.feed(data)
    for i, event in enumerate(parser):
        recorder.write([(at + i * step, event, parser.layout)])


def layout_of(names, units=("", "")):
    return Layout(LineFormat(), tuple(map(Column, names, units)), None, 1, frozenset(), (), ())


def row(number, *values):
    return LineEvent(number, "row", "as it came", (tuple(map(float, values)),))


def data_lines(path):
    """Lines of a file that are no comments, the header left out."""
    return [line for line in path.read_text("utf-8").splitlines() if not line.startswith("#")][1:]


def test_a_recording_is_comments_a_header_and_rows_of_host_time_device_time_and_values(tmp_path):
    path = tmp_path / "run.csv"
    rows = (b"%d,%.2f,%d\n" % (7 * i, i / 8, i) for i in range(9))
    recorder = new_recorder(path)
    hand_over(recorder, b"boot\nmillis,temp [degC],light\n" + b"".join(rows))
    recorder.lose(3, "unplugged", 2.5)
    recorder.close()
    lines = path.read_text().splitlines()
    assert lines[0].startswith("# kalscope recording ")
    assert lines[1:3] == ["# source: test", "# started: 2025-11-20T22:48:32.250000Z"]
    assert lines[4:7] == ["host time [s],device time [ms],temp [degC],light", "0.002000,0,0,0", "0.003000,7,0.12,1"]
    end = "# end: received 12 lines = 9 written + 0 rejected + 3 dropped; 2 others"
    assert lines[-2:] == ["# gap unplugged 2.500 s", end]


@pytest.mark.slow
@given(st.lists(st.floats(allow_infinity=False), min_size=1, max_size=20))
def test_every_value_comes_back_bit_for_bit(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("r") / "run.csv"
    recorder = new_recorder(path)
    layout = layout_of(["a", "b"])
    recorder.write([(STARTED + i, row(i, value, 1), layout) for i, value in enumerate(values)])
    recorder.close()
    cells = [line.split(",")[1] for line in data_lines(path)]
    again = [float(cell).hex() if cell else "nan" for cell in cells if "nan" not in cell]
    assert again == [value.hex() for value in values]


HOSTILE = ["a,b", 'say "hi"', "two\nlines", "# comment", "no#mark", "5", "nan", "12:30", "2024-01-01", "a [b]"]
HOSTILE += ["force (N)", "Distance_cm", "=cmd()", " spaces ", "", "\x00\x07", "host time", "device time", "time"]
HOSTILE += ["日本 µ", "x" * 300, "'", ";\t|", "\\"]
CHANGED = {"two\nlines": "two lines", "=cmd()": "'=cmd()", " spaces ": "spaces", "": "channel"}
CHANGED |= {
    "\x00\x07": "channel 2",
    "host time": "host time 2",
    "device time": "device time 2",
    "x" * 300: "x" * 60,
    ";\t|": "; |",
}


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, len(HOSTILE), 8))
def test_hostile_names_come_back_in_our_reader_and_in_pandas(tmp_path, first):
    import pandas as pd

    names = HOSTILE[first : first + 8]
    path = tmp_path / "run.csv"
    recorder = new_recorder(path)
    layout = layout_of(names, ["V", "", "a [b]", "", "#", ",", '"', ""])
    expected = [[i * 10 + j / 4 for j in range(8)] for i in range(20)]
    recorder.write([(STARTED + i, row(i, *values), layout) for i, values in enumerate(expected)])
    recorder.close()
    recording, table = read_recording(path), pd.read_csv(path, comment="#")
    assert recording.names == tuple(CHANGED.get(name, name) for name in names)
    assert recording.units == ("V", "", "a b", "", "#", ",", '"', "")
    np.testing.assert_array_equal(recording.values, expected)
    np.testing.assert_array_equal(recording.time, np.arange(20.0))
    np.testing.assert_array_equal(table.to_numpy()[:, 1:], expected)


@pytest.mark.slow
def test_what_is_no_row_goes_into_the_rejects_with_time_number_and_reason(tmp_path):
    import pandas as pd

    recorder = new_recorder(tmp_path / "run.csv")
    hand_over(recorder, b"a,b\n1,2\n3,4\n5\n6,x\n\x07,1\nreset \\ caf\xc3\xa9\n\n7,8\n")
    counts = recorder.close()
    rejects = pd.read_csv(tmp_path / "run.rejects", comment="#", keep_default_na=False)
    assert rejects.columns.to_list() == ["host time [s]", "line", "column", "reason", "text"]
    table = [tuple(line) for line in rejects[["line", "column", "text"]].to_numpy()]
    assert table == [(1, "", "a,b"), (4, "", "5"), (5, "b", "6,x"), (6, "", "\\x07,1"), (7, "", "reset \\\\ café")]
    assert rejects["host time [s]"].to_list() == [0.0, 0.003, 0.004, 0.005, 0.006]
    assert data_lines(tmp_path / "run.csv") == ["0.001000,1,2", "0.002000,3,4", "0.004000,6,", "0.008000,7,8"]
    assert counts == RecorderCounts(received=7, written=4, rejected=3, other=2)


def test_other_columns_begin_a_new_part_with_the_same_host_time(tmp_path):
    path = tmp_path / "run.csv"
    (tmp_path / "run-2.csv").write_text("mine")
    recorder = new_recorder(path)
    hand_over(recorder, b"a:1\na:2\n")
    hand_over(recorder, b"a:3 b:4\n", at=STARTED + 5)
    assert recorder.close().written == 3
    assert recorder.paths == (path, tmp_path / "run-3.csv")
    assert data_lines(path) == ["0.000000,1", "0.001000,2"]
    assert path.read_text().endswith("# continued in run-3.csv: the columns changed\n")
    assert data_lines(tmp_path / "run-3.csv") == ["5.000000,3,4"]


def test_a_recording_is_never_overwritten_and_a_free_name_is_proposed(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("mine")
    (tmp_path / "run_2.csv").write_text("mine too")
    (tmp_path / "run_3.rejects").write_text("of another recording")
    with pytest.raises(BadFile, match=r"such as 'run_4.csv'"):
        new_recorder(path)
    assert path.read_text() == "mine"


def test_where_no_file_can_be_written_that_is_said_at_once(tmp_path):
    (tmp_path / "file").write_text("")
    for name in ("file/run.csv", "missing/run.csv", "nul\0.csv"):
        with pytest.raises(BadFile, match="cannot write the recording"):
            new_recorder(tmp_path / name)


class FullDisk:
    """os.write for a disk with `room` bytes: what fits is written, then the error."""

    def __init__(self, room):
        self.room, self.write = room, os.write

    def __call__(self, fd, data):
        if self.room <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        count = self.write(fd, bytes(data)[: self.room])
        self.room -= count
        return count


@pytest.mark.slow
def test_at_whatever_byte_the_disk_is_full_no_line_is_torn_and_later_ones_come(tmp_path, monkeypatch):
    stream = b"".join(b"%d,%.1f\n" % (i, i / 2) for i in range(6))
    hand_over(whole := new_recorder(tmp_path / "whole.csv"), stream)
    size = len((tmp_path / "whole.csv").read_bytes())
    whole.close()
    full = data_lines(tmp_path / "whole.csv")
    for room in (*range(0, size, 1 if FUZZ > 1 else 3), size):
        path, now = tmp_path / f"{room}.csv", [STARTED]
        with monkeypatch.context() as patch:
            patch.setattr(recorder_module.os, "write", disk := FullDisk(room))
            recorder = new_recorder(path, lambda now=now: now[0])
            hand_over(recorder, stream)
            assert bool(recorder.error) == (room < size)
            assert path.read_bytes()[-1:] in (b"", b"\n")
            assert recorder.counts.written + recorder.counts.unwritable == 6
            disk.room = 1_000_000
            now[0] += 1.0
            lost = recorder.counts.unwritable
            hand_over(recorder, b"6,3\n", at=now[0])
            assert recorder.error == ""
            assert recorder.close() == RecorderCounts(7, 7 - lost, 0, lost, lost)
        assert data_lines(path) == [*full[: 6 - lost], "1.000000,6,3"]
        assert (f"# gap disk 1.000 s ({lost} lines dropped)\n" in path.read_text()) == (room < size)


@pytest.mark.skipif(os.name == "nt", reason="Windows deletes no open file")
def test_a_file_that_another_program_cuts_or_deletes_is_an_error_at_the_next_write(tmp_path):
    for name, change in (("cut", lambda path: os.truncate(path, 9)), ("deleted", Path.unlink)):
        recorder = new_recorder(tmp_path / f"{name}.csv")
        hand_over(recorder, b"a,b\n1,2\n")
        change(recorder.path)
        recorder.write([])
        assert recorder.error == f"{name}.csv was deleted or cut short by another program: record to a new file"
        recorder.close()


def test_a_disk_that_does_not_confirm_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "_fdatasync", Mock(side_effect=OSError(errno.EIO, "Input/output error")))
    monkeypatch.setattr(recorder_module, "SYNC_EVERY_S", 0.01)
    recorder = new_recorder(tmp_path / "run.csv")
    wait_until(lambda: "Input/output error" in recorder.error, "the word that the disk does not confirm")
    recorder.close()


ROWS = [(round(i / 7, 4), i * 997 % 10_000, -i / 16) for i in range(12)]
SETTLED = 6
"""Rows after which the reader knows the columns of a prefix."""


@pytest.mark.slow
@pytest.mark.parametrize("tail", [b"", b"\0" * 512], ids=["cut", "zeros"])
def test_a_recording_cut_at_any_byte_is_read_without_a_wrong_value(tmp_path, tail):
    """A program that is killed may leave half a line; a power cut may leave zeros after it."""
    path = tmp_path / "run.csv"
    recorder = new_recorder(path)
    for i, values in enumerate(ROWS):
        hand_over(recorder, (",".join(map(repr, values)) + "\n").encode(), at=STARTED + i / 100)
    recorder.lose(0, "unplugged", 2.5)
    recorder.close()
    recorded = path.read_bytes()
    first = next(i for i in range(len(recorded)) if recorded[:i].count(b"\n") == 5 + SETTLED)
    for cut in (*range(first, len(recorded), 1 if FUZZ > 1 else 3), len(recorded)):
        path.write_bytes(recorded[:cut] + tail)
        recording = read_recording(path)
        n = len(recording)
        assert n >= SETTLED
        np.testing.assert_array_equal(recording.values, np.array(ROWS, dtype=float)[:n])
        np.testing.assert_array_equal(recording.time, [round(i / 100, 6) for i in range(n)])
