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
import socket
import time
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import IO, Any

import numpy as np

from kalscope.common.files import make_folder, write_atomic
from kalscope.common.numbers import Array, above_zero
from kalscope.errors import BadFile, BadSetting, KalscopeError
from kalscope.estimation.pool import LOG_RATIO, MOMENTUM, WIDTH, Pool
from kalscope.filtering.params import MAX_MOMENTUM
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions, option_texts, options_from_text
from kalscope.tuning import toml_text as toml

LIBRARIES = ("dask", "distributed", "pyarrow")
"""What `kalscope[fleet]` installs, imported where it is needed."""
NOTE, LOCK = "run.json", ".lock"
"""Names of the note that a run writes when it starts, and of the file that it locks."""
TABLE, TUNING = "fleet.parquet", "tuning.toml"
"""Names of the table, and of the tuning of the filter for all."""
SUMMARY = "fleet.json"
"""Name of the answer for programs, the last but one file that a run writes."""
DIGESTS = "tuning_sha256"
"""Its entry with the digests that tuning.toml may have, of the present file and of its successor."""
PARTS = "parts"
"""Folder of the parts; they are spread over folders of two hexadecimal digits."""
_PART_FILE = re.compile(r"[0-9a-f]{32}\.(?:parquet|note)|\.[0-9a-f]{32}\.parquet\.kalscope-[0-9a-f]{16}\.tmp")
"""Names of parts, of the notes of time limits and of temporary files; other files are the user's."""
_TEMPORARY = re.compile(r"\..+\.kalscope-[0-9a-f]{16}\.tmp")
"""Names that `atomic_file` gives; other hidden files of the folder are the user's."""
MAX_JSON_BYTES = 10_000_000
"""Bytes of a file with JSON, at most; fleet.json with all its lists has less than one million."""
MAX_TEXT_BYTES = 4096
"""Bytes of a text in the table, at most: no path is longer."""
MAX_LOG_RATIO = 690.0
"""|ln λ| of a filter, at most: λ fits a double."""
MAX_OPEN = 16
"""Parts that are kept in memory at a time: a batch is in one or a few."""

FAILED = "failed"
"""Verdict of a recording that could not be read or fitted."""
TIMED_OUT = "timed_out"
"""Verdict of one that was not done within the time limit."""


