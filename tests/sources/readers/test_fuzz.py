"""Damaged files and logs in random dialects, always the same ones: nothing is invented, nothing is lost.

100 files and 50 logs in the ordinary run; `make soak` reads thousands. `make_case(seed)` writes a log again."""

import codecs
import random
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.sources.both_ways import assert_same_by_line
from tests.sources.dialects.verdict import judge, make_case
from tests.support.effort import FUZZ

from kalscope.errors import KalscopeError
from kalscope.sources.reading.line_parser import LineParser


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


@pytest.mark.parametrize("part", range(2))
def test_no_damage_is_taken_for_data(tmp_path, part):
    rng = random.Random(f"kalscope {part}")
    for _ in range(COUNT // 2):
        data = mutated(rng)
        try:
            check(tmp_path / "damaged.txt", data)
        except Exception as error:
            raise AssertionError(f"{data!r}: {error!r}") from error


def test_a_stream_counts_every_line_and_invents_nothing():
    rng = random.Random("kalscope stream")
    for _ in range(COUNT // 10):
        data = mutated(rng)
        parser = LineParser()
        parser.feed(data)
        found, count = set(), 0
        while (event := parser.next_line()) is not None:
            count += 1
            assert event.number == count
            channels = parser.layout.channels if event.rows else []
            found |= {row[i] for row in event.rows for i in channels if np.isfinite(row[i])}
        assert parser.next_line() is None
        assert found <= written(data.decode("latin-1"))


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
