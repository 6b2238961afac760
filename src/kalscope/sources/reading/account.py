"""How a recording was read, as text, and why a file cannot be read."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from itertools import islice
from typing import Any

from kalscope.common.text import THIN_SPACE, count, percent, sample_rate
from kalscope.errors import BadFile
from kalscope.recording import LineIssue, Recording
from kalscope.sources.grammar.cells import is_blank, is_comment, is_number, split_fields
from kalscope.sources.grammar.read_options import DELIMITERS, OPTIONS, ReadOptions, option_words
from kalscope.sources.reading.axis import find_rate, jitter_of, steps_words
from kalscope.sources.reading.sniffer import MAX_COLUMNS

# How a recording was read, as text: one line of summary, warnings, and the account of every line.


MAX_SHARE = 0.02
"""More rejected lines or cells without a number than this share are worth a warning; a single one is not."""

MAX_ASSUMPTIONS = 4
"""Assumptions that are shown with a summary."""


def summary(recording: Recording) -> str:
    """How the recording was read, in one line: "2 094 rows, 4 channels, 13.4 Hz; 85 lines rejected: …"."""
    report = recording.report
    line = ", ".join((_many(len(recording), "row"), _many(len(recording.names), "channel"), _rate(recording)))
    if report.rejected:
        reasons = Counter(issue.reason.partition(" (")[0] for issue in report.issues if issue.column is None)
        why = "".join(f": {reason}" for reason, _ in reasons.most_common(1))
        line += f"; {_many(report.rejected, 'line')} rejected{why}"
    if report.bad_cells:
        line += f"; {_many(report.bad_cells, 'cell')} without a number"
    if report.comments > max(1.0, MAX_SHARE * report.lines):
        line += f"; {_many(report.comments, 'comment and text line')}"
    return _plain(line)


def warnings(recording: Recording) -> tuple[str, ...]:
    """Sentences where so much could not be read that every number that follows may be wrong; usually none."""
    report, found = recording.report, list[str]()
    cells = [issue for issue in report.issues if issue.column is not None]
    lines = [issue for issue in report.issues if issue.column is None]
    rejected = report.rejected / max(1, report.rejected + report.rows)
    if rejected > MAX_SHARE and report.rejected > 1:
        found.append(f"{percent(rejected)} of the lines were rejected{_first(lines)}")
    bad = report.bad_cells / max(1, report.rows * len(recording.names))
    if bad > MAX_SHARE and report.bad_cells > 1:
        found.append(f"{percent(bad)} of the cells are not numbers{_first(cells)}")
    return tuple(_plain(sentence) for sentence in found)


def read_as(recording: Recording) -> tuple[str, ...]:
    """What was taken for what, and what of it the file does not show, a sentence each; () if nothing was read."""
    report = recording.report
    said = [f"Read as {report.read_as}."] if report.read_as else []
    more = len(report.assumptions) - MAX_ASSUMPTIONS
    listed = [*report.assumptions[:MAX_ASSUMPTIONS], *([f"{more} more in the account"] if more > 0 else [])]
    said += [f"Assumed: {'; '.join(listed)}."] if listed else []
    return tuple(map(_plain, said))


def as_plain(recording: Recording) -> dict[str, Any]:
    """The whole account as JSON can hold it; numbers may be infinite."""
    said = {"summary": summary(recording), "warnings": list(warnings(recording))}
    return {**said, **asdict(recording.report), "overrule_with": list(OPTIONS)}


def _many(n: int, noun: str) -> str:
    return f"{count(n)} {noun}{'' if n == 1 else 's'}"


def _rate(recording: Recording) -> str:
    timing = recording.report.timing
    if recording.sample_period is None:
        return "sample period unknown (see --rate)"
    rate = (timing.summary if timing else "") or sample_rate(recording.sample_period)
    return rate + steps_words(jitter_of(recording))


def _first(issues: list[LineIssue]) -> str:
    return f", the first is {_issue(issues[0], 60)}" if issues else ""


def _issue(issue: LineIssue, length: int = 200) -> str:
    where = f"line {issue.line}" + (f', "{issue.column}"' if issue.column else "")
    return f"{where}: {issue.reason} (got {issue.text[:length]!r})"


def account(recording: Recording) -> str:
    """The account of a recording as plain text, one fact per line, nothing unprintable.

    Every line of the file is in exactly one of the counts.
    """
    report, n = recording.report, len(recording)
    samples = "sample" if n == 1 else "samples"
    lines = [f"{recording.title or 'recording'}: {n} {samples} of {_channels(recording)}"]
    lines += [f"  warning: {sentence}" for sentence in warnings(recording)]
    if recording.sample_period is not None:
        lines.append(f"  one sample every {recording.sample_period:.9g} s")
    parts = [
        (report.rows, "with data"),
        (report.rejected, "rejected"),
        (report.blank, "blank"),
        (report.comments, "comments and text"),
        (report.headers, "header"),
    ]
    counts = " + ".join(f"{number} {what}" for number, what in parts if number)
    if report.lines:  # a synthetic signal has none
        lines.append(f"  {report.lines} lines = {counts}")
    for number, what in (
        (report.bad_cells, "cells are not numbers: missing samples"),
        (report.clipped_times, "steps back in time, each filtered as dt = 0"),
        (report.inserted, "rows of missing samples inserted into gaps in time"),
    ):
        if number:
            lines.append(f"  {number} {what}")
    lines += [f"  {note}" for note in report.notes]
    lines += [f"  {_issue(issue)}" for issue in report.issues]
    more = report.rejected + report.bad_cells - len(report.issues)
    if more > 0:
        lines.append(f"  and {more} more")
    return "".join(f"{_plain(line)}\n" for line in lines)


def sample_period_conflict(recording: Recording) -> str:
    """A sentence where the sample period is not that of the recording's own time; "" where they agree to 1 %."""
    timing, period = recording.report.timing, recording.sample_period
    rate = find_rate(recording.time) if timing is None else None
    own = timing.stamps_period if timing is not None else rate and rate.period
    if period is None or own is None or abs(period - own) <= 0.01 * own:
        return ""
    return f"the sample period is taken as {period:.6g} s; by its time it would be {own:.6g} s"


