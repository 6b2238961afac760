"""The content of a report, computed once from a recording and a tuning, for HTML and PNG."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from kalscope.analysis.actions import as_sentences
from kalscope.analysis.alternatives.comparison import Comparison, compare_alternatives
from kalscope.analysis.diagnostics import Diagnostics, diagnose
from kalscope.analysis.fit.goal import request_in
from kalscope.analysis.judgement import Judgement, advice_words, judge
from kalscope.common.array import Array
from kalscope.common.charts import Line, Panel
from kalscope.common.text import (
    correlation,
    count,
    decibels,
    frequency,
    lag_in_full,
    number,
    p_value,
    percent,
    sample_rate,
    squared,
    trimmed,
)
from kalscope.common.version import program
from kalscope.errors import BadSetting
from kalscope.filtering.batch import FilterResult, kalman_filter
from kalscope.filtering.steady_state import SteadyState, steady_state
from kalscope.recording import Recording
from kalscope.sources.readers.account import summary, warnings
from kalscope.tuning.tuning import ChannelTuning, Tuning

Rows = tuple[tuple[str, ...], ...]

MAX_DRAWN_POINTS = 1500
"""Points of a curve, approximately."""

MAX_DETAIL_SAMPLES = 240
"""Samples of the detail; a recording of fewer has none."""


@dataclass(frozen=True)
class ReportTable:
    """Rows of cells."""

    heading: str
    """Above it."""
    rows: Rows
    """Equally long rows, the name first; none = the table is left out."""
    columns: tuple[str, ...] = ()
    """What stands above the columns; () = names and values, which need no words."""


@dataclass(frozen=True)
class Report:
    """Everything on the page, as text and curves. Texts from outside are raw: escape them when drawing."""

    title: str
    """Recording and channel."""
    subtitle: str
    """Samples, rate, what is missing."""
    charts: tuple[Panel, ...]
    """The whole recording, then a detail where that helps."""
    tables: tuple[ReportTable, ...]
    """Parameters, what they do, tests, simpler filters."""
    texts: tuple[tuple[str, str], ...]
    """Headings with a few sentences: does it fit, is there a simpler filter."""
    command: str
    """Reopens this state."""
    origin: Rows
    """File, SHA-256, versions, date."""


def make_report(
    recording: Recording,
    tuning: Tuning,
    channel: str | None = None,
    *,
    config: str = "tuning.toml",
    options: Sequence[str] = (),
    now: datetime | None = None,
) -> Report:
    """The report on one channel.

    Args:
        recording: the data.
        tuning: its filters, at the recording's sample period.
        channel: which one; None = the selected, else the first.
        config: name of the tuning file in the command.
        options: more words of the command, where the filter is not that of the file.
        now: time to print; None = now. Everything else is the same in every run.

    Raises:
        BadSetting: the recording or the tuning has no such channel.
    """
    name = channel or tuning.selected or tuning.channels[0].name
    own = tuning.channel(name)
    if not len(recording):
        raise BadSetting("a report must have samples to show (got none)")
    column = recording.index(name)
    z = recording.channel(name)
    truth = None if recording.truth is None else recording.truth[:, column]
    dt = recording.steps() if recording.gaps == "dt" else None
    result = kalman_filter(z, own.params, dt)
    steady = steady_state(own.params, recording.sample_period)
    found = compare_alternatives(z, own.params, dt=dt, truth=truth)
    judged = diagnose(result)
    checks = judged if isinstance(judged, Diagnostics) else judged[0]
    return Report(
        title=f"{recording.title or recording.source or 'Recording'}: {name}",
        subtitle=_subtitle(recording, z),
        charts=_charts(recording, own, z, result, truth),
        tables=(
            ReportTable("Parameters", _parameters(own, recording.sample_period)),
            ReportTable("Resulting filter", _meaning(steady, result, recording.sample_period)),
            ReportTable("Residuals", _tests(checks)),
            _filters(found),
        ),
        texts=(
            ("Does the filter fit?", _fits(judge(checks, request=request_in(own.how, own.r)))),
            ("Is there a simpler filter?", f"{found.verdict} {found.identity}".strip()),
        ),
        command=_command(recording, config, options),
        origin=_origin(recording, tuning, now),
    )


def _fits(judgement: Judgement) -> str:
    advice = f" {as_sentences(advice_words(judgement))}" if judgement.advice else ""
    return f"{judgement.headline}{advice}"


def _subtitle(recording: Recording, z: Array) -> str:
    parts = [f"{count(len(z))} samples"]
    if recording.sample_period is not None:
        parts.append(sample_rate(recording.sample_period))
    missing = int(np.isnan(z).sum())
    if missing:
        parts.append(f"{count(missing)} missing")
    return ", ".join(parts)


def _parameters(own: ChannelTuning, period: float | None) -> Rows:
    unit = squared(own.unit)
    rows = [
        ("process noise q", f"{trimmed(own.q, 4)} {unit} per sample"),
        ("measurement noise r", f"{trimmed(own.r, 4)} {unit}"),
        ("initial variance p0", "automatic (diffuse)" if own.p0 is None else f"{trimmed(own.p0, 4)} {unit}"),
        ("initial estimate x0", "first sample" if own.x0 is None else f"{trimmed(own.x0, 4)} {own.unit}".strip()),
    ]
    if own.momentum > 0.0:
        rows.insert(2, ("momentum τ", lag_in_full(own.momentum, period)))
    if own.gate is not None:
        rows.append(("outlier gate on v²/s", trimmed(own.gate)))
    return (*rows, ("found", own.how))


def _meaning(steady: SteadyState, result: FilterResult, period: float | None) -> Rows:
    lag, settle = float(steady.lag_samples), float(steady.settle_samples)
    rows = [
        ("lag", lag_in_full(lag, period)),
        ("noise reduction", decibels(float(steady.noise_reduction_db))),
        ("gain K", number(float(steady.gain))),
        ("settling time (to 1 %)", lag_in_full(settle, period)),
        ("log-likelihood", f"{number(float(result.loglik), 6)} of {count(int(result.m))} samples"),
    ]
    if steady.velocity_gain:
        rows.insert(2, ("overshoot on a step", percent(float(steady.overshoot))))
    if steady.cutoff_hz is not None and math.isfinite(float(steady.cutoff_hz)):
        rows.insert(2, ("cut-off (−3 dB)", frequency(float(steady.cutoff_hz))))
    return tuple(rows)


def _tests(d: Diagnostics) -> Rows:
    return (
        ("mean NIS", f"{number(d.nis)}, expected: {number(d.nis_low)} to {number(d.nis_high)}"),
        ("lag-1 autocorrelation", f"{correlation(d.r1)}, expected: within ±{correlation(d.r1_bound)}"),
        ("Ljung-Box test", f"{p_value(d.ljung_box_p)}, expected: above 0.05"),
        (
            "beyond 4 σ",
            f"{count(d.spikes)}, {count(d.jumps)} of them jumps; expected {number(d.spikes_expected, 2)}",
        ),
        ("last third over first third", f"variance × {number(d.variance_ratio)}, {p_value(d.variance_ratio_p)}"),
    )


def _filters(found: Comparison) -> ReportTable:
    """Beside each other; with their overshoot where the present one overshoots."""
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


def _command(recording: Recording, config: str, options: Sequence[str]) -> str:
    source = recording.source or "FILE"
    return shlex.join(["kalscope", "open", source, *recording.report.options, "--config", config, *options])


def _origin(recording: Recording, tuning: Tuning, now: datetime | None) -> Rows:
    moment = (now or datetime.now(UTC)).astimezone(UTC)
    rows = [
        ("data", recording.source or recording.title),
        ("read as", summary(recording)),
        *(("warning", sentence) for sentence in warnings(recording)),
        ("SHA-256", recording.sha256 or "none: the data were generated"),
        ("tuned with", f"{tuning.tool or 'unknown'}, {tuning.date or 'no date'}"),
        ("made with", f"{program()}, numpy {version('numpy')}, scipy {version('scipy')}"),
        ("date", f"{moment:%Y-%m-%d %H:%M} UTC"),
    ]
    return tuple(rows)


def _charts(
    recording: Recording, own: ChannelTuning, z: Array, result: FilterResult, truth: Array | None
) -> tuple[Panel, ...]:
    n, timed = len(z), recording.sample_period is not None
    x = np.maximum.accumulate(recording.time) if timed else np.arange(n, dtype=np.float64)
    named = [("raw", z, "raw"), ("filtered", result.x, "s2")]
    if truth is not None:
        named.insert(1, ("truth", truth, "truth"))

    def panel(title: str, first: int, stop: int) -> Panel:
        at = first + _chosen(z[first:stop])
        across, at = (x[at], at) if len(at) > 1 else (x[0] + np.arange(2.0), [0, 0])  # a line needs two points
        lines = tuple(Line(across, values[at], name, style) for name, values, style in named)
        low_high = _y_range([values[at] for name, values, _ in named if name != "filtered"])
        return Panel(title, lines, "time (s)" if timed else "sample", _label(own.name, own.unit), low_high)

    whole = panel("The whole recording", 0, n)
    if n < 2 * MAX_DETAIL_SAMPLES:
        return (whole,)
    first = (n - MAX_DETAIL_SAMPLES) // 2
    return whole, panel(
        f"Detail: samples {first} to {first + MAX_DETAIL_SAMPLES - 1}", first, first + MAX_DETAIL_SAMPLES
    )


def _y_range(curves: list[Array]) -> tuple[float, float]:
    """Ends of the ordinate: what raw and truth need; a wild start of the filter may leave the picture."""
    seen = np.concatenate(curves)
    seen = seen[np.isfinite(seen)]
    low, high = (float(seen.min()), float(seen.max())) if len(seen) else (0.0, 1.0)
    room = 0.06 * (high - low) or 0.5 * abs(high) or 1.0
    return low - room, high + room


def _label(name: str, unit: str) -> str:
    """Name and unit, short enough to stand beside a low chart."""
    short = name if len(name) <= 10 else f"{name[:9]}…"
    return f"{short} ({unit[:8]})" if unit else short


def _chosen(z: Array) -> NDArray[np.intp]:
    """Indices of the lowest and the highest sample of each of MAX_DRAWN_POINTS/2 equal pieces."""
    if len(z) <= MAX_DRAWN_POINTS:
        return np.arange(len(z))
    edges = np.linspace(0, len(z), MAX_DRAWN_POINTS // 2 + 1).astype(int)
    kept = {0, len(z) - 1}
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        piece = z[first:last]
        if np.isfinite(piece).any():
            kept.update((first + int(np.nanargmin(piece)), first + int(np.nanargmax(piece))))
        else:
            kept.add(first)
    return np.array(sorted(kept))