def library(module: str) -> Any:
    """A module of one of LIBRARIES; BadSetting where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise BadSetting(
            f'a fleet needs {", ".join(LIBRARIES[:-1])} and {LIBRARIES[-1]}: pip install "kalscope[fleet]" '
            f"(got no {module.partition('.')[0]})"
        ) from None


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
UNITS, AGAIN = b"kalscope_units", b"kalscope_again"
"""Metadata of a part: the keys of all its units, also of those without rows, and of those to be tried again."""


def schema(names: Collection[str] = COLUMNS) -> Any:
    """The schema of these columns of the table."""
    pa = library("pyarrow")
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


def pool_from(cell: bytes) -> Pool:
    """The pool in a cell of a part; ValueError where it is none."""
    numbers = np.frombuffer(cell, dtype="<f8")
    return Pool(numbers[2:].reshape(Pool.empty().sums.shape).copy(), int(numbers[0]), int(numbers[1]))


def table_text(text: str) -> str:
    """A text as the table holds it: bytes that are not UTF-8 escaped, the end of a long text replaced by a hash."""
    if text.isascii() and len(text) <= MAX_TEXT_BYTES:  # nearly all of them, millions in a large fleet
        return text
    data = text.encode("utf-8", "backslashreplace")
    if len(data) <= MAX_TEXT_BYTES:
        return data.decode()
    return f"{data[: MAX_TEXT_BYTES - 24].decode('utf-8', 'ignore')}… {hashlib.sha256(data).hexdigest()[:16]}"


def part_path(folder: Path, keys: Iterable[str], suffix: str = ".parquet") -> Path:
    """The path of the part with these units; with the suffix .note that of the note of their time limits."""
    name = hashlib.sha256("\n".join(keys).encode()).hexdigest()[:32]
    return folder / PARTS / name[:2] / f"{name}{suffix}"


def write_part(folder: Path, units: Mapping[str, tuple[Sequence[Row], Pool]], again: Collection[str] = ()) -> Path:
    """Write the rows and the pool of some units, by their keys, durably.

    Args:
        folder: Of the fleet.
        units: The rows and the pool of each, by its key.
        again: The keys of those that the next run tries again.

    Raises:
        OSError: The disk is full or the folder cannot be written; no file remains.
    """
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    rows = [row for several, _ in units.values() for row in several]
    cells = zip(*map(attrgetter(*COLUMNS), rows), strict=True) if rows else [()] * len(COLUMNS)
    columns = [
        pa.array(map(table_text, column) if one.type == pa.string() else column, one.type)
        for one, column in zip(schema(), cells, strict=True)
    ]
    keys = pa.array([key for key, (several, _) in units.items() for _ in several], pa.string())
    pools = [_pool_cell(pool) if i == 0 else None for several, pool in units.values() for i in range(len(several))]
    table = pa.table([keys, *columns, pa.array(pools, pa.binary())], names=[KEY, *COLUMNS, POOL])
    table = table.replace_schema_metadata({UNITS: json.dumps(list(units)), AGAIN: json.dumps(sorted(again))})
    buffer = io.BytesIO()
    repeated = [KEY, "channel", "unit", "verdict", "source"]
    parquet.write_table(table, buffer, compression="zstd", use_dictionary=repeated)
    path = part_path(folder, units)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, buffer.getvalue())
    return path


def units_of(path: Path) -> dict[str, bool] | None:
    """The keys of the units of a part, each with whether it is done for good; None where it is not a part."""
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    try:
        footer = parquet.read_metadata(path)
        keys, again = (list(map(str, json.loads(footer.metadata[name]))) for name in (UNITS, AGAIN))
        names = [footer.schema.column(i).name for i in range(footer.num_columns)]
    except (pa.ArrowException, OSError, KeyError, TypeError, ValueError):
        return None
    done = dict.fromkeys(keys, True) | dict.fromkeys(again, False)
    return done if names == [KEY, *COLUMNS, POOL] else None


def find_parts(folder: Path, *, settled: bool = False) -> dict[str, Path]:
    """The part of each finished unit, by its key; with `settled` only those that are not to be tried again."""
    good: dict[str, Path] = {}
    again: dict[str, Path] = {}
    for path in part_files(folder):  # of those to be tried again the last attempt counts
        for key, done in (units_of(path) or {}).items():
            (good if done else again)[key] = path
    return good if settled else again | good


def part_files(folder: Path) -> list[Path]:
    """The files that may be parts, in the order in which they were written, by their time stamps."""
    stamped: list[tuple[int, Path]] = []
    for path in _files(folder, ".parquet"):
        with suppress(OSError):  # removed meanwhile
            stamped.append((path.stat().st_mtime_ns, path))
    return [path for _, path in sorted(stamped)]


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
    """
    pa, read, merged, pool = library("pyarrow"), lru_cache(MAX_OPEN)(_read_part), list[Any](), Pool.empty()
    for keys in batches:
        place = {key: i for i, key in enumerate(keys) if key in parts}
        tables: list[Any] = []
        for path in dict.fromkeys(parts[key] for key in place):
            table = read(path)
            names = enumerate(table[KEY].to_pylist())
            wanted = [i for i, key in names if key in place and parts[key] == path]
            tables.append(table.take(pa.array(wanted, pa.int64())))
        if tables:
            rows = pa.concat_tables(tables)
            places = [place[key] for key in rows[KEY].to_pylist()]
            rows = rows.take(pa.array(sorted(range(len(rows)), key=places.__getitem__), pa.int64()))
            merged.append(rows.select(COLUMNS).cast(schema()))
            for cell in rows[POOL].drop_null().to_pylist():
                pool = pool + pool_from(cell)
    return pa.concat_tables([schema().empty_table(), *merged]), pool


def _read_part(path: Path) -> Any:
    """A part, read whole: no memory map of the file stays open."""
    return library("pyarrow.parquet").ParquetFile(path, memory_map=False).read()


@contextmanager
def locked(folder: Path) -> Generator[None]:
    """Hold the folder while the block runs; the system releases it when the process dies.

    Args:
        folder: Of the results; it is made where it does not exist.

    Raises:
        BadSetting: Another process holds it, it is a file, or its lock is a file that no fleet wrote.
        OSError: It cannot be written.
    """
    make_folder(folder)
    with open(folder / LOCK, "a+", encoding="utf-8", errors="replace") as file:
        is_free = _take(file)
        file.seek(0)
        holder = file.read(200).strip()
        if not is_free:
            other = holder or "another process"
            raise BadSetting(
                f"-o must name a folder that no other run writes (got {str(folder)!r}, held by {other})"
            )
        if holder and not holder.startswith("process "):  # it would be overwritten
            raise BadSetting(f"-o must name a folder whose {LOCK} is that of a fleet (got {str(folder)!r})")
        with suppress(OSError):  # a full disk is reported for the results, by their name
            os.truncate(file.fileno(), 0)
            os.write(file.fileno(), f"process {os.getpid()} on {socket.gethostname()}".encode())
        yield


def _take(file: IO[str]) -> bool:
    """Lock the open file; False where another process has. Closing it, or the end of the process, releases it."""
    try:
        if os.name == "nt":
            import msvcrt

            lock = getattr(msvcrt, "locking")  # noqa: B009 (unknown to a type checker elsewhere)
            file.seek(1 << 30)  # beyond the text, which stays readable
            lock(file.fileno(), getattr(msvcrt, "LK_NBLCK"), 1)  # noqa: B009
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


