"""The bulk path against the own parser: the same values, the same account, for whatever bytes."""

import builtins
import gzip
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.errors import BadFile, Cancelled, KalscopeError
from kalscope.sources.lines.read_options import ReadOptions
from kalscope.sources.readers import bulk, csv_file
from kalscope.sources.readers.csv_file import read_recording

duckdb = pytest.importorskip("duckdb")

OWN, BULK = 1e18, 0

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


@pytest.fixture
def taken(monkeypatch):
    """Counts how often the bulk path gave a reading."""
    count = []

    def spy(*arguments):
        reading = read_bulk(*arguments)
        count.append(reading is not None)
        return reading

    read_bulk = bulk.read_bulk
    monkeypatch.setattr(bulk, "read_bulk", spy)
    return count


def both(path, options=csv_file.DEFAULTS):
    """What the two paths make of a file; an error as its type and text."""
    found = []
    for size in (OWN, BULK):
        try:
            found.append(read_recording(path, options, _bulk_bytes=size))
        except KalscopeError as error:
            found.append((type(error), str(error)))
    return found


def assert_same(path, options=csv_file.DEFAULTS):
    own, fast = both(path, options)
    if isinstance(own, tuple) or isinstance(fast, tuple):
        assert fast == own
        return
    assert fast.report == own.report
    assert (fast.names, fast.units, fast.sample_period) == (own.names, own.units, own.sample_period)
    assert (fast.sha256, fast.source, fast.title) == (own.sha256, own.source, own.title)
    np.testing.assert_array_equal(fast.time, own.time)
    np.testing.assert_array_equal(fast.values, own.values)


@pytest.mark.parametrize("name", SEEDS)
def test_plain_tables_are_read_in_bulk_and_are_the_same(tmp_path, taken, name):
    path = tmp_path / "log.csv"
    path.write_bytes(SEEDS[name].encode())
    assert_same(path)
    assert taken == [True]


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


def damaged(data, changes):
    data = bytearray(data)
    for kind, place, what in changes:
        at = min(place, len(data))
        if kind == "flip" and at < len(data):
            data[at] = what
        elif kind == "cut":
            del data[at : at + what]
        elif kind == "end":
            del data[at:]
        elif kind in ("insert", "line"):
            at = data.rfind(b"\n", 0, at) + 1 if kind == "line" else at
            data[at:at] = what
    return bytes(data)


@given(st.sampled_from(sorted(SEEDS)), st.lists(change, min_size=1, max_size=4))
def test_damage_is_the_same_to_both(tmp_path_factory, name, changes):
    path = tmp_path_factory.getbasetemp() / "damaged.csv"
    path.write_bytes(damaged(SEEDS[name].encode(), changes))
    assert_same(path)


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("line", [0, 1, 20, 41])
def test_each_damage_alone_is_the_same_to_both(tmp_path, damage, line):
    path = tmp_path / "log.csv"
    lines = CLEAN.encode().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:line], damage, *lines[line:]]))
    assert_same(path)


@pytest.mark.parametrize(
    "options", [ReadOptions(missing=(21.11,)), ReadOptions(missing=("ERR",), time_column="none")]
)
def test_options_are_the_same_to_both(tmp_path, taken, options):
    path = tmp_path / "log.csv"
    path.write_text(CLEAN.replace("23.3300", "ERR"))
    assert_same(path, options)
    assert taken == [True]


def test_thousands_of_lines_in_many_blocks_are_the_same_to_both(tmp_path, taken):
    rng = np.random.default_rng(3)
    lines = [f"{i / 1000:.3f},{x:.6f},{y:.6f}\n" for i, (x, y) in enumerate(rng.normal(size=(120_000, 2)))]
    for i in rng.choice(len(lines), 500, replace=False):
        lines[i] = rng.choice(["\n", "x,1,2\n", "1,2\n", "5,1,2,3\n", "6,ERR,1\n", "# c\n", "7,,\n"])
    path = tmp_path / "log.csv"
    path.write_text("t,a,b\n" + "".join(lines))
    assert path.stat().st_size > 2 * 2**20
    assert_same(path)
    assert taken == [True]


@pytest.mark.parametrize(
    "text",
    [
        CLEAN.replace("\n", "\r\n", 20),
        CLEAN.replace("\n", "\r"),
        "t,a\n" + "0,1\n5\n" * 3000,  # too many rejects
        "t;a\n" + "".join(f"{i},5;{i},25\n" for i in range(30)),
        "".join(f"a:{i},b:{2 * i}\n" for i in range(20)),
        "timestamp,x\n" + "".join(f"2026-01-01 00:00:{i:02},{i * 1.5}\n" for i in range(20)),
        "t a\n" + "".join(f"{i} {i}\n" for i in range(20)),
        "t,state,a\n" + "".join(f"{i},ok,{i}\n" for i in range(20)),
    ],
)
def test_what_is_not_plain_is_left_to_the_own_parser(tmp_path, taken, text):
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode())
    assert_same(path)
    assert taken == [False]


