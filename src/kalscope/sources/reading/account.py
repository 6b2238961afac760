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
from kalscope.sources.reading.axis import jitter_of, steps_words
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
    cells, lines = report.rows * len(recording.names), report.rejected + report.rows
    kinds = (("lines were rejected", report.rejected, lines), ("cells are not numbers", report.bad_cells, cells))
    for what, bad, of in kinds:
        if bad > max(1.0, MAX_SHARE * of):
            issues = (issue for issue in report.issues if (issue.column is None) == (what == kinds[0][0]))
            first = "".join(f", the first is {_issue(issue, 60)}" for issue in islice(issues, 1))
            found.append(f"{percent(bad / of)} of the {what}{first}")
    return tuple(map(_plain, found))


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


def _issue(issue: LineIssue, length: int = 200) -> str:
    where = f"line {issue.line}" + (f', "{issue.column}"' if issue.column else "")
    return f"{where}: {issue.reason} (got {issue.text[:length]!r})"


def account(recording: Recording) -> str:
    """The account of a recording as plain text, one fact per line, nothing unprintable.

    Every line of the file is in exactly one of the counts.
    """
    report, n = recording.report, len(recording)
    named = zip(recording.names, recording.units, strict=True)
    channels = (f"{name} [{unit}]" if unit else name for name, unit in named)
    lines = [f"{recording.title or 'recording'}: {n} {'sample' if n == 1 else 'samples'} of {', '.join(channels)}"]
    lines += [f"  warning: {sentence}" for sentence in warnings(recording)]
    if recording.sample_period is not None:
        lines.append(f"  one sample every {recording.sample_period:.9g} s")
    numbers = report.rows, report.rejected, report.blank, report.comments, report.headers
    kinds = "with data", "rejected", "blank", "comments and text", "header"
    if report.lines:  # a synthetic signal has none
        counts = " + ".join(f"{number} {what}" for what, number in zip(kinds, numbers, strict=True) if number)
        lines.append(f"  {report.lines} lines = {counts}")
    facts = {
        "cells are not numbers: missing samples": report.bad_cells,
        "steps back in time, each filtered as dt = 0": report.clipped_times,
        "rows of missing samples inserted into gaps in time": report.inserted,
    }
    lines += [f"  {number} {what}" for what, number in facts.items() if number]
    lines += [f"  {note}" for note in (*report.notes, *map(_issue, report.issues))]
    more = report.rejected + report.bad_cells - len(report.issues)
    lines += [f"  and {more} more"] if more > 0 else []
    return "".join(f"{_plain(line)}\n" for line in lines)


def sample_period_conflict(recording: Recording) -> str:
    """A sentence where the sample period is not that of the recording's own time; "" where they agree to 1 %."""
    timing, period = recording.report.timing, recording.sample_period
    own = timing and timing.stamps_period
    if period is None or own is None or abs(period - own) <= 0.01 * own:
        return ""
    return f"the sample period is taken as {period:.6g} s; by its time it would be {own:.6g} s"


def _plain(line: str) -> str:
    return "".join(c if c.isprintable() or c == THIN_SPACE else "�" for c in line)


# Why a file cannot be read: the line, what must hold, what was found, and what to try.


MAX_TEXT = 60
"""Characters of a line that are quoted."""
_FOREIGN = {
    "a web page: download the file itself": re.compile(r"<!doctype html|<html|<head|<body", re.IGNORECASE),
    "an XML document: export it as CSV": re.compile(r"<\?xml|<gpx|<kml", re.IGNORECASE),
    "raw series of Graphite: ask it for format=csv": re.compile(r"[^,|\s]{1,200},[0-9]{10},[0-9]{10},[0-9]{1,6}\|"),
    "raw frames of candump: cantools decode --single-line FILE.dbc writes their signals": re.compile(
        r"(?:\([0-9.]{1,20}\)\s{0,9})?v?can[0-9]{1,3}\s+[0-9A-Fa-f]{3,8}(?:#|\s+\[[0-9]+\])"
    ),
}
"""How the first line of a text begins that is no table, although its lines may hold numbers."""


