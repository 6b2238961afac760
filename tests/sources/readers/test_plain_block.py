"""Blocks of plain rows against the line reader: the same values, the same account, for whatever bytes."""

import threading

import numpy as np
import pytest
from each import each
from hypothesis import example, given
from hypothesis import strategies as st
from raw_bytes import damaged

from kalscope.errors import BadFile, Cancelled, KalscopeError
from kalscope.sources.grammar.cells import parse_number, split_fields
from kalscope.sources.grammar.line_format import LineFormat
from kalscope.sources.grammar.read_options import DEFAULTS
from kalscope.sources.reading import rows as csv_rows
from kalscope.sources.reading.columns import Column
from kalscope.sources.reading.kernels import EXACT, MAX_PLAIN_TENS, divided
from kalscope.sources.reading.recording_file import read_recording
from kalscope.sources.reading.rows import BlockParser, block_parser
from kalscope.sources.reading.sniffer import Layout

CLEAN = "t,a,b\n" + "".join(f"{0.01 * i:.2f},{20 + 0.37 * i:.4f},{-3 + 0.01 * i * i:.3f}\n" for i in range(40))
UNTIMED = "a;b\n" + "".join(f"{i * 7 % 11};{i * 0.5}\n" for i in range(40))
SEEDS = {
    "commas": CLEAN,
    "blanks after commas": CLEAN.replace(",", ", "),
    "tabs": CLEAN.replace(",", "\t"),
    "returns": CLEAN.replace("\n", "\r\n"),
    "preamble": f"# c\n\nboot\n{CLEAN}",
    "bom": f"\ufeff{CLEAN}",
    "bom without header": "\ufeff" + CLEAN.partition("\n")[2],
    "degrees": CLEAN.replace("a,", "a [°C],", 1),
    "untimed": UNTIMED,
    "one column": "".join(f"{i * 7 % 11 + 0.5}\n" for i in range(40)),
    "trailing delimiters": CLEAN.replace("\n", ",,\n"),
    "missing": CLEAN.replace("20.3700", "nan").replace("21.1100", "").replace("22.2200", "-NaN"),
}


@pytest.fixture(scope="module", autouse=True)
def _blocks_of_any_size():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(csv_rows, "MAX_BYTES_BY_LINE", 0)
        yield


@pytest.fixture
def taken(monkeypatch):
    """The number of lines in each plain block."""
    blocks = []

    class Spy(BlockParser):
        def parse(self, data, at, end):
            rows, stop = super().parse(data, at, end)
            blocks.extend([len(rows)] if len(rows) else [])
            return rows, stop

    monkeypatch.setattr(csv_rows, "BlockParser", Spy)
    return blocks


def parsed(layout, lines):
    """The rows of the lines before the first one that is not plain."""
    data = "".join(lines).encode()
    parse = block_parser(layout, DEFAULTS)
    assert parse is not None
    rows, end = parse.parse(data, 0, len(data))
    assert end == sum(len(line.encode()) for line in lines[: len(rows)])
    return rows.tolist()


def reading(path, options):
    """What is read; an error as its type and text."""
    try:
        return read_recording(path, options)
    except KalscopeError as error:
        return type(error), str(error)


def assert_same(path, options=DEFAULTS):
    fast = reading(path, options)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(csv_rows, "block_parser", lambda *_: None)
        slow = reading(path, options)
    if isinstance(slow, tuple) or isinstance(fast, tuple):
        assert fast == slow
        return
    assert fast.report == slow.report
    assert (fast.names, fast.units, fast.sample_period) == (slow.names, slow.units, slow.sample_period)
    assert (fast.sha256, fast.source, fast.title) == (slow.sha256, slow.source, slow.title)
    np.testing.assert_array_equal(fast.time, slow.time)
    np.testing.assert_array_equal(fast.values, slow.values)


@pytest.mark.slow
@each("name", SEEDS)
def test_plain_tables_are_one_block_and_are_the_same(tmp_path, taken, name):
    taken.clear()
    path = tmp_path / "log.csv"
    path.write_bytes(SEEDS[name].encode())
    assert_same(path)
    assert taken == [40]


FORMATS = [LineFormat("table", d, m) for d in ",;\t| " for m in ".," if d != m]


cells_and_marks = st.text("0123456789+-.eE,;|\t nai_x", max_size=20)


@given(st.lists(cells_and_marks, min_size=1, max_size=3), st.sampled_from(FORMATS))
def test_a_block_holds_what_the_cells_hold(texts, form):
    width = max(1, len(split_fields(texts[0], form.delimiter)))
    layout = Layout(form, (Column("a"),) * width, None, 1, frozenset(), (), ())
    lines = [f"{text}\n" for text in texts]
    rows = parsed(layout, lines)
    is_plain = [len(parsed(layout, [line])) == 1 for line in lines]
    assert len(rows) == [*is_plain, False].index(False)
    cells = [split_fields(text, form.delimiter)[:width] for text in texts[: len(rows)]]
    expected = [[parse_number(cell, form.decimal) for cell in row] for row in cells]
    np.testing.assert_array_equal(np.array(rows, dtype=float), np.array(expected, dtype=float))


def three_columns():
    return Layout(LineFormat(), (Column("a"),) * 3, None, 1, frozenset(), (), ())


@each("line", ["1,2\n", "1,2,NA\n", "1,2,1e999\n", "1,2,1_0\n", "1,2,\x1c3\n", "\n", ",,\n", '1,"2",3\n'])
def test_what_is_not_plain_is_left_to_the_line_reader(line):
    plain = ["1.5,-2e-3,+.5\n", "1, 2 ,3\n", "1,,\n", "1,-NaN,3,\n"]
    assert len(parsed(three_columns(), [*plain, line, *plain])) == 4
    assert parsed(three_columns(), [line]) == []


