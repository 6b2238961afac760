"""The folder of a fleet: its lock, the note of the run, the finished parts, and the table that they become.

A part holds the rows of a batch. It is written under a temporary name, synced and renamed, so that it is whole or
absent. Its name is the hash of its units, and its metadata name them: a rerun needs only the footers to know what
is done. Two parts may hold the same unit, as when a worker that seemed dead ends its task after all: they are equal
and the later one is taken.
"""

from __future__ import annotations

import hashlib
import importlib
import io
import json
import os
import re
import time
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from functools import cache, lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np

from kalscope.common.files import make_folder, write_atomic
from kalscope.common.numbers import Array
from kalscope.errors import BadFile, BadSetting
from kalscope.estimation.pool import LOG_RATIO, MOMENTUM, WIDTH, Pool
from kalscope.filtering.params import MAX_MOMENTUM
from kalscope.sources.grammar.read_options import ReadOptions

LIBRARIES = ("dask", "distributed", "pyarrow")
"""What `kalscope[fleet]` installs, imported where it is needed."""


def library(module: str) -> Any:
    """A module of one of LIBRARIES; BadSetting where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise BadSetting(
            f'a fleet needs {", ".join(LIBRARIES[:-1])} and {LIBRARIES[-1]}: pip install "kalscope[fleet]" '
            f"(got no {module.partition('.')[0]})"
        ) from None


pa, pc, pq = map(library, ("pyarrow", "pyarrow.compute", "pyarrow.parquet"))

NOTE, LOCK = "run.json", ".lock"
"""Names of the note that a run writes when it starts, and of the file that it locks."""
TABLE, TUNING = "fleet.parquet", "tuning.toml"
"""Names of the table, and of the tuning of the filter for all."""
SUMMARY = "fleet.json"
"""Name of the answer for programs, the last but one file that a run writes."""
PARTS = "parts"
"""Folder of the parts; they are spread over folders of two hexadecimal digits."""
_PART_FILE = re.compile(r"[0-9a-f]{32}\.(?:parquet|note)|\.[0-9a-f]{32}\.parquet\.kalscope-[0-9a-f]{16}\.tmp")
"""Names of parts, of the notes of time limits and of temporary files; other files are the user's."""
_TEMPORARY = re.compile(r"\..+\.kalscope-[0-9a-f]{16}\.tmp")
"""Names that `atomic_file` gives; other hidden files of the folder are the user's."""
MAX_ROWS = 5_000_000
"""Rows of a table, at most: one of a million devices needs about 1 GB of memory."""
MAX_BYTES = 2 << 30
"""Bytes of its columns, at most."""
MAX_JSON_BYTES = 10_000_000
"""Bytes of a file with JSON, at most; fleet.json with all its lists has less than one million."""
MAX_TEXT_BYTES = 4096
"""Bytes of a text in the table, at most: no path is longer."""
MAX_LOG_RATIO = 690.0
"""|ln λ| of a filter, at most: λ fits a double."""
MAX_OPEN = 16
"""Parts that are kept in memory at a time: a batch is in one or a few."""

T = TypeVar("T")

FAILED = "failed"
"""Verdict of a recording that could not be read or fitted."""
TIMED_OUT = "timed_out"
"""Verdict of one that was not done within the time limit."""