def refuse_foreign(name: str, lines: Sequence[str]) -> None:
    """Raise BadFile where a text begins as a web page, an XML document or frames of a bus."""
    number, line = next(((i, line.strip()) for i, line in enumerate(lines, 1) if line.strip()), (0, ""))
    for what, begin in _FOREIGN.items():
        if begin.match(line[:MAX_TEXT].lstrip("\ufeff")):
            raise BadFile(f"{name} must be a table of numbers (got, in line {number}, {_quoted(line)}: {what})")


def no_table(name: str, lines: Sequence[str], options: ReadOptions) -> BadFile:
    """The refusal of a text in which no layout was found; `lines` are those at its beginning."""
    texts = {number: line[:16_384].strip() for number, line in enumerate(lines[:2000], 1)}
    texts = {number: text for number, text in texts.items() if not is_blank(text) and not is_comment(text)}
    if not texts:
        return BadFile(f"{name} must hold lines of numbers (got {len(lines)} blank or comment lines)")
    (first, *_, last) = (*texts, *texts)
    if len(texts) <= 2 and not _numbers(texts[last], ","):
        got = f"only line {first}: {_quoted(texts[first])}"
        return BadFile(f"{name} must hold numbers below its header (got {got})")
    mark = max(DELIMITERS, key=lambda mark: sum(_numbers(text, mark) for text in texts.values()))
    widths: dict[int, int] = {}
    for number, text in texts.items():
        width = len(split_fields(text, mark))
        if _numbers(text, mark) > 0.5 * width:
            widths.setdefault(width, number)
    got = f"text such as line {last}: {_quoted(texts[last])}"
    if widths:
        some = [f"{_many(width, 'field')} in line {number}" for width, number in islice(widths.items(), 2)]
        got = f"{', '.join(some)}: {_quoted(texts[next(iter(widths.values()))])}"
    given = " ".join(option_words(options))
    instead = f"leave out {given}" if given else "try --delimiter, --decimal, --header-row or --time-column"
    must = "one sample per line, all of one width"
    if len(widths) > 3 and not given:  # records of several kinds: no option makes one table of them
        instead = "write the lines of one width to a file of their own"
    if len(widths) == 1 and max(widths) > MAX_COLUMNS:
        must = f"of at most {MAX_COLUMNS} columns"
        instead = "write the columns that matter to a file of their own"
    return BadFile(f"{name} must be a table of numbers, {must} (got {got}): {instead}")


def no_channel(name: str, lines: Sequence[str]) -> BadFile:
    """The refusal of a table that has only a time."""
    last = next((line.strip() for line in reversed(lines) if not is_blank(line) and not is_comment(line)), "")
    instead = "try --decimal, or --time-column none where the time is the signal"
    if re.search(r"\b0[xX][0-9A-Fa-f]", last):
        instead = "write its hexadecimal numbers as decimals"
    must = f"{name} must hold a column of numbers besides the time"
    return BadFile(f"{must} (got only text, as in {_quoted(last)}): {instead}")


def no_rows(name: str, rejected: int, issues: Sequence[LineIssue]) -> BadFile:
    """The refusal of a file that looked like a table in its head, but of which no line could be read."""
    reasons = Counter(issue.reason for issue in issues if issue.column is None)
    if not reasons:
        return BadFile(f"{name} must hold a whole line of numbers (got no data lines)")
    reason = max(reasons, key=lambda reason: reasons[reason])
    first = next(issue for issue in issues if issue.reason == reason)
    advice = ": try --delimiter, --decimal or --time-column none" if reason.startswith("must have") else ""
    return BadFile(
        f"{name} must hold a whole line of numbers (got {rejected} rejected lines, line {first.line}: {reason},"
        f" {_quoted(first.text)}){advice}"
    )


def _numbers(line: str, mark: str) -> int:
    """Cells that are numbers, with a decimal point or comma."""
    return sum(is_number(cell) or (mark != "," and is_number(cell, ",")) for cell in split_fields(line, mark))


def _quoted(text: str) -> str:
    return repr(text[:MAX_TEXT] + ("…" if len(text) > MAX_TEXT else ""))
