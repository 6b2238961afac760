"""What became of a case: read exactly, refused, asked about, or wrong without a word.

Asked is what a note answers: it names the options with which the log is read exactly.
"""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from tests.sources.dialects.tables import Case, make_labelled, make_table

from kalscope.errors import KalscopeError
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import ReadOptions, options_from_text
from kalscope.sources.reading.recording_file import read_recording

OPTION = re.compile(r'--([a-z-]+)(?:[ =](?:"([^"]*)"|([^\s";)]+)))?')
"""An option with its value, as a note names it."""
RATE_TOLERANCE = {"burst": 0.1, "coarse": 0.04, "pause": 0.01, "jitter": 0.04, "even": 1e-3}
"""Of the period, relative; a burst's last samples may be missing from its stretch."""


def make_case(seed: int) -> Case:
    """The log of a seed."""
    rng = Random(f"kalscope dialect {seed}")
    return make_labelled(rng) if rng.random() < 0.15 else make_table(rng)


def judge(case: Case, path: Path) -> tuple[str, str]:
    """(exact, refused, asked or wrong; why it is not exact)."""
    path.write_bytes(case.data)
    try:
        recording = read_recording(path)
    except KalscopeError as error:
        return "refused", str(error)
    if not (why := difference(case, recording)):
        return "exact", ""
    for note in recording.report.notes:
        with suppress(KalscopeError):
            if (options := named_options(note)) and not difference(case, read_recording(path, options)):
                return "asked", f"{why}; {note}"
    return "wrong", why


def named_options(note: str) -> ReadOptions | None:
    """The options that a note names; None where it names none, or none with a value."""
    given: dict[str, Any] = {}
    for name, quoted, bare in OPTION.findall(note):
        if name in ("day-first", "month-first"):
            given["day_first"] = name == "day-first"
        else:
            given[name.replace("-", "_")] = quoted or bare
    try:
        return options_from_text(**given) if given else None
    except (KalscopeError, TypeError):  # `--time-unit changes it`
        return None


def difference(case: Case, recording: Recording) -> str:
    """What differs from the right reading; "" where nothing does."""
    if len(recording) != len(case.values):
        return f"{len(recording)} rows for {len(case.values)}"
    for j in range(case.values.shape[1]):
        if why := channel_difference(case, recording, j):
            return why
    spare = len(recording.names) - case.values.shape[1] - case.counter
    if spare > 0:
        return f"channels {recording.names} for {case.names}"
    return time_difference(case, recording)


def channel_difference(case: Case, recording: Recording, j: int) -> str:
    """What differs in one channel."""
    if case.names:
        if case.names[j] not in recording.names:
            return f"no channel {case.names[j]!r} among {recording.names}"
        index = recording.names.index(case.names[j])
    elif len(recording.names) < case.values.shape[1]:
        return f"{len(recording.names)} channels for {case.values.shape[1]}"
    else:
        index = j
    if not np.array_equal(recording.values[:, index], case.values[:, j], equal_nan=True):
        i = int(np.flatnonzero(~(recording.values[:, index] == case.values[:, j]))[0])
        return f"channel {j}, sample {i}: {recording.values[i, index]} for {case.values[i, j]}"
    if case.units and recording.units[index] != case.units[j]:
        return f"unit {recording.units[index]!r} for {case.units[j]!r}"
    return ""


def time_difference(case: Case, recording: Recording) -> str:
    """What differs in time and rate."""
    stamps = case.stamps
    if case.period is None:
        return "" if recording.sample_period is None else f"a period of {recording.sample_period} s for none"
    if recording.sample_period is None:
        return f"no period for {case.period} s"
    tolerance = RATE_TOLERANCE[stamps.shape] if stamps else 1e-3
    if abs(recording.sample_period / case.period - 1) > tolerance:
        return f"a period of {recording.sample_period} s for {case.period} s"
    if stamps is not None and not stamps.only_rate:
        off = np.abs(recording.time - recording.time[0] - stamps.seconds)
        # A stamp of a pause or a jitter is as it stands; a file's own rate may smooth what is below a period.
        if float(off.max()) > max(1e-6, 0.02 * case.period if stamps.shape == "jitter" else 0.0):
            return f"a time that is {off.max()} s off at sample {int(off.argmax())}"
    return ""
