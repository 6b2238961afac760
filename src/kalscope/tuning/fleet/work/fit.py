"""The fit of a channel as a row of the table."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from kalscope.common.array import Array
from kalscope.errors import KalscopeError, describe
from kalscope.estimation.finding import Found, find_parameters
from kalscope.filtering.arrays import scalar
from kalscope.filtering.batch import kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state
from kalscope.tuning.fleet.store.row import FAILED, Row
from kalscope.tuning.fleet.work.asked import Question
from kalscope.tuning.fleet.work.read import Series

CHOSEN = "chosen"
"""Verdict where the filter follows from the options alone."""


def fit(series: Series, question: Question) -> Row:
    """The row of one channel. A channel that cannot be fitted gives one with the reason, never an exception."""
    begun = time.thread_time()
    try:
        row = _fitted(series, question)
    except Exception as error:  # whatever is wrong with one recording, the others go on
        row = replace(_row(series), reason=reason_of(error))
    return replace(row, seconds=time.thread_time() - begun)


def reason_of(error: Exception) -> str:
    """Why a recording has no row of its own, in one line."""
    if isinstance(error, KalscopeError | OSError):
        return " ".join(describe(error).split())
    return " ".join(f"{type(error).__name__}: {error}".split())


def _row(series: Series) -> Row:
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


def _fitted(series: Series, question: Question) -> Row:
    z, dt, recording = series.z, series.dt, series.recording
    found = find_parameters(z, question.request(recording), dt=dt, sample_period=recording.sample_period)
    return filled(_row(series), z, dt, found, question.gate)


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
        return replace(row, verdict=verdict, reason=_first_sentence(found.message))
    params = found.params if gate is None else replace(found.params, gate=None if math.isnan(gate) else gate)
    spikes = 0 if estimate is None or estimate.outliers is None else int(np.count_nonzero(estimate.outliers))
    return replace(
        row,
        q=scalar(params.q),
        r=scalar(params.r),
        momentum=scalar(params.momentum),
        gate=None if params.gate is None else scalar(params.gate),
        lag_samples=scalar(steady_state(params).lag_samples),
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


def _first_sentence(text: str) -> str:
    return text.split(". ", 1)[0].rstrip(".")
