"""The report on a recording and its tuning, on one page of HTML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kalscope.analysis.alternatives import Comparison, compare_alternatives
from kalscope.analysis.diagnostics import diagnose_run, residual_rows, without_residuals
from kalscope.analysis.findings import advice_text, as_sentences, request_in, still_met
from kalscope.analysis.fused import judge_fusion
from kalscope.analysis.judge import judge
from kalscope.analysis.residuals import Run
from kalscope.common.charts import Line, Panel, document, draw_svg, markup_of_table
from kalscope.common.numbers import Array
from kalscope.common.text import (
    command_line,
    count,
    decibels,
    frequency,
    lag_in_full,
    lag_text,
    noise_left,
    number,
    percent,
    program,
    sample_rate,
    squared,
    trimmed,
)
from kalscope.errors import BadSetting
from kalscope.filtering.filter import FilterResult
from kalscope.filtering.steady import SteadyState
from kalscope.recording import Recording
from kalscope.sources.reading.account import summary, warnings
from kalscope.tuning.tuning import ChannelTuning, Tuning

# The tables of a report.


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


def parameters(entry: ChannelTuning, period: float | None) -> Rows:
    """The numbers of the filter and how they were found."""
    unit, words = squared(entry.unit), "" if entry.chain is None else entry.chain.words
    if entry.chain is not None and entry.chain.then is not None:
        return ("filter", words), ("found", entry.how)
    x0 = "first sample" if entry.x0 is None else f"{trimmed(entry.x0, 4)} {entry.unit}".strip()
    return _filled(
        ("filter", words),
        ("process noise q", f"{trimmed(entry.q, 4)} {unit} per sample"),
        ("measurement noise r", "" if entry.sensors else f"{trimmed(entry.r, 4)} {unit}"),
        ("two speeds", "" if entry.fast is None else f"q grows {trimmed(entry.fast, 4)} × while the signal moves"),
        ("momentum τ", lag_in_full(entry.momentum, period) if entry.momentum else ""),
        ("initial variance p0", "automatic (diffuse)" if entry.p0 is None else f"{trimmed(entry.p0, 4)} {unit}"),
        ("initial estimate x0", x0),
        ("outlier gate on v²/s", "" if entry.gate is None else trimmed(entry.gate)),
        ("found", entry.how),
    )


def meaning(steady: SteadyState, result: FilterResult, period: float | None, error: str) -> Rows:
    """What the settled filter does; `error` is its RMSE in words, "" where the truth is not known."""
    cutoff, likely = steady.cutoff_hz, f"{number(float(result.loglik), 6)} of {count(int(result.m))} samples"
    return _filled(
        ("lag", lag_in_full(steady.lag_samples, period)),
        ("noise left", noise_left(steady.noise_reduction_db)),
        ("cut-off (−3 dB)", "" if cutoff is None or not math.isfinite(cutoff) else frequency(float(cutoff))),
        ("overshoot on a step", percent(steady.overshoot) if steady.velocity_gain else ""),
        ("gain K", "" if math.isnan(steady.p) else number(steady.gain)),
        ("settling time (to 1 %)", lag_in_full(steady.settle_samples, period)),
        ("log-likelihood", likely if result.m else ""),
        ("RMSE to the truth", error),
    )


def _filled(*rows: tuple[str, str]) -> Rows:
    """Those that have a value."""
    return tuple(row for row in rows if row[1])


def simpler_filters(comparison: Comparison) -> ReportTable:
    """Side by side."""
    rows: list[tuple[str, ...]] = []
    for one in (comparison.present, *comparison.others):
        error = one.prediction if one.rmse is None else one.rmse
        noise = "–" if math.isnan(one.noise_reduction_db) else decibels(one.noise_reduction_db)
        overshoot = "–" if math.isnan(one.overshoot) else percent(one.overshoot)
        rows.append((one.name, number(one.lag_samples), noise, overshoot, "–" if error is None else number(error)))
    columns = ("", "lag", "dB", "overshoot", "next sample" if comparison.present.rmse is None else "RMSE")
    return ReportTable("Simpler filters, at this lag (samples)", tuple(rows) if comparison.others else (), columns)


def pinned_settings(
    entry: ChannelTuning,
    pins: Sequence[tuple[str, ChannelTuning]],
    z: Array,
    dt: Array | None,
    truth: Array | None,
    period: float | None,
) -> ReportTable:
    """The present setting and the pinned ones of the channel, by name."""
    rows: list[tuple[str, ...]] = []
    for name, one in (("current", entry), *pins) if pins else ():
        result = one.filter.run(z, dt)
        steady, chain = one.filter.settled(result, period), one.chain
        label = f"{name}, τ {number(one.momentum)}" if one.momentum > 0.0 else name
        label = label if chain is None else f"{name}: {chain.words}"
        used = (number(one.q), number(one.r)) if chain is None or chain.then is None else ("–", "–")
        likely = "–" if chain else number(float(result.loglik), 6)
        last = likely if truth is None else number(rmse(result.x, truth))
        lag, left = lag_text(steady.lag_samples, period), noise_left(steady.noise_reduction_db)
        rows.append((label, *used, lag, left, last))
    last = "log-likelihood" if truth is None else "RMSE"
    return ReportTable("Pinned settings", tuple(rows), ("", "q", "r", "lag", "noise left", last))


def rmse(x: Array, truth: Array) -> float:
    """Root mean square of filtered − truth, unit; NaN where no sample has both."""
    error = x - truth
    error = error[np.isfinite(error)]
    return math.sqrt(float(np.mean(error * error))) if len(error) else math.nan


# The content of a report, computed once from a recording and a tuning.


MAX_DRAWN_POINTS = 1500
"""Points of a curve, approximately."""

UNJUDGED = "The tests are for the Kalman filter alone: a chain of filters is not a model of the signal."
"""What is shown instead of the verdict on a chain."""

STYLES = ("raw", "s1", "s3", "s4")
"""Of the sensors, from the first; the fused value is s2."""

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


def make_report(
    recording: Recording,
    tuning: Tuning,
    channel: str | None = None,
    *,
    fusion: ChannelTuning | None = None,
    config: str = "tuning.toml",
    now: datetime | None = None,
    command: str = "",
    pins: Sequence[tuple[str, ChannelTuning]] = (),
) -> Report:
    """The report on one channel, or on sensors that are fused.

    Args:
        recording: the data.
        tuning: its filters, at the recording's sample period.
        channel: which one; None = the selected, else the first.
        fusion: the filter and its sensors, at the recording's sample period; None = the report is on a channel.
        config: name of the tuning file in the command.
        now: time to print; None = now. Everything else is the same in every run.
        command: what reopens this state; "" = with the tuning file `config`.
        pins: names and settings of the channel to show beside the present one.

    Raises:
        BadSetting: the recording or the tuning has no such channel or sensor, or there are no samples.
    """
    shown = fusion or tuning.channel(channel or tuning.selected or tuning.channels[0].name)
    if not len(recording):
        raise BadSetting("a report must have samples to show (got none)")
    z, sources, period = shown.readings(recording), shown.sensors or (shown.name,), recording.sample_period
    truth = None if recording.truth is None else recording.truth[:, recording.index(sources[0])]
    dt = recording.steps() if recording.gaps == "dt" else None
    judged, texts = (_judged_fusion if shown.sensors else _judged)(
        shown, z, dt, period, truth
    )  # before the run is kept: memory
    result = shown.filter.run(z, dt)
    error = "" if truth is None else f"{number(rmse(result.x, truth))} {shown.unit}".strip()
    effect = meaning(shown.filter.settled(result, period), result, period, error)
    values = ReportTable("Parameters", parameters(shown, period))
    pinned = pinned_settings(shown, pins, z, dt, truth, period)
    if shown.sensors:
        tables = (*judged, ReportTable("While all sensors answer", effect), values, pinned)
    else:
        tables = (values, ReportTable("Resulting filter", effect), *judged, pinned)
    source = recording.source or "FILE"
    reopened = ["kalscope", "open", source, *recording.report.options, "--config", config]
    return Report(
        title=f"{recording.title or recording.source or 'Recording'}: {' + '.join(sources)}",
        subtitle=_subtitle(recording, result.x if shown.sensors else z),
        charts=_charts(recording, shown, z, result, truth),
        tables=tables,
        texts=texts,
        command=command or command_line(reopened),
        origin=_origin(recording, tuning, now),
    )


Judged = tuple[tuple[ReportTable, ...], tuple[tuple[str, str], ...]]
"""Tables, and texts with their headings."""


def _judged_fusion(
    fusion: ChannelTuning, z: Array, dt: Array | None, period: float | None, _: Array | None
) -> Judged:
    """A row per sensor, with a gain in place of the error alone where there are any; and what fusing is worth."""
    verdict = judge_fusion(z, fusion.params, dt, names=fusion.sensors, unit=fusion.unit, sample_period=period)
    rows = tuple(
        (
            one.name,
            number(math.sqrt(fusion.r[i])),
            number(fusion.offset[i]),
            number(fusion.gain[i] if fusion.has_gains else one.error),
            percent(one.share),
            number(one.error_without),
        )
        for i, one in enumerate(verdict.sensors)
    )
    heading = f"Sensors ({fusion.unit})" if fusion.unit else "Sensors"
    columns = ("", "noise σ", "offset", "gain" if fusion.has_gains else "alone", "share", "without")
    failing = " ".join(sentence for one in verdict.sensors for sentence in one.if_it_fails)
    texts = ("What does fusing bring?", " ".join(verdict.sentences)), ("If a sensor fails", failing)
    return (ReportTable(heading, rows, columns),), texts


def _judged(entry: ChannelTuning, z: Array, dt: Array | None, period: float | None, truth: Array | None) -> Judged:
    """The tables and the texts on how well the filter fits, and on simpler ones; of a chain there are none."""
    if entry.chain is not None:
        return (), (("Does the filter fit?", UNJUDGED),)
    checks = without_residuals(diagnose_run(Run.of_samples(z, entry.params, dt)))
    comparison = compare_alternatives(z, entry.params, dt=dt, truth=truth)
    judgement = judge(checks, request=still_met(request_in(entry.how, entry.r), entry.params, period))
    advice = as_sentences(advice_text(judgement.findings)) if judgement.findings else ""
    texts = (
        ("Does the filter fit?", f"{judgement.headline} {advice}".rstrip()),
        ("Is there a simpler filter?", f"{comparison.verdict} {comparison.identity}".strip()),
    )
    return (
        ReportTable("Residuals", residual_rows(checks), ("", "measured", "expected")),
        simpler_filters(comparison),
    ), texts


def _subtitle(recording: Recording, z: Array) -> str:
    """How much there is of the samples z, in a few words."""
    missing = int(np.isnan(z).sum())
    period = recording.sample_period
    parts = (f"{count(len(z))} samples", "" if period is None else sample_rate(period))
    return ", ".join(filter(None, (*parts, f"{count(missing)} missing" if missing else "")))


def _origin(recording: Recording, tuning: Tuning, now: datetime | None) -> Rows:
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
    recording: Recording, entry: ChannelTuning, z: Array, result: FilterResult, truth: Array | None
) -> tuple[Panel, ...]:
    """The whole recording, and a detail from the middle of a long one."""
    measured = [("raw", z, "raw"), *(() if truth is None else (("truth", truth, "truth"),))]
    if entry.sensors:
        measured = [(name, z[:, i], STYLES[i % len(STYLES)]) for i, name in enumerate(entry.sensors)]
    curves = (*measured, (entry.name if entry.sensors else "filtered", result.x, "s2"))
    n, timed = len(recording), recording.sample_period is not None
    x = np.maximum.accumulate(recording.time) if timed else np.arange(n, dtype=np.float64)
    first = (n - MAX_DETAIL_SAMPLES) // 2
    last = first + MAX_DETAIL_SAMPLES - 1
    parts = {"The whole recording": slice(0, n), f"Detail: samples {first} to {last}": slice(first, last + 1)}
    short = entry.name if len(entry.name) <= 10 else f"{entry.name[:9]}…"  # fits beside a low chart
    return tuple(
        Panel(
            title,
            tuple(_line(x[part], y[part], name, style, bridged=bool(entry.sensors)) for name, y, style in curves),
            "time (s)" if timed else "sample",
            f"{short} ({entry.unit[:8]})" if entry.unit else short,
        )
        for title, part in list(parts.items())[: 1 if n < 2 * MAX_DETAIL_SAMPLES else 2]
    )


def _line(x: Array, y: Array, name: str, style: str, *, bridged: bool) -> Line:
    """A curve of few points, broken where a sample is missing unless that is `bridged`."""
    if bridged and np.isfinite(y).any():
        x, y = x[np.isfinite(y)], y[np.isfinite(y)]
    if len(y) == 1:  # axes need two ends
        x, y = x + np.arange(2.0), np.repeat(y, 2)
    kept = chosen_samples(y)
    return Line(x[kept], y[kept], name, style)


def chosen_samples(z: Array) -> NDArray[np.intp]:
    """Indices of the ends, and of the lowest and the highest sample of each of MAX_DRAWN_POINTS/2 equal pieces."""
    if len(z) <= MAX_DRAWN_POINTS:
        return np.arange(len(z))
    low, high = (np.where(np.isfinite(z), z, beyond) for beyond in (np.inf, -np.inf))
    pieces = np.array_split(np.arange(len(z)), MAX_DRAWN_POINTS // 2)
    extremes = [piece[at] for piece in pieces for at in (low[piece].argmin(), high[piece].argmax())]
    return np.unique([0, *extremes, len(z) - 1])


# The report as one HTML file that needs nothing else, made to print on one sheet of A4.


def as_html(report: Report) -> str:
    """The page as text; every word from outside is escaped, and the page may load and run nothing."""
    height = (205 if len(report.charts) > 1 else 330) - 6 * len(report.tables[-1].rows)  # the pins need the space
    tables = "".join(
        f"<div>{''.join(_html(table) for table in report.tables[side::2] if table.rows)}</div>" for side in (0, 1)
    )
    texts = "".join(f"<h2>{escape(head)}</h2><p>{escape(text)}</p>" for head, text in report.texts)
    body = (
        f'<h1>{escape(report.title)}</h1><p class="quiet">{escape(report.subtitle)}</p>\n'
        f'{draw_svg(report.charts, report.title, height=height)}\n<div class="tables">{tables}</div>\n{texts}\n'
        f"<h2>Reopen this session</h2><code>{escape(report.command)}</code>\n"
        f'<div class="origin">{markup_of_table((), report.origin)}</div>\n'
    )
    return document(report.title, (Path(__file__).parent / "report.css").read_text(encoding="utf-8"), body)


def _html(table: ReportTable) -> str:
    return f"<h2>{escape(table.heading)}</h2>{markup_of_table(table.columns, table.rows)}"
