"""One task: a batch of units becomes a part, on whichever machine it runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kalscope.common.version import program
from kalscope.errors import BadSetting
from kalscope.recording import Recording
from kalscope.tuning.fleet.recordings.unit import Unit
from kalscope.tuning.fleet.store.lock import NAME as LOCK
from kalscope.tuning.fleet.store.parts import write_part
from kalscope.tuning.fleet.store.row import FAILED, Row
from kalscope.tuning.fleet.work.asked import Asked
from kalscope.tuning.fleet.work.block import fit_block
from kalscope.tuning.fleet.work.deadline import deadlines, time_limit
from kalscope.tuning.fleet.work.fit import Fitted, fit_each
from kalscope.tuning.fleet.work.read import Series, read_file

MAX_SECONDS = 10.0
"""A batch that takes longer ends after its current unit; what is left is distributed to idle workers."""

_compiled: set[str] = set()
"""The options for which this process has compiled the fits."""


@dataclass(frozen=True)
class Done:
    """What a task reports to the driver; the rows themselves are in the part."""

    units: int
    """Units done; the rest of the batch was left."""
    rows: int
    """Rows written."""
    failed: int
    """Rows among them with a reason in place of q and r."""
    again: int
    """Units that the next run tries again."""
    fitting_s: float
    """Processor time of the fits, s."""
    total_s: float
    """Processor time of the whole task, s."""
    peak_bytes: int
    """Most memory that the worker has used so far, bytes; 0 where the system does not report it."""


def run_batch(units: Sequence[Unit], asked: Asked, folder: str) -> Done:
    """Fit the units of a batch and write their part.

    Args:
        units: The batch; at least the first is done.
        asked: The options.
        folder: Of the results, as the worker sees it.

    Raises:
        BadSetting: the worker does not see the folder, or has another version.
        TimedOut: an earlier attempt at the batch was ended by its time limit.
        OSError: the part cannot be written.
    """
    if not (Path(folder) / LOCK).exists():
        raise BadSetting(f"-o must name a folder that every worker of --cluster sees (got {folder!r})")
    if asked.program != program():
        raise BadSetting(f"every worker of --cluster must have {asked.program} (got {program()})")
    begun, end, options = time.thread_time(), time.monotonic() + MAX_SECONDS, asked.fingerprint()
    _compile(asked, options)
    keys, fitted = [unit.key(options) for unit in units], dict[str, Fitted]()
    with deadlines(Path(folder), keys) as limits:
        for unit, key in zip(units, keys, strict=True):
            with limits.end_after(time_limit(unit.size, asked.device_limit), key):
                fitted[key] = fit_unit(unit, asked)
            if time.monotonic() > end:
                break
    again = [key for key, one in fitted.items() if one.again]
    write_part(Path(folder), {key: (one.rows, one.pool) for key, one in fitted.items()}, again)
    written = [row for one in fitted.values() for row in one.rows]
    return Done(
        units=len(fitted),
        rows=len(written),
        failed=sum(bool(row.reason) for row in written),
        again=len(again),
        fitting_s=sum(row.seconds for row in written),
        total_s=time.thread_time() - begun,
        peak_bytes=_peak_bytes(),
    )


def _compile(asked: Asked, options: str) -> None:
    """Compile and load what a fit needs before the clock of a unit runs: it may take longer than most fits."""
    if options not in _compiled:
        _compiled.add(options)
        z = np.random.default_rng(1).normal(size=(200, 1))
        recording = Recording(np.arange(200.0), ("x",), ("",), np.cumsum(z, axis=0) + z[::-1], 1.0)
        fit_each([Series("", recording, "x")], asked.question)


def fit_unit(unit: Unit, asked: Asked) -> Fitted:
    """The result of a unit: the rows of its channels, or one with the reason why there are none."""
    try:
        if unit.pieces[0].groups:
            return fit_block(unit, asked).lying_in(unit.source)
        return fit_each(read_file(unit, asked), asked.question).lying_in(unit.source)
    except Exception as error:  # one bad file must not end the others
        return Fitted.lost(lost_row(unit), error)


def lost_row(unit: Unit, reason: str = "", verdict: str = FAILED) -> Row:
    """The row of a unit that could not be read."""
    name = unit.id if unit.span is None else f"{unit.data_set}ids up to {unit.span[1]}"
    return Row(id=name, channel=unit.channel or "", verdict=verdict, reason=reason, source=unit.source)


def _peak_bytes() -> int:
    try:
        import resource
    except ImportError:  # Windows
        return 0
    import sys

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
