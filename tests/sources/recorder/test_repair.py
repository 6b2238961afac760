"""Repair: whatever a crash or a power cut left, whole lines stay, nothing is invented, nothing is thrown away."""

from __future__ import annotations

import numpy as np
import pytest
from effort import FUZZ

from kalscope.errors import BadFile
from kalscope.sources.port.reader import Clock
from kalscope.sources.reading.line_parser import LineParser
from kalscope.sources.reading.recording_file import read_recording
from kalscope.sources.recorder import Recorder, repair

ROWS = [(round(i / 7, 4), i * 997 % 10_000, -i / 16) for i in range(12)]
STEP = 1 if FUZZ > 1 else 3
"""Bytes between two cuts; `make soak` cuts at each one."""
SETTLED = 6
"""Rows after which the reader knows the columns of a prefix."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The bytes of a recording of ROWS, with a gap in it and its account at the end."""
    path = tmp_path_factory.mktemp("recorded") / "run.csv"
    recorder = Recorder(path, "serial:/dev/ttyACM0", clock=Clock(lambda: 0.0, lambda: 1.7e9))
    parser = LineParser()
    for i, row in enumerate(ROWS):
        parser.feed((",".join(map(repr, row)) + "\n").encode())
        recorder.write([(i / 100, event, parser.layout) for event in parser])
        if i == 8:
            recorder.lose(0, "unplugged", 2.5)
    recorder.close()
    return path.read_bytes()


def values_in(content: bytes) -> list[tuple[float, ...]]:
    """The rows of a repaired recording, as any program would read them."""
    lines = [line for line in content.decode().splitlines() if not line.startswith("#")]
    return [tuple(float(cell) for cell in line.split(",")[1:]) for line in lines[1:]]


TAILS = [b"", b"\0" * 512, b"\0" * 7 + b"0.25,1,2,3\n# end\n"]


@pytest.mark.slow
@pytest.mark.parametrize("tail", TAILS, ids=["cut", "zeros", "zeros and old bytes"])
def test_cut_at_any_byte_a_repaired_recording_holds_the_first_rows_and_nothing_else(tmp_path, recorded, tail):
    for cut in (*range(0, len(recorded), STEP), len(recorded)):
        path = tmp_path / f"{cut}.csv"
        path.write_bytes(recorded[:cut] + tail)
        torn = repair(path)
        content = path.read_bytes()
        assert recorded.startswith(content)
        assert content == recorded[: recorded.rfind(b"\n", 0, cut) + 1]
        rows = values_in(content)
        assert rows == [tuple(map(float, row)) for row in ROWS[: len(rows)]]
        moved = path.with_suffix(".torn").read_bytes() if torn else b"\n"
        assert content + moved[:-1] == recorded[:cut] + tail
        assert torn == cut + len(tail) - len(content)


@pytest.mark.slow
def test_our_reader_takes_no_wrong_value_from_a_recording_cut_at_any_byte(tmp_path, recorded):
    path = tmp_path / "run.csv"
    first = next(i for i in range(len(recorded)) if recorded[:i].count(b"\n") == 5 + SETTLED)
    for cut in (*range(first, len(recorded), STEP), len(recorded)):
        path.write_bytes(recorded[:cut])
        recording = read_recording(path)
        n = len(recording)
        assert n >= SETTLED
        np.testing.assert_array_equal(recording.values, np.array(ROWS, dtype=float)[:n])
        np.testing.assert_array_equal(recording.time, [round(i / 100, 6) for i in range(n)])


@pytest.mark.slow
def test_cut_at_any_byte_a_recording_can_be_resumed(tmp_path, recorded):
    for cut in (*range(0, len(recorded), 3 * STEP), len(recorded)):
        path = tmp_path / f"{cut}.csv"
        path.write_bytes(recorded[:cut])
        recorder = Recorder(path, "again", resume=True, clock=Clock(lambda: 0.0, lambda: 1.7e9 + 60.0))
        parser = LineParser()
        parser.feed(b"77.5,78,79.25\n")
        recorder.write([(0.0, event, parser.layout) for event in parser])
        assert recorder.close().written == 1
        before = values_in(recorded[: recorded.rfind(b"\n", 0, cut) + 1])
        assert values_in(path.read_bytes()) == [*before, (77.5, 78.0, 79.25)]


def test_the_rejected_lines_have_a_torn_file_of_their_own(tmp_path):
    path = tmp_path / "run.rejects"
    path.write_bytes(b"# kalscope rejects 1\nhost time [s],line\n0.1,2\n0.2")
    assert repair(path) == 3
    assert (tmp_path / "run.rejects.torn").read_bytes() == b"0.2\n"
    assert path.read_bytes().endswith(b"0.1,2\n")


def test_where_the_tail_cannot_be_kept_nothing_is_cut(tmp_path, recorded):
    path = tmp_path / "run.csv"
    path.write_bytes(recorded[:-5])
    (tmp_path / "run.torn").mkdir()
    with pytest.raises(BadFile, match="cannot repair"):
        repair(path)
    assert path.read_bytes() == recorded[:-5]
