"""The fit of a channel as a row of the table, and what it says about one filter for all."""

from __future__ import annotations

import errno
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kalscope.common.array import Array
from kalscope.errors import KalscopeError, describe
from kalscope.estimation.finding import Found, find_parameters
from kalscope.estimation.fleet.held_out import held_out
from kalscope.estimation.fleet.losses import left_by
from kalscope.estimation.fleet.many.plain import fitted_ratios, pair_intervals
from kalscope.estimation.fleet.many.series import Series, series_of
from kalscope.estimation.fleet.pool import Pool, pool_of
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state
from kalscope.tuning.fleet.store.left import packed
from kalscope.tuning.fleet.store.row import FAILED, Row
from kalscope.tuning.fleet.work.asked import Question
from kalscope.tuning.fleet.work.read import Series as Channel

CHOSEN = "chosen"
"""Verdict where the filter follows from the options alone."""


@dataclass(frozen=True)
class Fitted:
    """The results for some recordings."""

    rows: list[Row]
    """A row for each channel."""
    pool: Pool
    """What all of them say about one filter for all."""
    again: bool = False
    """Whether one failed for a reason other than its content: the next run tries it again."""

    @staticmethod
    def lost(row: Row, error: Exception | None = None) -> Fitted:
        """A recording that could not be read, because of this error."""
        reason = row.reason if error is None else reason_of(error)
        return Fitted([replace(row, reason=reason)], Pool.empty(), error is not None and may_pass(error))

    def lying_in(self, source: str) -> Fitted:
        """The same with the source of its rows, where they do not have it."""
        return Fitted(
            [row if row.source else replace(row, source=source) for row in self.rows], self.pool, self.again
        )


def fit_each(several: Sequence[Channel], question: Question) -> Fitted:
    """Fit some channels, one after the other. One that cannot be fitted gives a row with the reason."""
    rows: list[Row] = []
    pool, again = Pool.empty(), False
    for series in several:
        begun, row = time.thread_time(), _row(series)
        try:
            z, dt, recording = series.z, series.dt, series.recording
            request = question.request(recording)
            found = find_parameters(z, request, dt=dt, sample_period=recording.sample_period)
            row = filled(row, z, dt, found, question.gate)
            outliers = None if found.estimate is None else found.estimate.outliers
            used = z if outliers is None else np.where(outliers, np.nan, z)
            many = series_of([used], None if dt is None else [dt])
            pool = pool + pool_of(many)
            row = replace(row, left=_left(many, found))
        except Exception as error:  # whatever is wrong with one recording, the others go on
            row = replace(_row(series), reason=reason_of(error))
            again = again or may_pass(error)
        rows.append(replace(row, seconds=time.thread_time() - begun))
    return Fitted(rows, pool, again)


def _left(many: Series, found: Found) -> bytes | None:
    """What the loss of the device by a filter for all is computed from; None for one without q and r."""
    if found.params is None:
        return None
    tau = 0.0 if found.estimate is None else found.params.momentum
    own = fitted_ratios(many, many.starts[1:])
    if found.estimate is not None:
        own = np.array([found.params.q / float(found.params.r)])
    growth = held_out(many, momentum=np.array([tau > 0.0]))
    return packed(left_by(own, np.array([tau]), growth))[0]


def reason_of(error: Exception) -> str:
    """Why a recording has no q and r, in one line."""
    if isinstance(error, KalscopeError | OSError):
        return " ".join(describe(error).split())
    return " ".join(f"{type(error).__name__}: {error}".split())


def may_pass(error: BaseException | None) -> bool:
    """Whether the cause is outside of the recording: a permission, a disk, the memory, a missing library."""
    while error is not None:
        if isinstance(error, MemoryError | ImportError):
            return True
        # Readers of a broken file raise OSError without a number, or with that of an invalid position in it.
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
            return True
        error = error.__cause__ or error.__context__
    return False


def _row(series: Channel) -> Row:
    recording = series.recording
    period = recording.sample_period
    return Row(
        id=series.id,
        channel=series.channel,
        unit=recording.units[recording.index(series.channel)],
        samples=len(recording),
        rate_hz=None if period is None else 1.0 / period,
        verdict=FAILED,
        rejected_lines=recording.report.rejected,
    )


def filled(row: Row, z: Array, dt: Array | None, found: Found, gate: float | None) -> Row:
    """The row with the result of its fit.

    Args:
        row: What is known of the recording.
        z: The samples, shape (n,).
        dt: Nominal sample periods before each; None = 1 each.
        found: The result.
        gate: Outlier gate in place of the one that is found; NaN = off, None = as found.
    """
    estimate = found.estimate
    verdict = CHOSEN if estimate is None else str(estimate.verdict)
    if found.params is None:
        return replace(row, verdict=verdict, reason=first_sentence(found.message))
    params = found.params if gate is None else replace(found.params, gate=None if math.isnan(gate) else gate)
    spikes = 0 if estimate is None or estimate.outliers is None else int(np.count_nonzero(estimate.outliers))
    if estimate is not None:
        q_low, q_high, r_low, r_high = pair_intervals(estimate, z, np.empty(0) if dt is None else dt)
        row = replace(row, q_low=q_low, q_high=q_high, r_low=r_low, r_high=r_high)
    return replace(
        row,
        q=params.q,
        r=float(params.r),
        momentum=params.momentum,
        gate=params.gate,
        lag_samples=steady_state(params).lag_samples,
        verdict=verdict,
        nis=mean_nis(z, params, dt),
        spikes=spikes,
    )


def mean_nis(z: Array, params: FilterParams, dt: Array | None) -> float | None:
    """The mean of v²/s over the samples that the filter takes; None where there is none."""
    result = kalman_filter(z, params, dt)
    taken = (result.k > 0.0) & np.isfinite(result.innovation) & np.isfinite(result.s) & (result.s > 0.0)
    scored = result.innovation[taken] ** 2 / result.s[taken]
    return float(scored.mean()) if len(scored) else None


def first_sentence(text: str) -> str:
    """The text up to its first full stop, without it."""
    return text.split(". ", 1)[0].rstrip(".")