@dataclass(frozen=True)
class RunNote:
    """What a run notes when it starts: its results can be looked at before its end, and opened again."""

    units: int | None = None
    """Files or row groups of the fleet; None where it is not known."""
    options: str = ""
    """Hash of the options."""
    since: int = 0
    """When the first run with these options started, ns since 1970: older parts belong to other options."""
    pooled: bool = True
    """Whether the filter for all is the most likely one; False where a goal was given."""
    reading: ReadOptions = DEFAULTS
    """How files are read."""
    sample_period: float | None = None
    """Sample period in s in place of that of the recordings."""


def write_note(
    folder: Path, units: int, fingerprint: str, reading: ReadOptions, sample_period: float | None, *, pooled: bool
) -> None:
    """Write the note of a run with options of this fingerprint in a folder that has passed `check_folder`."""
    options, before = hashlib.sha256(fingerprint.encode("utf-8", "surrogatepass")).hexdigest(), read_note(folder)
    content = {
        "units": units,
        "options": options,
        "since": before.since if before.options == options else time.time_ns(),
        "pooled": pooled,
        "reading": option_texts(reading),
        "sample_period": sample_period,
    }
    write_atomic(folder / NOTE, (json.dumps(content, indent=1) + "\n").encode())


def read_note(folder: Path) -> RunNote:
    """The note of the last run; an empty one where there is none.

    Raises:
        BadFile: the file exists and is not such a note.
    """
    path = folder / NOTE
    if not path.exists():
        return RunNote()
    content = read_json(path)
    try:
        texts = {str(name): [str(text) for text in several] for name, several in content["reading"].items()}
        missing = texts.pop("missing", [])
        single: dict[str, Any] = {name: several[0] for name, several in texts.items()}
        if "day_first" in single:
            single["day_first"] = single["day_first"] == "day"
        period = content["sample_period"]
        return RunNote(
            int(content["units"]),
            str(content["options"]),
            int(content["since"]),
            bool(content["pooled"]),
            options_from_text(**single, missing=missing),
            None if period is None else above_zero("sample_period", period),
        )
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError, KalscopeError) as error:
        raise BadFile(f"{str(path)!r} must be the note of a run of kalscope fleet (got {error!r:.100})") from None


def read_json(path: Path) -> dict[str, Any]:
    """An object in JSON from a file that any program may have written.

    Raises:
        BadFile: it cannot be read, is too large, or is not an object.
    """
    try:
        if path.stat().st_size > MAX_JSON_BYTES:
            raise ValueError("more than 10 MB")
        content = json.loads(path.read_bytes())
        if not isinstance(content, dict):
            raise ValueError(f"a {type(content).__name__}")
    except (OSError, ValueError, RecursionError) as error:
        raise BadFile(f"{str(path)!r} must be an object in JSON (got {str(error)[:100]})") from None
    return content  # pyright: ignore[reportUnknownVariableType]


def check_folder(folder: Path) -> None:
    """Refuse a folder in which a run would overwrite files that no fleet wrote.

    Raises:
        BadSetting: there is such a file.
    """
    foreign: str | None = None
    if (folder / NOTE).exists():
        try:
            read_note(folder)
        except BadFile:
            foreign = NOTE
    else:
        foreign = next((name for name in (TABLE, SUMMARY, TUNING) if (folder / name).exists()), None)
    if foreign is not None:
        raise BadSetting(
            f"-o must name a new folder or that of a fleet (got {str(folder)!r}, whose {foreign} no fleet wrote)"
        )
    check_tuning(folder)


def tuning_digest(text: str) -> str:
    """The digest of the values of a tuning file: comments may be added."""
    values = json.dumps(toml.parse(text), sort_keys=True, default=str)
    return hashlib.sha256(values.encode("utf-8", "surrogatepass")).hexdigest()


def known_digest(folder: Path) -> str | None:
    """The digest of tuning.toml where the fleet has written it; None where there is none, or it is the user's."""
    try:
        digest, known = tuning_digest(toml.read_text(folder / TUNING)), read_json(folder / SUMMARY)[DIGESTS]
    except (BadFile, KeyError):
        return None
    return digest if isinstance(known, list) and digest in known else None


def check_tuning(folder: Path) -> None:
    """Refuse a folder with a tuning file that no fleet wrote, or that was changed since: BadSetting."""
    path = folder / TUNING
    if path.exists() and known_digest(folder) is None:
        raise BadSetting(
            f"-o must name a folder without a {TUNING} of your own (got {str(path)!r}, which no fleet wrote or"
            " which was changed since): move it and run the same command again"
        )