@dataclass(frozen=True, slots=True)
class Row:
    """What is known of one channel of one recording. None where it is not known."""

    id: str
    """Name of the recording: its path below the folder that was given, or the id of its series."""
    channel: str = ""
    """Name of the channel; "" where the recording could not be read."""
    unit: str = ""
    """Unit of the signal, "" where unknown."""
    samples: int = 0
    """Samples, missing ones included."""
    rate_hz: float | None = None
    """Sample rate, Hz."""
    q: float | None = None
    """Process-noise variance per sample, unit²."""
    r: float | None = None
    """Measurement-noise variance, unit²."""
    q_low: float | None = None
    """The least q that the record allows, 95 %, unit²; None where nothing was estimated."""
    q_high: float | None = None
    """The largest q that it allows; inf where it excludes none."""
    r_low: float | None = None
    """The least r that the record allows, 95 %, unit²."""
    r_high: float | None = None
    """The largest r that it allows."""
    momentum: float | None = None
    """Momentum, sample periods; 0 = none."""
    gate: float | None = None
    """Outlier gate on v²/s; None = off."""
    lag_samples: float | None = None
    """Lag of the settled filter on a ramp, sample periods."""
    verdict: str = FAILED
    """That of the estimate, "chosen" where the filter was specified, FAILED or TIMED_OUT."""
    nis: float | None = None
    """Mean of v²/s over the samples that the filter takes; 1 fits."""
    spikes: int = 0
    """Samples that the fit set aside."""
    rejected_lines: int = 0
    """Lines of the file that could not be read."""
    seconds: float = 0.0
    """Processor time that it took, s."""
    reason: str = ""
    """Why there is no q and r; "" where there are."""
    source: str = ""
    """Where the recording is: an absolute path, or in JSON the row groups that hold it, see `Unit.source`."""
    lag_loss_samples: float | None = None
    """By how many samples the filter for all lags more than the device's filter; known once all are fitted."""
    noise_loss_db: float | None = None
    """How much more noise it passes, dB."""
    error_growth: float | None = None
    """By which share its error of predicting samples that no fit has seen is larger."""
    left: bytes | None = None
    """What the three are computed from, see `loss_inputs`; only in parts."""


LOSS_INPUTS = "left"
"""The column that is in parts and not in the finished table."""
COLUMNS = tuple(one.name for one in fields(Row))
FINISHED = tuple(name for name in COLUMNS if name != LOSS_INPUTS)
"""The columns of a finished table."""
KEY, POOL = "unit_key", "unit_pool"
"""Columns of a part: the unit that a row belongs to, and on its first row the pool of the unit."""
UNITS = b"kalscope_units"
"""Metadata of a part: the keys of all its units, also of those without rows; false for one that has failed."""


def schema(names: Collection[str] = COLUMNS) -> Any:
    """The schema of these columns of the table."""
    kinds = {"str": pa.string(), "int": pa.int64(), "bytes | None": pa.binary()}
    return pa.schema(
        [(one.name, kinds.get(str(one.type), pa.float64())) for one in fields(Row) if one.name in names]
    )


def loss_cells(rows: Array) -> list[bytes | None]:
    """The cells of `loss_inputs`; None for a device that could not be judged at all."""
    rows = np.ascontiguousarray(rows, dtype="<f4")
    return [row.tobytes() if known else None for row, known in zip(rows, np.isfinite(rows[:, 0]), strict=True)]


def loss_rows(cells: list[Any]) -> Array:
    """The numbers in cells that may have been written by anything, shape (cells, WIDTH); NaN for an empty one."""
    nothing = np.full(WIDTH, np.nan, dtype="<f4").tobytes()
    content = b"".join(cell if isinstance(cell, bytes) and len(cell) == len(nothing) else nothing for cell in cells)
    numbers = np.frombuffer(content, dtype="<f4").reshape(len(cells), WIDTH).astype(np.float64)
    ratio, tau = numbers[:, LOG_RATIO], numbers[:, MOMENTUM]
    good = (np.abs(ratio) < MAX_LOG_RATIO) & (tau >= 0.0) & (tau <= MAX_MOMENTUM)
    return np.where(good[:, None] & np.isfinite(numbers), numbers, np.nan)


def _pool_cell(pool: Pool) -> bytes | None:
    """The pool as bytes; None for one without devices."""
    numbers = np.concatenate(([pool.devices, pool.innovations], pool.sums.ravel()))
    return numbers.astype("<f8").tobytes() if pool.devices else None


def _pool_from(cell: bytes) -> Pool:
    """The pool in a cell of a part; an empty one where its numbers are none."""
    try:
        numbers = np.frombuffer(cell, dtype="<f8")
        pool = Pool(numbers[2:].reshape(Pool.empty().sums.shape).copy(), int(numbers[0]), int(numbers[1]))
    except (ValueError, OverflowError, IndexError):
        raise BadFile("a part of the fleet must hold sums of its likelihood (got other bytes)") from None
    return pool if pool.devices > 0 and not np.isnan(pool.sums).any() else Pool.empty()


