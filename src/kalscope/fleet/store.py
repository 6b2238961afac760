"""The folder of a fleet: its finished units in a database, and the table that they become.

The database is SQLite: a batch is stored whole or not at all, whatever kills the run, and no second run can open
it. A unit is found by a hash of all that its rows depend on, so that a rerun knows what is missing.
"""

from __future__ import annotations

import errno
import hashlib
import importlib
import json
import os
import sqlite3
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from kalscope.common.files import make_folder
from kalscope.common.numbers import Array
from kalscope.errors import BadFile, BadSetting
from kalscope.estimation.pool import WIDTH, Pool

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

STORE, TABLE, SUMMARY, TUNING = "units.sqlite", "fleet.parquet", "fleet.json", "tuning.toml"
"""Names of the database, of the table, of the answer for programs, and of the tuning of the filter for all."""
MAX_ROWS = 5_000_000
"""Rows of a table, at most: one of a million devices needs about 1 GB of memory."""
MAX_BYTES = 2 << 30
"""Bytes of its columns, at most."""
MAX_TEXT_BYTES = 4096
"""Bytes of a text in the table, at most: no path is longer."""
AT_ONCE = 1000
"""Units whose rows are read from the database at a time."""

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
    loss_inputs: bytes | None = None
    """What the three are computed from, a row of `loss_inputs`; only in the database."""


COLUMNS = tuple(one.name for one in fields(Row))
_NOTHING = np.full(WIDTH, np.nan, dtype="<f4").tobytes()


def schema() -> Any:
    """The schema of the table."""
    kinds = {"str": pa.string(), "int": pa.int64()}
    return pa.schema([(one.name, kinds.get(str(one.type), pa.float64())) for one in fields(Row)[:-1]])


class Stored(NamedTuple):
    """A finished unit as the database holds it."""

    key: str
    settled: bool
    """Whether it is done for good; the next run tries others again."""
    rows: bytes
    """The cells of its rows, in MessagePack."""
    pool: bytes | None
    """What it contributes to one filter for all; None for nothing."""


def stored(key: str, rows: Sequence[Row], pool: Pool) -> Stored:
    """A finished unit with this key, see `Unit.key`."""
    cells = [
        [_table_text(one) if isinstance(one, str) else one for one in attrgetter(*COLUMNS)(row)] for row in rows
    ]
    numbers = np.concatenate(([pool.devices, pool.innovations], pool.sums.ravel())).astype("<f8").tobytes()
    settled = not any(row.verdict in (FAILED, TIMED_OUT) for row in rows)
    content = msgspec.msgpack.encode(cells, enc_hook=np.generic.item)
    return Stored(key, settled, content, numbers if pool.devices else None)


def _table_text(text: str) -> str:
    """A text as the table holds it: bytes that are not UTF-8 escaped, the end of a long text cut."""
    if text.isascii() and len(text) <= MAX_TEXT_BYTES:  # nearly all of them, millions in a large fleet
        return text
    return text.encode("utf-8", "backslashreplace")[:MAX_TEXT_BYTES].decode("utf-8", "ignore")


def _pool_from(cell: bytes) -> Pool:
    numbers = np.frombuffer(cell, dtype="<f8")
    return Pool(numbers[2:].reshape(Pool.empty().sums.shape), int(numbers[0]), int(numbers[1]))


_TABLES = {"units", "tunings"}
_CREATE = """
PRAGMA locking_mode = EXCLUSIVE;
BEGIN EXCLUSIVE;
CREATE TABLE IF NOT EXISTS units (key TEXT PRIMARY KEY, settled INTEGER, rows BLOB, pool BLOB);
CREATE TABLE IF NOT EXISTS tunings (sha256 TEXT PRIMARY KEY);
COMMIT;
"""


