"""Damaged files and logs in random dialects, always the same ones: nothing is invented, nothing is lost.

100 files and 50 logs in the ordinary run; `make soak` reads thousands. `make_case(seed)` writes a log again.
"""

import codecs
import random
import re
import threading
import time
from contextlib import suppress
from itertools import islice, product

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tests.sources.dialects import judge, make_case
from tests.support.effort import FUZZ

from kalscope.errors import BadFile, Cancelled, KalscopeError
from kalscope.sources.reading import rows as csv_rows
from kalscope.sources.reading.line_parser import LineParser
from kalscope.sources.reading.line_reader import LineReader
from kalscope.sources.reading.recording_file import read_recording


def assert_same_by_line(path):
    """The recording of a file, or the error that it raises, if it is the same both ways."""
    read = []
    for limit in (0, 1 << 40):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(csv_rows, "MAX_BYTES_BY_LINE", limit)
            try:
                read.append(read_recording(path))
            except KalscopeError as error:
                read.append(error)
    fast, slow = read
    if isinstance(fast, KalscopeError):
        assert (type(fast), str(fast)) == (type(slow), str(slow))
    else:
        for name in ("report", "names", "units", "sample_period"):
            assert getattr(fast, name) == getattr(slow, name), name
        np.testing.assert_array_equal(fast.time, slow.time)
        np.testing.assert_array_equal(fast.values, slow.values)
    return fast