def _table_text(text: str) -> str:
    """A text as the table holds it: bytes that are not UTF-8 escaped, the end of a long text cut."""
    if text.isascii() and len(text) <= MAX_TEXT_BYTES:  # nearly all of them, millions in a large fleet
        return text
    return text.encode("utf-8", "backslashreplace")[:MAX_TEXT_BYTES].decode("utf-8", "ignore")


def part_path(folder: Path, keys: Iterable[str], suffix: str = ".parquet") -> Path:
    """The path of the part with these units; with the suffix .note that of the note of their time limits."""
    name = hashlib.sha256("\n".join(keys).encode()).hexdigest()[:32]
    return folder / PARTS / name[:2] / f"{name}{suffix}"


def write_part(folder: Path, units: Mapping[str, tuple[Sequence[Row], Pool]]) -> Path:
    """Write the rows and the pool of some units, by their keys, durably; the next run tries failed ones again.

    Raises:
        OSError: The disk is full or the folder cannot be written; no file remains.
    """
    rows = [row for several, _ in units.values() for row in several]
    cells = zip(*map(attrgetter(*COLUMNS), rows), strict=True) if rows else [()] * len(COLUMNS)
    columns = [
        pa.array(map(_table_text, column) if one.type == pa.string() else column, one.type)
        for one, column in zip(schema(), cells, strict=True)
    ]
    keys = pa.array([key for key, (several, _) in units.items() for _ in several], pa.string())
    pools = [_pool_cell(pool) if i == 0 else None for several, pool in units.values() for i in range(len(several))]
    table = pa.table([keys, *columns, pa.array(pools, pa.binary())], names=[KEY, *COLUMNS, POOL])
    lost = {key for key, (several, _) in units.items() for row in several if row.verdict in (FAILED, TIMED_OUT)}
    buffer = io.BytesIO()
    repeated = [KEY, "channel", "unit", "verdict", "source"]
    table = table.replace_schema_metadata({UNITS: json.dumps({key: key not in lost for key in units})})
    pq.write_table(table, buffer, compression="zstd", use_dictionary=repeated)
    path = part_path(folder, units)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, buffer.getvalue())
    return path


def units_of(path: Path) -> dict[str, bool]:
    """The keys of the units of a part, each with whether it is done for good; none where it is not a part."""
    try:
        footer = pq.read_metadata(path)
        names = [footer.schema.column(i).name for i in range(footer.num_columns)]
        units = msgspec.json.decode(footer.metadata[UNITS], type=dict[str, bool])
    except (pa.ArrowException, OSError, KeyError, TypeError, ValueError):
        return {}
    return units if names == [KEY, *COLUMNS, POOL] else {}


@cache
def _units_at(path: Path, _stamp: int) -> dict[str, bool]:
    return units_of(path)


def find_parts(folder: Path, *, settled: bool = False, since: int = 0) -> dict[str, Path]:
    """The part of each finished unit, by its key.

    Args:
        folder: Of the fleet.
        settled: Leave out those that are to be tried again.
        since: Leave out parts that were written before, ns since 1970.
    """
    stamped: list[tuple[int, Path]] = []
    for path in _files(folder, ".parquet"):
        with suppress(OSError):  # removed meanwhile
            stamped.append((path.stat().st_mtime_ns, path))
    good: dict[str, Path] = {}
    again: dict[str, Path] = {}
    for stamp, path in sorted(stamped):  # of those to be tried again the last attempt counts
        for key, done in _units_at(path, stamp).items() if stamp >= since else ():
            (good if done else again)[key] = path
    return good if settled else again | good


def sweep(folder: Path, keep: Collection[Path] | None = None) -> None:
    """Remove the temporary files and notes of killed runs, and the parts that are not to be kept."""
    useless = [path for path in _files(folder, ".parquet") if keep is not None and path not in keep]
    tops = [folder / name for name in os.listdir(folder) if _TEMPORARY.fullmatch(name)]
    for path in (*_files(folder, ".tmp"), *_files(folder, ".note"), *tops, *useless):
        with suppress(OSError):
            path.unlink()
    for path in (folder / PARTS).glob("??"):
        with suppress(OSError):
            path.rmdir()  # only where it is empty