class Store:
    """The open database of a fleet; see `open_store`."""

    def __init__(self, folder: Path, database: sqlite3.Connection) -> None:
        self.folder, self._database = folder, database
        tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if tables and tables != _TABLES:
            raise BadSetting(_foreign(folder, STORE))
        database.executescript(_CREATE)

    def settled(self) -> set[str]:
        """The keys of the units that are done for good."""
        return {key for (key,) in self._database.execute("SELECT key FROM units WHERE settled")}

    def keep(self, units: Iterable[Stored]) -> None:
        """Store finished units durably, all or none."""
        with self._database as database:
            database.executemany("INSERT OR REPLACE INTO units VALUES (?, ?, ?, ?)", units)

    def merged(self, keys: Sequence[str]) -> tuple[Any, Array, Pool]:
        """The rows of these units in this order, their `loss_inputs`, and the sum of their pools.

        All other units are deleted.

        Raises:
            BadFile: the database holds something else.
        """
        with self._database as database:
            wanted = json.dumps(keys)
            database.execute("DELETE FROM units WHERE key NOT IN (SELECT value FROM json_each(?))", (wanted,))
        tables, inputs, pool = [schema().empty_table()], list[bytes](), Pool.empty()
        select = "SELECT key, rows, pool FROM units WHERE key IN (SELECT value FROM json_each(?))"
        try:
            for first in range(0, len(keys), AT_ONCE):
                some, rows = keys[first : first + AT_ONCE], list[Any]()
                units = {key: cells for key, *cells in self._database.execute(select, (json.dumps(some),))}
                for content, cell in (units[key] for key in some):
                    rows += msgspec.msgpack.decode(content)
                    pool = pool if cell is None else pool + _pool_from(cell)
                *columns, last = zip(*rows, strict=True) if rows else [()] * len(COLUMNS)
                inputs += [cell or _NOTHING for cell in last]
                arrays = [pa.array(column, one.type) for one, column in zip(schema(), columns, strict=True)]
                tables.append(pa.table(arrays, schema=schema()))
            numbers = np.frombuffer(b"".join(inputs), "<f4").astype(np.float64)
            numbers[~np.isfinite(numbers)] = np.nan
            return pa.concat_tables(tables), numbers.reshape(len(inputs), WIDTH), pool
        except (pa.ArrowException, ValueError, TypeError, LookupError, OverflowError, RecursionError) as error:
            raise BadFile(f"{STORE} must hold the units of a fleet (got {type(error).__name__})") from None

    def check_tuning(self) -> None:
        """Refuse a tuning file that no fleet wrote, or that was changed since: BadSetting."""
        path = self.folder / TUNING
        if not path.exists():
            return
        known = "SELECT 1 FROM tunings WHERE sha256 = ?"
        if self._database.execute(known, (hashlib.sha256(path.read_bytes()).hexdigest(),)).fetchone() is None:
            raise BadSetting(
                f"-o must name a folder without a {TUNING} of your own (got {str(path)!r}, which no fleet wrote or"
                " which was changed since): move it and run the same command again"
            )

    def note_tuning(self, content: bytes) -> None:
        """Note a tuning that is about to be written."""
        with self._database as database:
            digest = hashlib.sha256(content).hexdigest()
            database.execute("INSERT OR REPLACE INTO tunings VALUES (?)", (digest,))


_OF_DISK = {
    sqlite3.SQLITE_FULL: errno.ENOSPC,
    sqlite3.SQLITE_READONLY: errno.EACCES,
    sqlite3.SQLITE_CANTOPEN: errno.EACCES,
    sqlite3.SQLITE_IOERR: errno.EIO,
}
"""What is the fault of the disk or the folder, and not of what the database holds."""


@contextmanager
def open_store(folder: Path) -> Generator[Store]:
    """The database of a folder while the block runs; the system releases it when the process dies.

    Raises:
        BadSetting: another process has it open, the folder is a file, or holds files that no fleet wrote.
        OSError: the disk is full, or the database cannot be written.
    """
    make_folder(folder)
    path = folder / STORE
    foreign = next((name for name in (TABLE, SUMMARY, TUNING) if (folder / name).exists()), None)
    if foreign is not None and not path.exists():
        raise BadSetting(_foreign(folder, foreign))
    try:
        with closing(sqlite3.connect(path, timeout=0.0)) as database:
            store = Store(folder, database)
            store.check_tuning()
            yield store
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code in _OF_DISK:
            reason = os.strerror(errno.ENOSPC) if code == sqlite3.SQLITE_FULL else str(error)
            raise OSError(_OF_DISK[code], reason, str(path)) from None
        if code == sqlite3.SQLITE_BUSY:
            raise BadSetting(f"-o must name a folder that no other run writes (got {str(folder)!r})") from None
        raise BadSetting(f"{_foreign(folder, STORE)}: {error}") from None


def _foreign(folder: Path, name: str) -> str:
    return f"-o must name a new folder or that of a fleet (got {str(folder)!r}, whose {name} no fleet wrote)"


def checked_table(path: Path) -> Any:
    """The finished table of a fleet, which any program may have written; no text is missing.

    Raises:
        BadFile: it is not such a table, or one that would fill the memory.
    """
    known = schema()
    texts = [one.name for one in known if pa.types.is_string(one.type)]
    try:
        file = pq.ParquetFile(path, memory_map=False, read_dictionary=texts)
        rows, groups = file.metadata.num_rows, range(file.metadata.num_row_groups)
        size = sum(file.metadata.row_group(i).total_byte_size for i in groups)
        if rows > MAX_ROWS or size > MAX_BYTES:
            raise ValueError(f"{rows} rows of {size} bytes; at most {MAX_ROWS} rows and {MAX_BYTES} bytes")
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