def _channels(recording: Recording) -> str:
    pairs = zip(recording.names, recording.units, strict=True)
    return ", ".join(f"{name} [{unit}]" if unit else name for name, unit in pairs)


def _plain(line: str) -> str:
    return "".join(c if c.isprintable() or c == THIN_SPACE else "�" for c in line)


# Why a file cannot be read: the line, what must hold, what was found, and what to try.


MAX_TEXT = 60
"""Characters of a line that are quoted."""
MAX_LINES, MAX_LINE = 2000, 16_384
"""Lines that are looked at for the reason, and characters of each."""

_NO_TABLES = {
    re.compile(r"<(?:!doctype html|html|head|body)", re.IGNORECASE): "a web page: download the file itself",
    re.compile(r"<(?:\?xml|gpx|kml)", re.IGNORECASE): "an XML document: export it as CSV",
    re.compile(r"(?:\([0-9.]{1,20}\))?\s{0,9}v?can[0-9]{1,3}\s+[0-9A-Fa-f]{3,8}(?:#|\s+\[[0-9]+\])"): (
        "a frame of candump: cantools decode --single-line FILE.dbc writes the signals that FILE.dbc describes"
    ),
}
"""How a text begins that is no table, and what it is."""
_TRIES = {
    "must have a readable": "--time-format, or --time-column none",
    "must have": "--delimiter, --decimal or --header-row",
    "must end with": "--delimiter",
}
"""What to try, by how the reason of a rejected line begins."""


def refuse_foreign(name: str, lines: Sequence[str]) -> None:
    """Raise BadFile where a text begins as a web page, an XML document or frames: they may hold numbers as well."""
    number, line = next(((i, line.strip()) for i, line in enumerate(lines, 1) if line.strip()), (0, ""))
    for start, what in _NO_TABLES.items():
        if start.match(line[:MAX_TEXT].lstrip("\ufeff")):
            raise BadFile(f"{name} must be a table of numbers (got, in line {number}, {_quoted(line)}: {what})")


def no_table(name: str, lines: Sequence[str], options: ReadOptions) -> BadFile:
    """The refusal of a text in which no layout was found; `lines` are those at its beginning."""
    numbered = [(number, line[:MAX_LINE].strip()) for number, line in enumerate(lines[:MAX_LINES], 1)]
    said = [(number, line) for number, line in numbered if not is_blank(line) and not is_comment(line)]
    if not said:
        return BadFile(f"{name} must hold lines of numbers (got {len(lines)} blank or comment lines)")
    last, text = said[-1]
    if len(said) <= 2 and not _numbers(text, ","):
        return BadFile(
            f"{name} must hold numbers below its header (got only line {said[0][0]}: {_quoted(said[0][1])})"
        )
    mark = max(DELIMITERS, key=lambda mark: sum(_numbers(line, mark) for _, line in said))
    widths: dict[int, int] = {}
    for number, line in said:
        width = len(split_fields(line, mark))
        if _numbers(line, mark) > 0.5 * width:
            widths.setdefault(width, number)
    if len(widths) == 1 and max(widths) > MAX_COLUMNS:
        return BadFile(
            f"{name} must be a table of numbers, of at most {MAX_COLUMNS} columns (got {max(widths)} fields in line"
            f" {widths[max(widths)]}): write the columns that matter to a file of their own"
        )
    got = f"text such as line {last}: {_quoted(text)}"
    if widths:
        some = [f"{_many(width, 'field')} in line {number}" for width, number in islice(widths.items(), 2)]
        got = f"{', '.join(some)}: {_quoted(dict(said)[next(iter(widths.values()))])}"
    given = " ".join(option_words(options))
    instead = f"leave out {given}" if given else "try --delimiter, --decimal, --header-row or --time-column"
    return BadFile(
        f"{name} must be a table of numbers, one sample per line, all of one width (got {got}): {instead}"
    )


def no_channel(name: str, lines: Sequence[str]) -> BadFile:
    """The refusal of a table that has only a time."""
    last = next((line.strip() for line in reversed(lines) if not is_blank(line) and not is_comment(line)), "")
    return BadFile(
        f"{name} must hold a column of numbers besides the time (got only text, as in {_quoted(last)}): try"
        " --decimal, or --time-column none where the time is the signal"
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


def _numbers(line: str, mark: str) -> int:
    """Cells that are numbers, with a decimal point or comma."""
    return sum(is_number(cell) or (mark != "," and is_number(cell, ",")) for cell in split_fields(line, mark))


def _quoted(text: str) -> str:
    return repr(text[:MAX_TEXT] + ("…" if len(text) > MAX_TEXT else ""))
