"""Large plain tables, read by DuckDB; every line that is not plain is read by the own parser.

DuckDB gets an explicit schema and decides nothing. Its traps, and what stands against them here:

- `comment` together with `skip` loses rows silently, and quotes reach over lines: both are switched off, and
  a line with `#`, a quote or any other odd byte is found by `line_scan` and read again by the own parser.
- A cut last cell is taken for a number: a last line without newline is read again.
- `1_000` reads as 1000 (an odd byte), `1e400` as inf, an empty stamp as NULL: such rows are read again.
- Mixed line ends and more than 1000 rejects make it fail or crawl: the own parser then reads the whole file.
- Row i must be a certain line. Lines that DuckDB skips (blank ones) or rejects (it says which) are counted, the
  sum must fit the file, and rows from its beginning, middle and end are read again and compared.

Whatever does not fit ends in None, and the own parser reads the file: slower, never differently.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from kalscope.sources.lines.cells import is_number
from kalscope.sources.lines.line_reader import TAIL_LINES, LineEvent, LineReader
from kalscope.sources.lines.timestamps import LARGEST_STAMP
from kalscope.sources.readers.assemble import Columns, Reading
from kalscope.sources.readers.csv_rows import Rows, Tally, count_preamble
from kalscope.sources.readers.line_scan import LineScan, NotPlain, blank_lines, fetch_lines, scan_lines

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from kalscope.common.progress import Progress
    from kalscope.sources.lines.read_options import ReadOptions
    from kalscope.sources.lines.sniffer import Layout
    from kalscope.sources.readers.text_file import RawFile

MOST_REJECTS = 1000
"""Lines that DuckDB may reject; it needs 30 µs for each, the own parser 8."""

_ENTRIES = 4 * MOST_REJECTS
"""DuckDB notes one line several times, once for each cell."""
_POLL_S = 0.05
_SPOT_CHECKS = 20

Place = tuple[int, tuple[float, ...]]
"""Index among the rows of DuckDB, and the row that belongs there."""


def read_bulk(raw: RawFile, layout: Layout, options: ReadOptions, progress: Progress) -> Reading | None:
    """Read a file on the disk; None where that is a task for the own parser.

    Raises:
        Cancelled: the caller wants to stop.
    """
    if not _is_plain(layout, options):
        return None
    try:
        import duckdb
    except ImportError:
        return None
    job = _Query(duckdb, raw, layout)
    # Not before the Recording is made: while DuckDB gives its memory back, to get new memory takes far longer.
    raw.at_the_end.callback(job.stop)
    try:
        job.start()
        plain = b"0123456789+-.eEnaN \t\r\n" + layout.form.delimiter.encode()
        scan = scan_lines(raw.path, plain, layout.first_data, lambda n: progress(0.5 * n / raw.size, "reading"))
        rows, rejects = job.wait(progress)
        if scan.encoding == "latin-1" and not raw.head.isascii():
            raise NotPlain("the header was read as UTF-8")
        raw.sha256 = raw.sha256 or scan.sha256
        return _Merge(raw, layout, options, scan).merge(rows, rejects)
    except (NotPlain, duckdb.Error, MemoryError):
        job.stop()
        return None


def _is_plain(layout: Layout, options: ReadOptions) -> bool:
    form, time = layout.form, layout.time
    return (
        form.kind == "table"
        and not form.stamped
        and not form.checksum
        and form.delimiter != " "
        # "5," is no number to us, but one to DuckDB: decimal commas would need a look at each cell.
        and form.decimal == "."
        and (time is None or time.kind == "number")
        and not any(column.role == "text" for column in layout.columns)
        and not any(is_number(text) for text in options.missing_texts)
    )


class _Query:
    """DuckDB at work in a thread of its own, so that it can be watched and stopped."""

    def __init__(self, duckdb: Any, raw: RawFile, layout: Layout) -> None:
        self._time = None if layout.time is None else layout.time.index
        self._wanted = [*layout.channels, *([] if self._time is None else [self._time])]
        # Nothing is to be fetched from the network, whatever the path looks like.
        safe = {"autoinstall_known_extensions": False, "autoload_known_extensions": False}
        self._connection = duckdb.connect(config=safe)
        kinds = ", ".join(f"'c{i}': 'DOUBLE'" for i in range(len(layout.columns)))
        columns = ", ".join(f"c{i}" for i in self._wanted)
        self._sql = (
            f"SELECT {columns} FROM read_csv(?, auto_detect=false, columns={{{kinds}}}, header=false,"
            f" skip={layout.first_data - 1}, delim=?, decimal_separator='{layout.form.decimal}', quote='',"
            f" escape='', comment='', store_rejects=true, rejects_limit={_ENTRIES})"
        )
        self._arguments = [str(raw.path), layout.form.delimiter]
        self._answer: dict[str, Any] = {}
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="kalscope-duckdb", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def _run(self) -> None:
        try:
            self._answer = self._connection.execute(self._sql, self._arguments).fetchnumpy()
        except BaseException as error:  # told to whoever waits
            self._error = error

    def wait(self, progress: Progress) -> tuple[Columns, list[int]]:
        """The columns by index, and the lines that were rejected, in order."""
        while self._thread.is_alive():
            self._thread.join(_POLL_S)
            progress(0.75, "reading")
        if self._error is not None:
            raise self._error
        rows = {i: _filled(self._answer.pop(f"c{i}")) for i in self._wanted}
        sql = "SELECT count(*), list(DISTINCT line) FROM reject_errors"
        entries, lines = self._connection.execute(sql).fetchall()[0]
        if entries >= _ENTRIES or len(lines or ()) > MOST_REJECTS:
            raise NotPlain("too many rejected lines")
        return rows, sorted(lines or ())

    def stop(self) -> None:
        """Stop where it is still at work, and free its memory."""
        if self._thread.is_alive():
            self._connection.interrupt()
            self._thread.join()
        self._answer = {}
        self._connection.close()


def _filled(column: Any) -> NDArray[np.float64]:
    return np.ma.filled(column, np.nan) if isinstance(column, np.ma.MaskedArray) else column


class _Merge:
    """Puts the lines that the own parser reads among the rows of DuckDB."""

    def __init__(self, raw: RawFile, layout: Layout, options: ReadOptions, scan: LineScan) -> None:
        self._raw, self._layout, self._scan = raw, layout, scan
        self._reader = LineReader(layout, options.without_numbers())
        self._time = None if layout.time is None else layout.time.index
        self._tally = Tally(lines=scan.lines)

    def merge(self, rows: Columns, rejects: list[int]) -> Reading:
        """The reading of the whole file; NotPlain where rows and lines do not fit together."""
        layout, scan = self._layout, self._scan
        n, lines = len(rows[layout.channels[0]]), scan.lines - layout.first_data + 1
        # Lines without a row of DuckDB's; a file of one column has rows for its blank lines as well.
        blank = [] if n + len(rejects) == lines else blank_lines(self._raw.path, layout.first_data)
        skipped = np.array(sorted({*rejects, *blank}), dtype=np.int64)
        if n + len(skipped) != lines:
            raise NotPlain("the rows are not the lines")
        if n == 0:
            raise NotPlain("no plain row at all")
        doubtful = self._line_of(self._doubtful(rows), skipped)
        again = sorted({*rejects, *blank, *scan.odd, *doubtful.tolist()})
        self._check_some(rows, skipped, n, again)
        for number, line in self._texts(range(1, layout.first_data)):
            count_preamble(number, line, layout, self._tally)
        events = [self._event(number, line) for number, line in self._texts(again)]
        self._tally.rows += n - int(np.count_nonzero(~np.isin(np.array(again, dtype=np.int64), skipped)))
        return Reading(self._spliced(rows, skipped, events), self._tally, layout)

    def _doubtful(self, rows: Columns) -> NDArray[np.int64]:
        """Indices of rows in which DuckDB may have read something that is no number or no row to us."""
        channels = [rows[i] for i in self._layout.channels]
        bad = np.zeros(len(channels[0]), dtype=bool)
        for column in channels:
            if np.isinf(np.fmax.reduce(column)) or np.isinf(np.fmin.reduce(column)):
                bad |= np.isinf(column)
        if self._time is not None:
            stamps = rows[self._time]
            if not (stamps.min() >= -LARGEST_STAMP and stamps.max() <= LARGEST_STAMP):  # NaN fails as well
                bad |= ~(np.abs(stamps) <= LARGEST_STAMP)
        else:  # a line of delimiters alone is blank
            missing = np.isnan(channels[0])
            for column in channels[1:]:
                if missing.any():
                    missing &= np.isnan(column)
            bad |= missing
        return np.flatnonzero(bad)

    def _line_of(self, index: NDArray[np.int64], skipped: NDArray[np.int64]) -> NDArray[np.int64]:
        """Line numbers of rows: each skipped line before a row pushes it one line down."""
        pushed = skipped - self._layout.first_data - np.arange(len(skipped))
        return index + self._layout.first_data + np.searchsorted(pushed, index, side="right")

    def _check_some(self, rows: Columns, skipped: NDArray[np.int64], n: int, again: Iterable[int]) -> None:
        """Rows from the beginning, the middle and the end must be what the own parser reads there."""
        places = [*range(_SPOT_CHECKS), *range(n // 2, n // 2 + _SPOT_CHECKS), *range(n - _SPOT_CHECKS, n)]
        index = np.array(sorted({i for i in places if 0 <= i < n}), dtype=np.int64)
        lines, known = self._line_of(index, skipped).tolist(), set(again)
        for i, (number, text) in zip(index.tolist(), self._texts(lines), strict=True):
            event = self._reader.read(number, text)
            if number in known:
                continue
            ours = [event.rows[0][c] for c in rows] if event.rows else []
            if not np.array_equal(ours, [column[i] for column in rows.values()], equal_nan=True):
                raise NotPlain("a row is not its line")

    def _texts(self, numbers: Iterable[int]) -> list[tuple[int, str]]:
        """(number, text with a newline) of lines, the text as the own parser would see it."""
        listed = list(numbers)
        found = fetch_lines(self._raw.path, self._scan, listed)
        texts = []
        for number in listed:
            text = found[number].decode(self._scan.encoding, "replace").replace("\r\n", "\n")
            texts.append((number, text.removeprefix("\ufeff") if number == 1 else text))
        return texts

    def _event(self, number: int, line: str) -> LineEvent:
        if number == self._scan.lines and self._scan.torn:
            above = range(max(1, number - TAIL_LINES), number)
            event = self._reader.read_last(number, line, [text for _, text in self._texts(above)])
            self._tally.take_last(event)
        else:
            event = self._reader.read(number, line)
            self._tally.take(event)
        return event

    def _spliced(self, rows: Columns, skipped: NDArray[np.int64], events: list[LineEvent]) -> Columns:
        """The columns with the rows of the events in their places."""
        if not events:
            return rows
        gone = set(skipped.tolist())
        replace: list[Place] = []
        delete: list[int] = []
        insert: list[Place] = []
        before = np.searchsorted(skipped, [event.number for event in events]).tolist()
        for event, skips in zip(events, before, strict=True):
            collected = Rows(self._layout)
            collected.add(event, last=self._scan.torn and event.number == self._scan.lines)
            row = tuple(collected.out)
            place = event.number - self._layout.first_data - skips
            if event.number in gone:
                insert += [(place, row)] if row else []
            elif row:
                replace.append((place, row))
            else:
                delete.append(place)
        return {i: _splice(column, i, replace, delete, insert) for i, column in rows.items()}


def _splice(
    column: NDArray[np.float64],
    index: int,
    replace: list[Place],
    delete: list[int],
    insert: list[Place],
) -> NDArray[np.float64]:
    """One column with values replaced, then inserted before, then deleted at places of the old column."""
    for place, row in replace:
        column[place] = row[index]
    if delete or insert:
        places = np.array([place for place, _ in insert], dtype=np.int64)
        gone = np.array(delete, dtype=np.int64)
        # What is inserted before a deleted place pushes that place down.
        gone += np.searchsorted(places, gone, side="right")
        column = np.insert(column, places, [row[index] for _, row in insert])
        column = np.delete(column, gone)
    return column
