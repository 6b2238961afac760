"""How a recording was read, as text: the decisions, the counts, the first lines that could not be read."""

from __future__ import annotations

import numpy as np

from kalscope.recording import Recording


def account(recording: Recording) -> str:
    """The account of a recording as plain text, one fact a line, nothing unprintable.

    Every line of the file is in exactly one of the counts.
    """
    report, n = recording.report, len(recording)
    samples = "sample" if n == 1 else "samples"
    lines = [f"{recording.title or 'recording'}: {n} {samples} of {_channels(recording)}"]
    if recording.sample_period is not None:
        lines.append(f"  one sample every {recording.sample_period:.9g} s")
    parts = [
        (report.rows, "with data"),
        (report.rejected, "rejected"),
        (report.blank, "blank"),
        (report.comments, "comments and text"),
        (report.headers, "header"),
    ]
    counts = " + ".join(f"{count} {what}" for count, what in parts if count)
    if report.lines:  # a made-up signal has none
        lines.append(f"  {report.lines} lines = {counts}")
    for count, what in (
        (report.bad_cells, "cells are not numbers: missing samples"),
        (report.clipped_times, "steps back in time, each filtered as dt = 0"),
        (report.inserted, "rows of missing samples put into gaps of time"),
    ):
        if count:
            lines.append(f"  {count} {what}")
    lines += [f"  {note}" for note in report.notes]
    for issue in report.issues:
        where = f"line {issue.line}" + (f', "{issue.column}"' if issue.column else "")
        lines.append(f"  {where}: {issue.reason} (got {issue.text!r})")
    more = report.rejected + report.bad_cells - len(report.issues)
    if more > 0:
        lines.append(f"  and {more} more")
    return "".join(f"{_plain(line)}\n" for line in lines)


def sample_period_conflict(recording: Recording) -> str:
    """A sentence where the sample period is not that of the recording's own time; "" where they agree to 1 %."""
    steps = np.diff(recording.time)
    steps = steps[steps > 0.0]
    if recording.sample_period is None or not len(steps):
        return ""
    own = float(np.median(steps))
    if abs(recording.sample_period - own) <= 0.01 * own:
        return ""
    return f"the sample period is taken as {recording.sample_period:.6g} s; by its time it would be {own:.6g} s"


def _channels(recording: Recording) -> str:
    pairs = zip(recording.names, recording.units, strict=True)
    return ", ".join(f"{name} [{unit}]" if unit else name for name, unit in pairs)


def _plain(line: str) -> str:
    return "".join(c if c.isprintable() else "�" for c in line)
