"""The content of a report, computed once from a recording and a tuning, for HTML and PNG."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from kalscope.analysis.alternatives import compare_alternatives
from kalscope.analysis.diagnostics import Diagnostics, diagnose_run, without_residuals
from kalscope.analysis.findings import as_sentences, request_in, still_met
from kalscope.analysis.judge import advice_words, judge
from kalscope.analysis.residuals import Run
from kalscope.common.array import Array
from kalscope.common.charts import Line, Panel
from kalscope.common.text import (
    count,
    number,
    sample_rate,
)
from kalscope.common.version import program
from kalscope.errors import BadSetting
from kalscope.export.report.tables import (
    ReportTable,
    Rows,
    meaning,
    parameters,
    pinned_settings,
    residual_tests,
    rmse,
    simpler_filters,
)
from kalscope.filtering.filter import FilterResult
from kalscope.recording import Recording
from kalscope.sources.readers.account import summary, warnings
from kalscope.tuning.tuning import ChannelTuning, Tuning

MAX_DRAWN_POINTS = 1500
"""Points of a curve, approximately."""

UNJUDGED = "The tests are for the Kalman filter alone: a chain of filters is not a model of the signal."
"""What is shown instead of the verdict on a chain."""

MAX_DETAIL_SAMPLES = 240
"""Samples of the detail; a recording of less than twice as many has none."""


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
    """Parameters, what they do, tests, simpler filters, pinned settings."""
    texts: tuple[tuple[str, str], ...]
    """Headings with a few sentences: does it fit, is there a simpler filter."""
    command: str
    """Reopens this state."""
    origin: Rows
    """File, SHA-256, versions, date."""

    @property
    def table_columns(self) -> tuple[tuple[ReportTable, ...], ...]:
        """The tables that have rows, for the left and the right column of the page."""
        return tuple(tuple(one for one in self.tables[side::2] if one.rows) for side in (0, 1))


def make_report(
    recording: Recording,
    tuning: Tuning,
    channel: str | None = None,
    *,
    config: str = "tuning.toml",
    options: Sequence[str] = (),
    now: datetime | None = None,
    command: str = "",
    pins: Sequence[tuple[str, ChannelTuning]] = (),
) -> Report:
    """The report on one channel.

    Args:
        recording: the data.
        tuning: its filters, at the recording's sample period.
        channel: which one; None = the selected, else the first.
        config: name of the tuning file in the command.
        options: more words of the command, where the filter is not that of the file.
        now: time to print; None = now. Everything else is the same in every run.
        command: what reopens this state; "" = with the tuning file `config`.
        pins: names and settings of the channel to show beside the present one.

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
    judged, texts = _judged(recording, own, z, dt, truth)  # before the run is kept: memory
    result = own.filter.run(z, dt)
    steady = own.filter.settled(result, recording.sample_period)
    error = "" if truth is None else f"{number(rmse(result.x, truth))} {own.unit}".strip()
    return Report(
        title=f"{recording.title or recording.source or 'Recording'}: {name}",
        subtitle=subtitle_of(recording, z),
        charts=_charts(recording, own, z, result, truth),
        tables=(
            ReportTable("Parameters", parameters(own, recording.sample_period)),
            ReportTable("Resulting filter", meaning(steady, result, recording.sample_period, error)),
            *judged,
            pinned_settings(own, pins, z, dt, truth, recording.sample_period),
        ),
        texts=texts,
        command=command or command_of(recording, config, options),
        origin=origin_of(recording, tuning, now),
    )


def _judged(
    recording: Recording, own: ChannelTuning, z: Array, dt: Array | None, truth: Array | None
) -> tuple[tuple[ReportTable, ...], tuple[tuple[str, str], ...]]:
    """The tables and the texts on how well the filter fits, and on simpler ones; of a chain there are none."""
    if own.chain is not None:
        return (), (("Does the filter fit?", UNJUDGED),)
    checks = without_residuals(diagnose_run(Run.of_samples(z, own.params, dt)))
    found = compare_alternatives(z, own.params, dt=dt, truth=truth)
    texts = (
        ("Does the filter fit?", _fits(own, checks, recording.sample_period)),
        ("Is there a simpler filter?", f"{found.verdict} {found.identity}".strip()),
    )
    return (ReportTable("Residuals", residual_tests(checks)), simpler_filters(found)), texts


def _fits(own: ChannelTuning, checks: Diagnostics, period: float | None) -> str:
    judgement = judge(checks, request=still_met(request_in(own.how, own.r), own.params, period))
    advice = f" {as_sentences(advice_words(judgement))}" if judgement.findings else ""
    return f"{judgement.headline}{advice}"


def subtitle_of(recording: Recording, z: Array) -> str:
    """How much there is of the samples z, in a few words."""
    parts = [f"{count(len(z))} samples"]
    if recording.sample_period is not None:
        parts.append(sample_rate(recording.sample_period))
    missing = int(np.isnan(z).sum())
    if missing:
        parts.append(f"{count(missing)} missing")
    return ", ".join(parts)


def command_of(recording: Recording, config: str, options: Sequence[str]) -> str:
    """What reopens the recording with a tuning file."""
    source = recording.source or "FILE"
    return shlex.join(["kalscope", "open", source, *recording.report.options, "--config", config, *options])


def origin_of(recording: Recording, tuning: Tuning, now: datetime | None) -> Rows:
    """File, SHA-256, versions, date."""
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
        at = first + chosen_samples(z[first:stop])
        across, at = (x[at], at) if len(at) > 1 else (x[0] + np.arange(2.0), [0, 0])  # a line needs two points
        lines = tuple(Line(across, values[at], name, style) for name, values, style in named)
        low_high = y_range([values[at] for name, values, _ in named if name != "filtered"])
        return Panel(title, lines, "time (s)" if timed else "sample", _label(own.name, own.unit), low_high)

    whole = panel("The whole recording", 0, n)
    if n < 2 * MAX_DETAIL_SAMPLES:
        return (whole,)
    first = (n - MAX_DETAIL_SAMPLES) // 2
    return whole, panel(
        f"Detail: samples {first} to {first + MAX_DETAIL_SAMPLES - 1}", first, first + MAX_DETAIL_SAMPLES
    )


def y_range(curves: list[Array]) -> tuple[float, float]:
    """Ends of the ordinate: what raw and truth need; a wild start of the filter may leave the picture."""
    seen = np.concatenate(curves)
    seen = seen[np.isfinite(seen)]
    low, high = (float(seen.min()), float(seen.max())) if len(seen) else (0.0, 1.0)
    room = 0.06 * (high - low) or 0.5 * abs(high) or 1.0
    return low - room, high + room


def _label(name: str, unit: str) -> str:
    """Name and unit, short enough to fit beside a low chart."""
    short = name if len(name) <= 10 else f"{name[:9]}…"
    return f"{short} ({unit[:8]})" if unit else short


def chosen_samples(z: Array) -> NDArray[np.intp]:
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
