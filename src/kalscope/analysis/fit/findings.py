"""The evidence against a filter in its residuals, as numbers; the words are in `words.py`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from kalscope.analysis.fit.correction import Correction, find_correction
from kalscope.analysis.fit.record import Indices, Record, lost_by_lag
from kalscope.analysis.fit.run import Run
from kalscope.analysis.fit.spikes import CLEAR, MAX_OUTLIERS, Spikes, burst_of
from kalscope.analysis.fit.structure import Structure, find_change, find_free, find_shape, find_structure
from kalscope.analysis.residual_tests import SPIKE
from kalscope.common.array import Array

MAX_SHARE = 0.25
"""Share of low frequencies from which residuals are correlated for so long that parts differ by chance."""

MAX_UNCHANGED = 0.6
"""Share of readings equal to the one before, above which rounding determines the residuals."""


@dataclass(frozen=True)
class Findings:
    """The misfits of one channel, each with the value of a perfect filter where it was not found."""

    n: int
    """Scored residuals."""
    constant: bool = False
    """Whether the signal does not move: all residuals are 0, or they only show a given start."""
    ratio: float = 1.0
    """Variance of a step over r of the filter; without momentum λ."""
    momentum: bool = False
    """Whether the filter has momentum."""
    start: float = 0.0
    """How far, in σ, the first sample lies from the given x0; 0 where none was given or that is not a misfit."""
    spikes: int = 0
    """Isolated spikes, where they are more than chance."""
    burst: tuple[int, int] | None = None
    """First and last sample of the short stretch that holds most of these spikes, or of the rejected samples, where
    there is one."""
    jumps: int = 0
    """Jumps beyond 5 σ that stay, where spikes and jumps are more than chance."""
    scale: float = 1.0
    """Local σ of the residuals over the one that q and r predict, without spikes."""
    largest: float = 0.0
    """The largest residual, in σ as q and r predict it."""
    unchanged: float = 0.0
    """Share of the readings that equal the one before."""
    skewness: float = 0.0
    """Skewness of the residuals without spikes, where they are far from a normal distribution; else 0."""
    excess: float = 0.0
    """Excess kurtosis there, likewise."""
    refused: int = 0
    """Samples that the outlier gate rejected."""
    refused_in_a_row: int = 0
    """The longest run of them."""
    correction: Correction = field(default_factory=Correction)
    """Better q and r."""
    structure: Structure | None = None
    """What no q and r can remove; with momentum what the filter leaves."""
    lag_costs: bool = False
    """Whether the filter has momentum, and a lag of five samples without it would add more error than the noise."""
    change: float = 1.0
    """Largest over least variance of the residuals among the parts of the record, where that is a misfit."""


def find_misfits(
    run: Run, seen: NDArray[np.int64], e: Array, spikes: Spikes, refusals: Indices, lags: int
) -> Findings:
    """All evidence against the filter, found in all samples of the record.

    Args:
        run: the filter over the channel.
        seen: indices of the scored samples, shape (N,).
        e: their standardised residuals, shape (N,).
        spikes: the spikes among them.
        refusals: the samples that the gate rejected, ascending.
        lags: of the Ljung-Box test.
    """
    found = Findings(
        n=len(seen), momentum=run.momentum > 0.0, refused=len(refusals), refused_in_a_row=_longest_run(refusals)
    )
    if not e.any():
        return replace(found, constant=True)
    spiky, steps = _too_many(spikes, len(seen))
    outliers = spikes.off if spiky and len(spikes.off) <= MAX_OUTLIERS * len(seen) else spikes.off[:0]
    skewness, excess = find_shape(np.delete(e, spikes.off))
    record = Record.of(run, seen[outliers])
    if not record.moves and not len(outliers):  # what is left is the approach from a given x0
        return replace(found, constant=True, start=abs(float(e[0])) if abs(float(e[0])) > SPIKE else 0.0)
    if record.unchanged > MAX_UNCHANGED and len(outliers):  # its steps are not outliers
        record, outliers = Record.of(run, seen[:0]), outliers[:0]
    correction = find_correction(record, e, outliers)
    structure, change = _left(correction, record, lags, steps=steps)
    return replace(
        found,
        ratio=record.ratio,
        start=spikes.start,
        spikes=spikes.lone if spiky else 0,
        burst=burst_of(seen[np.sort(spikes.at[~spikes.stays])] if spiky else refusals, len(e)),
        jumps=int(np.count_nonzero(spikes.size[spikes.stays] > CLEAR)) if steps else 0,
        scale=1.4826 * float(np.median(np.abs(e))) or 1.0,
        largest=float(np.abs(e).max()),
        unchanged=record.unchanged,
        skewness=skewness,
        excess=excess,
        correction=correction,
        structure=structure,
        lag_costs=run.momentum > 0.0 and lost_by_lag(record) > 1.0,
        change=change,
    )


def _too_many(spikes: Spikes, n: int) -> tuple[bool, bool]:
    """Whether lone spikes are more than chance among n residuals; likewise jumps, where these prevail."""
    lone_ones = spikes.lone > spikes.jumps
    return lone_ones and spikes.too_many(n, lone=True), not lone_ones and spikes.too_many(n)


def _left(correction: Correction, record: Record, lags: int, *, steps: bool) -> tuple[Structure | None, float]:
    """Structure and change of variance in the residuals of the best fit; None and 1 where there is no fit."""
    if correction.e is None:
        return None, 1.0
    structure, change = _tested(correction.e, lags, steps=steps)
    if change == 1.0 and (structure is None or record.momentum):
        return structure, change
    free = find_free(record)
    if structure is not None and not record.momentum and free.predicts_better(record.data.m):
        rest = find_structure(record.residuals(free.log_moves, free.momentum), lags)
        structure = replace(structure, momentum=free.momentum, whole=rest is None)
    if change > 1.0:  # that of a wrong momentum says nothing
        change = min(change, _tested(record.residuals(*free.best), lags, steps=steps)[1])
    return structure, change


def _tested(e: Array, lags: int, *, steps: bool) -> tuple[Structure | None, float]:
    """Structure and change of variance in residuals."""
    # Steps raise the best q, and so leave a correlation between them whatever the rest of the signal does.
    structure = None if steps else find_structure(e, lags)
    parts_tell = structure is None or 0.0 < structure.low_share < MAX_SHARE
    return structure, find_change(e) if parts_tell else 1.0


def _longest_run(at: Indices) -> int:
    """The longest run of consecutive indices; `at` is ascending."""
    ends = np.flatnonzero(np.diff(at, append=np.inf) > 1)
    return int(np.diff(ends, prepend=-1).max(initial=0))