def _files(folder: Path, ending: str) -> Iterator[Path]:
    return (path for path in (folder / PARTS).glob(f"??/*{ending}") if _PART_FILE.fullmatch(path.name))


def merge(batches: Sequence[Sequence[str]], parts: Mapping[str, Path]) -> tuple[Any, Pool]:
    """The rows of all units in the order of the fleet, batch by batch, and the sum of their pools in that order.

    Args:
        batches: The keys of the units of each batch, in the order of the fleet.
        parts: The part of each unit. A unit in none has no rows.

    Raises:
        BadFile: a part is damaged.
    """
    merged, pool = [schema().empty_table()], Pool.empty()
    for keys in batches:
        place = {key: i for i, key in enumerate(keys) if key in parts}
        tables: list[Any] = []
        for path in dict.fromkeys(parts[key] for key in place):
            table = _part(path, path.stat().st_mtime_ns)
            here = [key in place and parts[key] == path for key in table[KEY].to_pylist()]
            tables.append(table.filter(pa.array(here, pa.bool_())))
        if tables:
            rows = pa.concat_tables(tables)
            rows = rows.take(np.argsort([place[key] for key in rows[KEY].to_pylist()], kind="stable"))
            merged.append(rows.select(COLUMNS))
            for cell in rows[POOL].drop_null().to_pylist():
                pool = pool + _pool_from(cell)
    return pa.concat_tables(merged), pool


@lru_cache(MAX_OPEN)
def _part(path: Path, _stamp: int) -> Any:
    return checked_table(path, pa.schema([(KEY, pa.string()), *schema(), (POOL, pa.binary())]))


def checked_table(path: Path, known: Any) -> Any:
    """A table that any program may have written, with the columns and types of a schema; no text is missing.

    Raises:
        BadFile: it is not such a table, or one that would fill the memory.
    """
    texts = [one.name for one in known if pa.types.is_string(one.type)]
    try:
        file = pq.ParquetFile(path, memory_map=False, read_dictionary=texts)
        rows, groups = file.metadata.num_rows, range(file.metadata.num_row_groups)
        size = sum(file.metadata.row_group(i).total_byte_size for i in groups)
        if rows > MAX_ROWS or size > MAX_BYTES:
            raise ValueError(f"{rows} rows of {size} bytes; at most {MAX_ROWS} rows and {MAX_BYTES} bytes")
        missing = [name for name in known.names if name not in file.schema_arrow.names]
        if missing:
            raise ValueError(f"no column {missing[0]}; an older Kalscope may have written it: run the fleet again")
        table = file.read(columns=known.names, use_threads=rows > 100_000)
        columns = [_text(table[one.name]) if one.name in texts else table[one.name].cast(one.type) for one in known]
        return pa.table(columns, schema=known)
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError, OverflowError) as error:
        lines = str(error).splitlines() or [type(error).__name__]
        raise BadFile(f"{str(path)!r} must be a table of kalscope fleet (got {lines[0][:200]})") from None


def _text(column: Any) -> Any:
    """A column of texts, each short; a text that many rows share is checked once, before it is expanded."""
    for chunk in column.chunks:
        words = chunk.dictionary if pa.types.is_dictionary(column.type) else chunk
        longest = pc.max(pc.binary_length(words)).as_py() if len(words) else 0
        if (longest or 0) > MAX_TEXT_BYTES:
            raise ValueError(f"a text of {longest} bytes, at most {MAX_TEXT_BYTES}")
    return pc.fill_null(column.cast(pa.string()), "")


@contextmanager
def locked(folder: Path) -> Generator[None]:
    """Hold the folder while the block runs; the system releases it when the process dies.

    Args:
        folder: Of the results; it is made where it does not exist.

    Raises:
        BadSetting: Another process holds it, or it is a file.
        OSError: It cannot be written.
    """
    make_folder(folder)
    with open(folder / LOCK, "ab") as file:
        try:
            if os.name == "nt":
                import msvcrt

                getattr(msvcrt, "locking")(file.fileno(), getattr(msvcrt, "LK_NBLCK"), 1)  # noqa: B009 (unknown to a type checker elsewhere)
            else:
                import fcntl

                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise BadSetting(f"-o must name a folder that no other run writes (got {str(folder)!r})") from None
        yield


