"""Why a file cannot be read: the line, what must hold, what was found, and what to try."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from kalscope.errors import BadFile
from kalscope.recording import LineIssue
from kalscope.sources.grammar.cells import is_blank, is_comment, is_number, split_fields
from kalscope.sources.grammar.read_options import DELIMITERS, ReadOptions, option_words
from kalscope.sources.layout.sniffer import MAX_COLUMNS

MAX_TEXT = 60
"""Characters of a line that are quoted."""
MAX_LINES = 2000
"""Lines that are looked at for the reason."""
MAX_LINE = 16_384
"""Characters of a line that are looked at."""

_PAGES = ("<!doctype html", "<html", "<head", "<body")
_XML = ("<?xml", "<gpx", "<kml")
_TRIES = {
    "must have a readable": "--time-format, or --time-column none",
    "must have": "--delimiter, --decimal or --header-row",
    "must end with": "--delimiter",
}
"""What to try, by how the reason of a rejected line begins."""


def refuse_markup(name: str, lines: Sequence[str]) -> None:
    """Raise BadFile where a text begins as a web page or an XML document: its lines may still hold numbers."""
    number, line = next(((i, line.strip()) for i, line in enumerate(lines, 1) if line.strip()), (0, ""))
    start = line[:MAX_TEXT].lstrip("\ufeff").lower()
    if start.startswith(_PAGES):
        what = "a web page, not the file that it shows: download the file itself"
    elif start.startswith(_XML):
        what = "an XML document: export it as CSV"
    else:
        return
    raise BadFile(f"{name} must be a table of numbers (got, in line {number}, {_quoted(line)}: {what})")


def no_table(name: str, lines: Sequence[str], options: ReadOptions) -> BadFile:
    """The refusal of a text in which no layout was found; `lines` are those at its beginning."""
    numbered = [(number, line[:MAX_LINE].strip()) for number, line in enumerate(lines[:MAX_LINES], 1)]
    said = [(number, line) for number, line in numbered if not is_blank(line) and not is_comment(line)]
    if not said:
        return BadFile(f"{name} must hold lines of numbers (got {len(lines)} blank or comment lines)")
    if len(said) <= 2 and not _numbers(said[-1][1]):
        number, line = said[0]
        return BadFile(f"{name} must hold numbers below its header (got only line {number}: {_quoted(line)})")
    wide = max(widths := _widths(said), default=0)
    if wide > MAX_COLUMNS and len(widths) == 1:
        return BadFile(
            f"{name} must be a table of numbers, of at most {MAX_COLUMNS} columns (got {wide} fields in line"
            f" {widths[wide]}): write the columns that matter to a file of their own"
        )
    given = " ".join(option_words(options))
    instead = f"leave out {given}" if given else "try --delimiter, --decimal, --header-row or --time-column"
    return BadFile(
        f"{name} must be a table of numbers, one sample per line, all of one width "
        f"(got {_closest(said)}): {instead}"
    )


def no_channel(name: str, lines: Sequence[str]) -> BadFile:
    """The refusal of a table that has only a time."""
    said = [line for line in lines if not is_blank(line) and not is_comment(line)]
    last = _quoted(said[-1].strip()) if said else "nothing"
    return BadFile(
        f"{name} must hold a column of numbers besides the time (got only text, as in {last}): try --decimal,"
        " or --time-column none where the time is the signal"
    )


def no_rows(name: str, rejected: int, issues: Sequence[LineIssue]) -> BadFile:
    """The refusal of a file that looked like a table in its head, but of which no line could be read."""
    lines = [issue for issue in issues if issue.column is None]
    if not lines:
        return BadFile(f"{name} must hold a whole line of numbers (got {rejected} rejected lines: no data lines)")
    reason = Counter(issue.reason for issue in lines).most_common(1)[0][0]
    first = next(issue for issue in lines if issue.reason == reason)
    instead = next((f": try {words}" for start, words in _TRIES.items() if reason.startswith(start)), "")
    return BadFile(
        f"{name} must hold a whole line of numbers (got {rejected} rejected lines, line {first.line}: {reason},"
        f" {_quoted(first.text)}){instead}"
    )


def _widths(said: Sequence[tuple[int, str]]) -> dict[int, int]:
    """The first line of each number of fields, of the lines with most numbers."""
    mark = max(DELIMITERS, key=lambda mark: sum(_numbers(line, mark) for _, line in said))
    widths: dict[int, int] = {}
    for number, line in said:
        cells = split_fields(line, mark)
        if _numbers(line, mark) > 0.5 * len(cells):
            widths.setdefault(len(cells), number)
    return widths


def _closest(said: Sequence[tuple[int, str]]) -> str:
    """What the lines with most numbers lack to be a table."""
    (width, number), *others = [*_widths(said).items(), (0, 0)]
    if width == 0:
        return f"text such as line {said[-1][0]}: {_quoted(said[-1][1])}"
    text = dict(said)[number]
    if others[0] == (0, 0):
        return f"too few lines like line {number}: {_quoted(text)}"
    return f"{_fields(width)} in line {number}, {_fields(others[0][0])} in line {others[0][1]}: {_quoted(text)}"


def _fields(width: int) -> str:
    return "1 field" if width == 1 else f"{width} fields"


def _numbers(line: str, mark: str = ",") -> int:
    """Cells that are numbers, with a decimal point or comma."""
    return sum(is_number(cell) or (mark != "," and is_number(cell, ",")) for cell in split_fields(line, mark))


def _quoted(text: str) -> str:
    return repr(text[:MAX_TEXT] + ("…" if len(text) > MAX_TEXT else ""))
