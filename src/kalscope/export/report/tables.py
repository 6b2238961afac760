"""The tables of a report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kalscope.analysis.alternatives import Comparison
from kalscope.analysis.diagnostics import Diagnostics, expected_nis
from kalscope.common.array import Array
from kalscope.common.text import (
    correlation,
    count,
    decibels,
    frequency,
    lag_in_full,
    lag_text,
    number,
    p_value,
    percent,
    squared,
    trimmed,
)
from kalscope.filtering.filter import FilterResult
from kalscope.filtering.steady_state import SteadyState
from kalscope.tuning.tuning import ChannelTuning

Rows = tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class ReportTable:
    """Rows of cells."""

    heading: str
    """Above it."""
    rows: Rows
    """Equally long rows, the name first; none = the table is left out."""
    columns: tuple[str, ...] = ()
    """Column headings; () = names and values, which need none."""


def parameters(own: ChannelTuning, period: float | None) -> Rows:
    """The numbers of the filter and how they were found."""
    unit = squared(own.unit)
    if own.chain is not None and own.chain.then is not None:
        return ("filter", own.chain.words), ("found", own.how)
    rows = [
        *(() if own.chain is None else (("filter", own.chain.words),)),
        ("process noise q", f"{trimmed(own.q, 4)} {unit} per sample"),
        *(() if own.sensors else (("measurement noise r", f"{trimmed(own.r, 4)} {unit}"),)),
        ("initial variance p0", "automatic (diffuse)" if own.p0 is None else f"{trimmed(own.p0, 4)} {unit}"),
        ("initial estimate x0", "first sample" if own.x0 is None else f"{trimmed(own.x0, 4)} {own.unit}".strip()),
    ]
    if own.momentum > 0.0:
        rows.insert(-2, ("momentum τ", lag_in_full(own.momentum, period)))
    if own.gate is not None:
        rows.append(("outlier gate on v²/s", trimmed(own.gate)))
    return (*rows, ("found", own.how))


def meaning(steady: SteadyState, result: FilterResult | FilterResult, period: float | None, error: str) -> Rows:
    """What the settled filter does; `error` is its RMSE in words, "" where the truth is not known."""
    lag, settle = steady.lag_samples, steady.settle_samples
    rows = [
        ("lag", lag_in_full(lag, period)),
        ("noise reduction", decibels(steady.noise_reduction_db)),
        *([] if math.isnan(steady.p) else [("gain K", number(steady.gain))]),
        ("settling time (to 1 %)", lag_in_full(settle, period)),
    ]
    if result.m:
        rows.append(("log-likelihood", f"{number(float(result.loglik), 6)} of {count(int(result.m))} samples"))
    if error:
        rows.append(("RMSE to the truth", error))
    if steady.velocity_gain:
        rows.insert(2, ("overshoot on a step", percent(steady.overshoot)))
    if steady.cutoff_hz is not None and math.isfinite(float(steady.cutoff_hz)):
        rows.insert(2, ("cut-off (−3 dB)", frequency(float(steady.cutoff_hz))))
    return tuple(rows)


def residual_tests(d: Diagnostics) -> Rows:
    """What the residuals show beside what a fitting filter would show."""
    return (
        ("mean NIS", f"{number(d.nis)}, expected: {expected_nis(d)}"),
        ("lag-1 autocorrelation", f"{correlation(d.r1)}, expected: within ±{correlation(d.r1_bound)}"),
        ("Ljung-Box test", f"{p_value(d.ljung_box_p)}, expected: above 0.05"),
        (
            "beyond 4 σ",
            f"{count(d.spikes)}, {count(d.jumps)} of them jumps; expected {number(d.spikes_expected, 2)}",
        ),
        ("last third over first third", f"variance × {number(d.variance_ratio)}, {p_value(d.variance_ratio_p)}"),
    )


def simpler_filters(found: Comparison) -> ReportTable:
    """Side by side; with their overshoot where the present one overshoots."""
    rows: list[tuple[str, ...]] = []
    beyond = found.present.overshoot > 0.0
    for one in (found.present, *found.others):
        error = one.prediction if one.rmse is None else one.rmse
        decibel = "–" if math.isnan(one.noise_reduction_db) else decibels(one.noise_reduction_db)
        overshoot = "–" if math.isnan(one.overshoot) else percent(one.overshoot)
        last = "–" if error is None else number(error)
        rows.append((one.name, number(one.lag_samples), decibel, *((overshoot,) if beyond else ()), last))
    error = "next sample" if found.present.rmse is None else "RMSE"
    heading = "Simpler filters, at this lag"
    columns = ("", "lag", "dB", *(("overshoot",) if beyond else ()), error)
    return ReportTable(heading, tuple(rows) if found.others else (), columns)


def pinned_settings(
    own: ChannelTuning,
    pins: Sequence[tuple[str, ChannelTuning]],
    z: Array,
    dt: Array | None,
    truth: Array | None,
    period: float | None,
) -> ReportTable:
    """The present setting and the pinned ones of the channel, by name."""
    rows: list[tuple[str, ...]] = []
    for name, one in (("current", own), *pins) if pins else ():
        result = one.filter.run(z, dt)
        steady, chain = one.filter.settled(result, period), one.chain
        label = f"{name}, τ {number(one.momentum)}" if one.momentum > 0.0 else name
        label = label if chain is None else f"{name}: {chain.words}"
        used = (number(one.q), number(one.r)) if chain is None or chain.then is None else ("–", "–")
        likely = "–" if chain else number(float(result.loglik), 6)
        last = likely if truth is None else number(rmse(result.x, truth))
        lag, reduction = lag_text(steady.lag_samples, period), decibels(-steady.noise_reduction_db)
        rows.append((label, *used, lag, reduction, last))
    last = "log-likelihood" if truth is None else "RMSE"
    return ReportTable("Pinned settings", tuple(rows), ("", "q", "r", "lag", "noise", last))


def rmse(x: Array, truth: Array) -> float:
    """Root mean square of filtered − truth, unit; NaN where no sample has both."""
    error = x - truth
    error = error[np.isfinite(error)]
    return math.sqrt(float(np.mean(error * error))) if len(error) else math.nan
