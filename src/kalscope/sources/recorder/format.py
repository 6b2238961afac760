"""How a recording of a live source is written: its header, its rows, its rejected lines. Pure functions on text.

One comment line says one thing; then come a CSV header and one row per line. Every name survives a round trip
through our own reader, a spreadsheet and pandas (`comment="#"`), whatever the board calls its channels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version

from kalscope.common.text import one_line, unused_name
from kalscope.recording import LineIssue
from kalscope.sources.layout.columns import Column, named_column
from kalscope.sources.layout.rows.kinds import only_text
from kalscope.sources.layout.sniffer import Layout

MAGIC = "# kalscope recording "
"""What a recording begins with; the version follows."""
REJECTS_MAGIC = "# kalscope rejects "
"""What the file of rejected lines begins with."""
STARTED = "# started: "
"""Before the wall clock's time at host time 0."""
HOST_TIME = "host time [s]"
"""Header of the first column."""
DEVICE_TIME = "device time"
"""Name of the second column, where the board sends its time; its unit follows."""
REJECTS_HEADER = f"{HOST_TIME},line,column,reason,text\n"
"""Header of the file of rejected lines."""

_FORMULA = ("=", "+", "-", "@")
_MAX_CELL_LENGTH = 100  # of a header: the reader cuts there
_MAX_UNIT_LENGTH = 30

RowEncoder = Callable[[float, Sequence[float]], str]
"""Turns host time in s and the values of a row, one per column of the layout, into its line."""


def preamble(source: str, wall: float, *, rejects: bool = False) -> str:
    """The comment lines above the header.

    Args:
        source: What is recorded, in the words of the command line.
        wall: Unix time at host time 0, s.
        rejects: True for the file of rejected lines.
    """
    lines = [
        f"{REJECTS_MAGIC if rejects else MAGIC}{_version()}",
        f"# source: {escaped(source)}",
        f"{STARTED}{iso_utc(wall)}",
        "# host time: s since the start, by this computer's monotonic clock; the rest as the board sent it",
    ]
    if rejects:
        lines.append("# text: a line as received, cut at 200 characters, with \\ before what cannot be printed")
    return "\n".join(lines) + "\n"


def restart_note(source: str, wall: float, since: float, host: float) -> str:
    """The comment lines where a recording is resumed.

    Args:
        source: What is recorded from here on.
        wall: Unix time, s.
        since: How long nothing was recorded, s; negative where the wall clock was set back.
        host: Host time, s.
    """
    said = f"{since:.3f} s" if since >= 0.0 else "of unknown length, the clock was set back"
    return f"# gap restart {said}\n# restarted: {iso_utc(wall)} (host time {host:.6f}), source: {escaped(source)}\n"


def iso_utc(unix: float) -> str:
    """Unix time as ISO 8601 in UTC, with microseconds."""
    stamp = datetime.fromtimestamp(unix, UTC).replace(tzinfo=None)
    return f"{stamp.isoformat(timespec='microseconds')}Z"


def header_line(layout: Layout) -> str:
    """The CSV header of a layout: host time, device time where the board sends it, the channels with units."""
    cells = [HOST_TIME]
    if layout.time is not None:
        unit = layout.columns[layout.time.index].unit or layout.time.unit
        cells.append(_cell(DEVICE_TIME, unit if layout.time.kind == "number" else "s"))
    taken = {"host time", DEVICE_TIME}
    for i in layout.channels:
        column = layout.columns[i]
        name = unused_name(_harmless(column.name), taken, " ")
        cells.append(_cell(name, column.unit))
    return ",".join(map(quoted, cells)) + "\n"


def row_encoder(layout: Layout) -> RowEncoder:
    """The function that writes the rows of a layout.

    A number is written with the fewest digits that give the same double, a missing value as an empty
    cell. A device time that is a calendar stamp or a clock is written in s since 1970 (UTC) or midnight.
    """
    time, channels = layout.time, layout.channels

    def encode(host: float, row: Sequence[float]) -> str:
        cells = [f"{host:.6f}"]
        if time is not None:
            stamp = row[time.index]
            cells.append(_number(stamp) if time.kind == "number" else _microseconds(stamp))
        cells += [_number(row[i]) for i in channels]
        return ",".join(cells) + "\n"

    return encode


def rejects_lines(host: float, number: int, text: str, issues: Iterable[LineIssue]) -> str:
    """The lines that give the reasons why a line, or cells of it, were rejected."""
    shown = quoted(escaped(text))
    return "".join(
        f"{host:.6f},{number},{quoted(escaped(issue.column or ''))},{quoted(escaped(issue.reason))},{shown}\n"
        for issue in issues
    )


def escaped(text: str) -> str:
    r"""Printable text on one line: `\n`, `\x00`, `\\`."""
    if text.isprintable() and "\\" not in text:
        return text
    return "".join(c if c.isprintable() and c != "\\" else c.encode("unicode_escape").decode() for c in text)


def quoted(cell: str) -> str:
    """A CSV cell; pandas takes a bare # for the start of a comment."""
    if any(mark in cell for mark in ',"#') or cell != cell.strip():
        return '"' + cell.replace('"', '""') + '"'
    return cell


def _number(value: float) -> str:
    return "" if math.isnan(value) else repr(value).removesuffix(".0")


def _microseconds(stamp: float) -> str:
    if math.isnan(stamp):
        return ""
    whole = round(abs(stamp))
    return f"{'-' if stamp < 0 else ''}{whole // 1_000_000}.{whole % 1_000_000:06d}"


def _cell(name: str, unit: str) -> str:
    """`name [unit]`; `name []` where our reader would take a bare name for something else."""
    unit = " ".join("".join(c if c.isprintable() and c not in "[]" else " " for c in unit).split())[
        :_MAX_UNIT_LENGTH
    ]
    name = name[: _MAX_CELL_LENGTH - len(unit) - 3].rstrip()
    if unit:
        return f"{name} [{unit}]"
    plain = named_column(name) == Column(name) and only_text((name,), ".")
    return name if plain else f"{name} []"


def _harmless(name: str) -> str:
    """A name on one line that no spreadsheet takes for a formula."""
    name = one_line(name)[: _MAX_CELL_LENGTH - 40].rstrip()
    return f"'{name}" if name.startswith(_FORMULA) else name or "channel"


def _version() -> str:
    try:
        return version("kalscope")
    except PackageNotFoundError:  # run from a checkout that was never installed
        return "unknown"