digits = st.integers(0, 10**25).map(str)
tens = st.one_of(st.just(""), st.integers(-75, 75).map("e{}".format))


@given(st.sampled_from(["", "-", "+"]), digits, st.integers(0, 30), tens)
@example("", "9007199254740993", 0, "")  # between two float64, to the even one
@example("", "5", 0, "e-324")
@example("", "179769313486231580793728971405301", 0, "e60")
@example("-", "0", 3, "")
def test_every_number_is_the_nearest_float(sign, whole, places, exponent):
    whole = whole.rjust(places + 1, "0")
    text = sign + (f"{whole[:-places]}.{whole[-places:]}" if places else whole) + exponent
    rows = parsed(three_columns(), [f"{text},1,\n"])
    assert rows == [] or rows[0][0] == float(text)
    assert rows or exponent or len(text) > 60


@given(st.integers(1, 2**53), st.integers(0, MAX_PLAIN_TENS))
def test_what_lies_between_two_floats_is_rounded_as_python_does(half, tens):
    for digits in (2 * half + 1, min(1024 * half + 512, 10**18), 128 * half + 63):
        value, how = divided(min(digits, 10**18), tens)
        assert how != EXACT or value == float(f"{min(digits, 10**18)}e-{tens}")


def test_the_columns_that_are_left_out_may_hold_text(tmp_path, taken):
    path = tmp_path / "log.csv"
    path.write_text("t,state,a,note\n" + "".join(f"{i},ok {i},{i / 8},up\n" for i in range(30)) + "30,o*k,1,up\n")
    assert_same(path)
    assert sum(taken) == 30
    assert read_recording(path).names == ("a",)


DAMAGE = [
    b"\n",
    b"\n\n",
    b"\n \n",
    b",,\n",
    b"1e999\n",
    b"0.5,1e400,2\n",
    b"5\n",
    b"1,2,3,4\n",
    b"# x\n",
    b"t,a,b\n",
    b"0.1,2,ERR\n",
    b"nan",
    b"-nan",
    b"nanN",
    b"inf",
    b"1_0",
    b"e5",
    b"E",
    b"-",
    b"+",
    b".",
    b" ",
    b"3 4",
    b'"',
    b"\x00",
    b"\xff",
    b"\xc2\xb5",
    b"\r",
    b"\r\n",
    b"9" * 400,
]
change = st.one_of(
    st.tuples(st.just("flip"), st.integers(0, 900), st.integers(0, 255)),
    st.tuples(st.just("cut"), st.integers(0, 900), st.integers(0, 30)),
    st.tuples(st.just("end"), st.integers(0, 900), st.just(0)),
    st.tuples(st.just("insert"), st.integers(0, 900), st.sampled_from(DAMAGE)),
    st.tuples(st.just("line"), st.integers(0, 900), st.sampled_from(DAMAGE)),
)


@pytest.mark.slow
@given(st.sampled_from(sorted(SEEDS)), st.lists(change, min_size=1, max_size=4))
def test_damage_is_the_same_to_both(tmp_path_factory, name, changes):
    path = tmp_path_factory.getbasetemp() / "damaged.csv"
    path.write_bytes(damaged(SEEDS[name].encode(), changes))
    assert_same(path)


@pytest.mark.slow
def test_thousands_of_lines_in_many_blocks_are_the_same_to_both(tmp_path, taken, monkeypatch):
    monkeypatch.setattr(csv_rows, "BLOCK_SIZE", 1 << 14)
    rng = np.random.default_rng(3)
    lines = [f"{i / 1000:.3f},{x:.6f},{y:.6f}\n" for i, (x, y) in enumerate(rng.normal(size=(8_000, 2)))]
    for i in rng.choice(len(lines), 100, replace=False):
        lines[i] = rng.choice(["\n", "x,1,2\n", "1,2\n", "5,1,2,3\n", "6,ERR,1\n", "# c\n", "7,,\n"])
    path = tmp_path / "log.csv"
    path.write_text("t,a,b\n" + "".join(lines))
    assert path.stat().st_size > 5 * csv_rows.BLOCK_SIZE
    assert_same(path)
    assert sum(taken) >= 7_850


@pytest.mark.parametrize("keep", [5, 20, -1])
def test_a_cut_zstandard_archive_is_refused(tmp_path, keep):
    zstandard = pytest.importorskip("zstandard")
    path = tmp_path / "log.zst"
    path.write_bytes(zstandard.compress(CLEAN.encode() * 50)[:keep])
    with pytest.raises(BadFile, match="read as a Zstandard"):
        read_recording(path)


# Progress and cancel.


@pytest.fixture(scope="module")
def long_log(tmp_path_factory):
    path = tmp_path_factory.mktemp("long") / "log.csv"
    path.write_text("t,a\n" + "".join(f"{i / 100:.2f},{i % 977}.25\n" for i in range(400_000)))
    return path


@pytest.mark.slow
def test_progress_rises_to_the_end(long_log):
    seen = []
    read_recording(long_log, progress=lambda fraction, text: seen.append((fraction, text)))
    fractions = [fraction for fraction, _ in seen]
    assert len(fractions) > 3
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] <= fractions[-1] <= 1
    assert {text for _, text in seen} == {"reading"}


@pytest.mark.slow
def test_reading_can_be_cancelled_and_leaves_no_thread(long_log):
    before, asked = threading.active_count(), []

    def cancelled():
        asked.append(True)
        return len(asked) > 2

    with pytest.raises(Cancelled, match="cancelled"):
        read_recording(long_log, cancelled=cancelled)
    assert threading.active_count() == before
