"""Blocks of plain rows against the line reader: the same values, the same account, for whatever bytes."""

import threading

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tests.sources.both_ways import assert_same_by_line

from kalscope.errors import Cancelled
from kalscope.sources.reading import rows as csv_rows
from kalscope.sources.reading.line_reader import LineReader
from kalscope.sources.reading.recording_file import read_recording

pytestmark = pytest.mark.slow

LINES = st.lists(st.text('0123456789+-.eE,;|\t nai_x"*#', max_size=20), min_size=1, max_size=4)


@given(LINES, st.integers(1, 4), st.sampled_from([d + m for d in ",;\t| " for m in ".," if d != m]))
@example(["1,2,NA", "1,2,1e999", "1,2,1_0", "1,2,\x1c3", "", ",,", '1,"2",3'], 3, ",.")
@example(["1.5,-2e-3,+.5", "1, 2 ,3", "1,,", "1,-NaN,3,", "1,2,3,4", "1,2,3,,"], 3, ",.")
def test_whatever_a_line_holds_is_the_same_to_both(tmp_path_factory, lines, width, marks):
    path, (delimiter, decimal) = tmp_path_factory.getbasetemp() / "lines.csv", marks
    plain = delimiter.join([f"{i}{decimal}25" for i in range(width)])
    path.write_text("\n".join([*[plain] * 9, *lines, *[plain] * 9, ""]))
    assert_same_by_line(path)


digits = (st.integers(2**53, 10**18) | st.integers(0, 10**25)).map(str)
tens = st.one_of(st.just(""), st.integers(-75, 75).map("e{}".format))


@given(st.sampled_from(["", "-", "+"]), digits, st.integers(0, 30), tens)
@example("", "9007199254740993", 0, "")  # between two float64, to the even one
@example("", "9007199254740995", 3, "")  # not the quotient of the nearest float64
@example("", "5", 0, "e-324")
@example("", "179769313486231580793728971405301", 0, "e60")
@example("-", "0", 3, "")
def test_every_number_is_the_nearest_float(tmp_path_factory, sign, whole, places, exponent):
    whole = whole.rjust(places + 1, "0")
    text = sign + (f"{whole[:-places]}.{whole[-places:]}" if places else whole) + exponent
    path = tmp_path_factory.getbasetemp() / "number.csv"
    path.write_text(f"a;b\n1.5;2\n2.5;3\n{text};1\n")
    number = float(text)
    np.testing.assert_equal(assert_same_by_line(path).channel("a")[-1], np.nan if np.isinf(number) else number)


def test_thousands_of_lines_in_many_blocks_are_the_same_to_both(tmp_path, monkeypatch):
    by_line, read_line = [], LineReader.read
    monkeypatch.setattr(LineReader, "read", lambda self, *line: by_line.append(line) or read_line(self, *line))
    monkeypatch.setattr(csv_rows, "BLOCK_SIZE", 1 << 14)
    rng = np.random.default_rng(3)
    lines = [f"{i / 1000:.3f},{x:.6f},{y:.6f}\n" for i, (x, y) in enumerate(rng.normal(size=(8_000, 2)))]
    for i in rng.choice(len(lines), 100, replace=False):
        lines[i] = rng.choice(["\n", "x,1,2\n", "1,2\n", "5,1,2,3\n", "6,ERR,1\n", "# c\n", "7,,\n"])
    path = tmp_path / "log.csv"
    path.write_text("t,a,b\n" + "".join(lines))
    with monkeypatch.context() as patch:
        patch.setattr(csv_rows, "MAX_BYTES_BY_LINE", 0)
        read_recording(path)
    assert 0 < len(by_line) < 100
    assert_same_by_line(path)


def test_progress_rises_to_the_end_and_a_cancelled_reading_leaves_no_thread(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,a\n" + "".join(f"{i / 100:.2f},{i % 977}.25\n" for i in range(400_000)))
    done, before, asked = [], threading.active_count(), iter([False, False])
    read_recording(path, progress=lambda fraction, _: done.append(fraction))
    assert len(done) > 3
    assert [0, *done, 1] == sorted([0, *done, 1])
    with pytest.raises(Cancelled, match="cancelled"):
        read_recording(path, cancelled=lambda: next(asked, True))
    assert threading.active_count() == before