def test_without_duckdb_the_own_parser_serves(tmp_path, monkeypatch, taken):
    def without(name, *rest):
        if name == "duckdb":
            raise ImportError(name)
        return real(name, *rest)

    real = builtins.__import__
    monkeypatch.setattr(builtins, "__import__", without)
    path = tmp_path / "log.csv"
    path.write_text(CLEAN)
    assert len(read_recording(path, _bulk_bytes=BULK)) == 40
    assert taken == [False]


def test_a_name_full_of_wildcards_is_a_name(tmp_path, taken):
    path = tmp_path / "a[1]*?'\"{b}.csv"
    path.write_text(CLEAN)
    assert_same(path)
    assert taken == [True]


def test_large_archives_take_the_bulk_path_from_a_temporary_file(tmp_path, taken):
    zstandard = pytest.importorskip("zstandard")
    for name, packed in (
        ("log.csv.gz", gzip.compress(CLEAN.encode())),
        ("log.csv.zst", zstandard.compress(CLEAN.encode())),
        ("two.zst", zstandard.compress(CLEAN[:100].encode()) + zstandard.compress(CLEAN[100:].encode())),
    ):
        path = tmp_path / name
        path.write_bytes(packed)
        assert_same(path)
        assert read_recording(path).report.rows == 40
    assert taken == [True] * 3


@pytest.mark.parametrize("keep", [5, 20, -1])
def test_a_cut_zstandard_archive_is_refused(tmp_path, keep):
    zstandard = pytest.importorskip("zstandard")
    path = tmp_path / "log.zst"
    path.write_bytes(zstandard.compress(CLEAN.encode() * 50)[:keep])
    with pytest.raises(BadFile, match="whole Zstandard"):
        read_recording(path)


# Progress and cancel.


@pytest.fixture(scope="module")
def long_log(tmp_path_factory):
    path = tmp_path_factory.mktemp("long") / "log.csv"
    path.write_text("t,a\n" + "".join(f"{i / 100:.2f},{i % 977}.25\n" for i in range(400_000)))
    return path


@pytest.mark.parametrize("size", [OWN, BULK])
def test_progress_rises_to_the_end(long_log, size):
    seen = []
    read_recording(long_log, progress=lambda fraction, text: seen.append((fraction, text)), _bulk_bytes=size)
    fractions = [fraction for fraction, _ in seen]
    assert len(fractions) > 3
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] <= fractions[-1] <= 1
    assert {text for _, text in seen} == {"reading"}


@pytest.mark.parametrize("size", [OWN, BULK])
def test_reading_can_be_cancelled_and_leaves_no_thread(long_log, size):
    before, asked = threading.active_count(), []

    def cancelled():
        asked.append(True)
        return len(asked) > 2

    with pytest.raises(Cancelled, match="cancelled"):
        read_recording(long_log, cancelled=cancelled, _bulk_bytes=size)
    assert threading.active_count() == before


# Parquet.


@pytest.fixture
def parquet(tmp_path):
    def write(select):
        path = tmp_path / "log.parquet"
        connection = duckdb.connect()
        connection.execute(f"COPY ({select}) TO '{path}' (FORMAT parquet)")
        connection.close()
        return read_recording(path)

    return write


def test_a_parquet_file_with_a_time_in_seconds(parquet):
    recording = parquet('SELECT i * 0.01::DOUBLE AS time, i AS n, i / 2 AS "x [mV]" FROM range(20) t(i)')
    assert (recording.names, recording.units) == (("n", "x"), ("", "mV"))
    assert recording.sample_period == 0.01
    np.testing.assert_array_equal(recording.channel("x"), np.arange(20) / 2)
    assert (recording.report.rows, recording.report.lines) == (20, 20)


@pytest.mark.parametrize("kind", ["TIMESTAMP", "TIMESTAMP_NS", "TIMESTAMP_S", "TIMESTAMPTZ"])
def test_a_parquet_file_with_stamps(parquet, kind):
    recording = parquet(
        f"SELECT (TIMESTAMP '2026-01-01' + INTERVAL (i) SECOND)::{kind} AS at, 'ok' AS state, i AS n"
        " FROM range(9) t(i)"
    )
    assert recording.names == ("n",)
    assert recording.time.tolist() == list(range(9))
    assert any("2026-01-01T00:00:00" in note for note in recording.report.notes)


def test_nulls_and_infinities_of_parquet_are_missing_samples(parquet):
    recording = parquet(
        "SELECT * FROM (VALUES (0.0::DOUBLE, 1.0::DOUBLE), (1, NULL), (2, 'inf'), (NULL, 4), (3, 5)) v(t, a)"
    )
    np.testing.assert_array_equal(recording.values[:, 0], [1, np.nan, np.nan, 5])
    report = recording.report
    assert (report.rows, report.rejected, report.lines, report.bad_cells) == (4, 1, 5, 1)


@pytest.mark.parametrize("select", ["SELECT 'a' AS b", "SELECT 1 AS a WHERE false"])
def test_a_parquet_file_without_samples_is_refused(parquet, select):
    with pytest.raises(BadFile, match="must hold"):
        parquet(select)


def test_a_damaged_parquet_file_is_refused(tmp_path):
    path = tmp_path / "log.parquet"
    path.write_bytes(b"PAR1" + bytes(200) + b"PAR1")
    with pytest.raises(BadFile, match="whole Parquet"):
        read_recording(path)