def decoded(data):
    """The text of these bytes: UTF-16 where they say so, else UTF-8, else Latin-1."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", "replace")
    if data.startswith(codecs.BOM_UTF8):
        return data.decode("utf-8-sig", "replace")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


pytestmark = pytest.mark.slow

COUNT = 100 if FUZZ == 1 else 400 * FUZZ

CLEAN = "t,a,b\n" + "".join(f"{0.01 * i:.2f},{20 + 0.37 * i:.4f},{-3 + 0.01 * i * i:.3f}\n" for i in range(25))
SEEDS = [
    *(CLEAN.encode(), CLEAN.encode("utf-16"), CLEAN.replace(",", ";").replace(".", ",").encode()),
    b"boot v1.2\n" + "".join(f"a:{i},b:{2 * i}\n" for i in range(20)).encode(),
    "".join(f"12:00:{i:02}.5 -> {i}.25\n" for i in range(20)).encode(),
    ("timestamp,x [µm]\n" + "".join(f"2026-01-01 00:00:{i:02},{i * 1.5}\n" for i in range(20))).encode("latin-1"),
    ("Date;Time;T\n" + "".join(f"10/03/2004;{i:02}.00.00;{i},5\n" for i in range(20))).encode(),
    "".join(f"{i * 7 % 5}\n" for i in range(25)).encode(),
    "".join(f">x:{10 * i}:{i % 7}§V\n>y:{10 * i}:{i % 5}\n" for i in range(12)).encode(),
    *("".join(f"{i} {i / 4} {i % 3}\r\n" for i in range(20)).encode(), b"1,2*2F\n3,4*2B\n5,6*2F\n" * 8),
]
SCRAPS = [b"\n", b"\r", b"1e999\n", b'"', b"1e19,", b"nan,", b"boot: ok\n", b"\xff\xfe", b"9" * 400, b";", b"\t"]
SCRAPS += [b"12:00:00 -> ", b">a:", b"*00", b"0x1F", b"1_000", b"-", b"%", b"// x\n", b"\x00", b"t,a,b\n", b"  "]
SCRAPS += [b",,\n", b"1,2,3,4\n", b"0.1,2,ERR\n", b"nanN", b"e5", b"+.", b"3 4", b"\xc2\xb5"]

_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_WITH_COMMA = re.compile(r"[-+]?(?:[0-9]+(?:,[0-9]+)?|,[0-9]+)(?:[eE][-+]?[0-9]+)?")


def mutated(rng):
    data = bytearray(rng.choice(SEEDS))
    for _ in range(rng.randint(1, 5)):
        at, kind = rng.randrange(len(data) + 1), rng.random()
        if kind < 0.3 and at < len(data):
            data[at] = rng.randrange(256)
        elif kind < 0.5:
            del data[at : at + rng.randrange(40)]
        elif kind < 0.6:
            del data[at:]
        elif kind < 0.7:
            data[at:at] = data[rng.randrange(len(data) + 1) :][:60]
        else:
            data[at:at] = rng.choice(SCRAPS)
    return bytes(data)


def written(text):
    """Every number that stands in a text, also as a part of a longer word."""
    found = {float(word.replace(",", ".")) for word in _WITH_COMMA.findall(text)}
    return found | {float(word) for word in _NUMBER.findall(text)}


def check(path, data):
    path.write_bytes(data)
    recording = assert_same_by_line(path)
    if isinstance(recording, KalscopeError):
        assert re.fullmatch(".*(must|cannot be read).*", str(recording))
        return
    report = recording.report
    assert report.rows + report.rejected + report.blank + report.comments + report.headers == report.lines
    assert len([issue for issue in report.issues if issue.column is None]) == min(report.rejected, 100)
    assert recording.values.shape == (len(recording), len(recording.names))
    assert len(set(recording.names)) == len(recording.names) == len(recording.units)
    assert np.isfinite(recording.time).all()
    text = decoded(data)
    assert set(recording.values[~np.isnan(recording.values)].tolist()) <= written(text)
    assert report.lines == len(re.sub("\r\n?", "\n", text).removesuffix("\n").split("\n"))


def streamed(data):
    """Every number in the rows of these bytes as a stream."""
    parser = LineParser()
    parser.feed(data)
    numbers = [row[i] for event in parser for row in event.rows for i in parser.layout.channels]
    return {number for number in numbers if np.isfinite(number)}


@pytest.mark.parametrize("part", range(2))
def test_no_damage_is_taken_for_data(tmp_path, part):
    rng = random.Random(f"kalscope {part}")
    for _ in range(COUNT // 2):
        data = mutated(rng)
        try:
            check(tmp_path / "damaged.txt", data)
            assert streamed(data) <= written(data.decode("latin-1"))
        except Exception as error:
            raise AssertionError(f"{data!r}: {error!r}") from error


@given(st.binary(max_size=300) | st.text(alphabet='0123456789.,;:-+eE \t\n"#naT/', max_size=200).map(str.encode))
def test_any_bytes_at_all_are_accounted_for(tmp_path_factory, data):
    check(tmp_path_factory.getbasetemp() / "any.csv", data)


LOGS = 50 if FUZZ == 1 else 200 * FUZZ
RARE = (1225, 1299, 1344, 1413, 1764, 2118, 2138)
"""Seeds of settings above nameless rows, units that begin with %, first rows without samples, an added field."""


def test_a_log_in_any_dialect_is_read_exactly_or_not_at_all(tmp_path):
    found = {seed: judge(make_case(seed), tmp_path / "log.txt") for seed in (*range(LOGS), *RARE)}
    odd = [f"seed {seed}: {verdict}: {why[:120]}" for seed, (verdict, why) in found.items() if verdict != "exact"]
    assert not [line for line in odd if ": wrong: " in line], odd
    assert len(odd) <= 0.01 * len(found), odd


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


HEADS = {
    "a table": [f"{0.01 * i:.2f},{20 + i % 7},{i % 5}.5" for i in range(60)],
    "labels": [f"a:{i},b:{i}.5" for i in range(60)],
    "blank labels": [f'{{" ": {i}, "a": {i}.5}}' for i in range(60)],
}
LEADS = ("", "# unit ", "a:", "1,2,", "2024-01-01 ")
RUNS = (*' 1.,:-"a=(/e\t', "1 ", "1,", "a:1 ", "a:", "1.", ' "', "[]")
SIZE, MAX_SECONDS = 20_000, 0.5
"""Letters of the line, and what the processor may take for its file: it takes 0.03 s or less."""


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("place", [0, 31])
def test_a_file_with_a_line_of_20_kb_is_soon_read_or_refused(read, head, place):
    rows = HEADS[head]
    assert len(read("\n".join([*rows, ""]))) == len(rows)
    first = ([*HEADS].index(head) + place) % 2  # of the lines, every second one here, the others at the other place
    for run, lead in islice(product(RUNS, LEADS), first, None, 2):
        line = lead + run * (SIZE // len(run)) + "x"
        start = time.thread_time()
        with suppress(BadFile):
            assert len(read("\n".join([*rows[:place], line, *rows[place:], ""]))) >= len(rows)
        assert time.thread_time() - start < MAX_SECONDS, (lead, run)