@dataclass(frozen=True)
class RunNote:
    """What a run notes when it starts: its results can be looked at before its end, and opened again."""

    units: int
    """Files or row groups of the fleet."""
    options: str
    """Hash of the options."""
    since: int
    """When the first run with these options started, ns since 1970: older parts belong to other options."""
    pooled: bool
    """Whether the filter for all is the most likely one; False where a goal was given."""
    reading: ReadOptions
    """How files are read."""
    sample_period: Annotated[float, msgspec.Meta(gt=0.0)] | None
    """Sample period in s in place of that of the recordings."""


@dataclass(frozen=True)
class SavedFilter:
    """The filter for all in the answer of a finished run."""

    q: Annotated[float, msgspec.Meta(gt=0.0)]
    r: Annotated[float, msgspec.Meta(gt=0.0)]
    momentum: float
    ratio_interval: tuple[float | None, float | None]
    """The q/r that the fleet allows, 95 %; None where it is not known."""
    how: str
    """How it was chosen, in a few words."""


@dataclass(frozen=True)
class Summary:
    """What is read again of the answer for programs."""

    one_filter: SavedFilter | None
    tuning_sha256: tuple[str, ...] = ()
    """The digests that tuning.toml may have, of the present file and of its successor."""


def write_note(
    folder: Path, units: int, fingerprint: str, reading: ReadOptions, sample_period: float | None, *, pooled: bool
) -> None:
    """Write the note of a run with options of this fingerprint in a folder that has passed `check_folder`."""
    options, path = hashlib.sha256(fingerprint.encode("utf-8", "surrogatepass")).hexdigest(), folder / NOTE
    before = read_json(path, RunNote) if path.exists() else None
    since = before.since if before is not None and before.options == options else time.time_ns()
    note = RunNote(units, options, since, pooled, reading, sample_period)
    write_atomic(path, msgspec.json.format(msgspec.json.encode(note)) + b"\n")


def read_json(path: Path, kind: type[T]) -> T:
    """An object in JSON from a file that any program may have written.

    Raises:
        BadFile: it cannot be read, is too large, or is not such an object.
    """
    try:
        if path.stat().st_size > MAX_JSON_BYTES:
            raise ValueError("more than 10 MB")
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except (OSError, ValueError, RecursionError) as error:
        raise BadFile(f"{str(path)!r} must be written by kalscope fleet (got {str(error)[:100]})") from None


def check_folder(folder: Path) -> None:
    """Refuse a folder in which a run would overwrite files that no fleet wrote.

    Raises:
        BadSetting: there is such a file.
    """
    try:
        if (folder / NOTE).exists():
            read_json(folder / NOTE, RunNote)
            foreign = None
        else:
            foreign = next((name for name in (TABLE, SUMMARY, TUNING) if (folder / name).exists()), None)
    except BadFile:
        foreign = NOTE
    if foreign is not None:
        raise BadSetting(
            f"-o must name a new folder or that of a fleet (got {str(folder)!r}, whose {foreign} no fleet wrote)"
        )
    check_tuning(folder)


def known_digest(folder: Path) -> str | None:
    """The digest of tuning.toml where the fleet has written it; None where there is none, or it is the user's."""
    try:
        digest = hashlib.sha256((folder / TUNING).read_bytes()).hexdigest()
        return digest if digest in read_json(folder / SUMMARY, Summary).tuning_sha256 else None
    except (OSError, BadFile):
        return None


def check_tuning(folder: Path) -> None:
    """Refuse a folder with a tuning file that no fleet wrote, or that was changed since: BadSetting."""
    path = folder / TUNING
    if path.exists() and known_digest(folder) is None:
        raise BadSetting(
            f"-o must name a folder without a {TUNING} of your own (got {str(path)!r}, which no fleet wrote or"
            " which was changed since): move it and run the same command again"
        )
