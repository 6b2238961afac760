"""The content of a report on several fused sensors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from kalscope.analysis.fused import FusionJudgement, judge_fusion
from kalscope.common.array import Array
from kalscope.common.charts import Line, Panel
from kalscope.common.text import number, percent
from kalscope.errors import BadSetting
from kalscope.export.report.content import (
    MAX_DETAIL_SAMPLES,
    Report,
    chosen_samples,
    command_of,
    origin_of,
    subtitle_of,
    y_range,
)
from kalscope.export.report.tables import ReportTable, Rows, meaning, parameters, rmse
from kalscope.filtering.filter import FilterResult, fuse
from kalscope.filtering.steady_state import steady_state
from kalscope.recording import Recording
from kalscope.tuning.fusion import FusionTuning
from kalscope.tuning.tuning import ChannelTuning, Tuning

if TYPE_CHECKING:
    from datetime import datetime

STYLES = ("raw", "s1", "s3", "s4")
"""Of the sensors, from the first; the fused value is s2."""

_MAX_BRIDGED = 10
"""A sensor's line is broken where it has no reading for this many of its usual steps."""


def make_fusion_report(
    recording: Recording,
    tuning: Tuning,
    fusion: FusionTuning,
    *,
    config: str = "tuning.toml",
    now: datetime | None = None,
) -> Report:
    """The report on a fusion.

    Args:
        recording: the data.
        tuning: where the fusion is from.
        fusion: the filter and its sensors, at the recording's sample period.
        config: name of the tuning file in the command.
        now: time to print; None = now. Everything else is the same in every run.

    Raises:
        BadSetting: the recording lacks a sensor, or has no samples.
    """
    if not len(recording):
        raise BadSetting("a report must have samples to show (got none)")
    columns, period = [recording.index(name) for name in fusion.sensors], recording.sample_period
    z, params = recording.values[:, columns], fusion.params
    dt = recording.steps() if recording.gaps == "dt" else None
    result, single = fuse(z, params, dt), params.as_single
    verdict = judge_fusion(z, params, dt, names=fusion.sensors, unit=fusion.unit, sample_period=period)
    truth = None if recording.truth is None else recording.truth[:, columns[0]]
    error = "" if truth is None else f"{number(rmse(result.x, truth))} {fusion.unit}".strip()
    own = ChannelTuning(
        fusion.name,
        fusion.unit,
        fusion.q,
        float(single.r),
        fusion.p0,
        fusion.x0,
        fusion.how,
        fusion.gate,
        fusion.momentum,
    )
    failing = " ".join(sentence for one in verdict.sensors for sentence in one.if_it_fails)
    return Report(
        title=f"{recording.title or recording.source or 'Recording'}: {' + '.join(fusion.sensors)}",
        subtitle=subtitle_of(recording, result.x),
        charts=_charts(recording, fusion, z, result),
        tables=(
            ReportTable(f"Sensors ({fusion.unit})" if fusion.unit else "Sensors", *_sensors(fusion, verdict)),
            ReportTable("While all sensors answer", meaning(steady_state(single, period), result, period, error)),
            ReportTable("Parameters", _without_r(parameters(own, period))),
            ReportTable("Pinned settings", ()),
        ),
        texts=(("What does fusing bring?", " ".join(verdict.sentences)), ("If a sensor fails", failing)),
        command=command_of(recording, config, ()),
        origin=origin_of(recording, tuning, now),
    )


def _sensors(fusion: FusionTuning, verdict: FusionJudgement) -> tuple[Rows, tuple[str, ...]]:
    """A row per sensor, and the column headings; a gain in place of the error alone where there are any."""
    gains = any(gain != 1.0 for gain in fusion.gain)
    rows = [
        (
            one.name,
            number(math.sqrt(fusion.r[i])),
            number(fusion.offset[i]),
            number(fusion.gain[i] if gains else one.error),
            percent(one.share),
            number(one.error_without),
        )
        for i, one in enumerate(verdict.sensors)
    ]
    return tuple(rows), ("", "noise σ", "offset", "gain" if gains else "alone", "share", "without")


def _without_r(rows: Rows) -> Rows:
    """The parameters without r: each sensor has its own."""
    return tuple(row for row in rows if row[0] != "measurement noise r")


def _charts(recording: Recording, fusion: FusionTuning, z: Array, result: FilterResult) -> tuple[Panel, ...]:
    n, timed = len(z), recording.sample_period is not None
    x = np.maximum.accumulate(recording.time) if timed else np.arange(n, dtype=np.float64)

    def panel(title: str, first: int, stop: int) -> Panel:
        lines = [
            _line(x[first:stop], z[first:stop, i], name, STYLES[i % len(STYLES)])
            for i, name in enumerate(fusion.sensors)
        ]
        lines.append(_line(x[first:stop], result.x[first:stop], fusion.name, "s2"))
        label = f"{fusion.name} ({fusion.unit[:8]})" if fusion.unit else fusion.name
        return Panel(
            title, tuple(lines), "time (s)" if timed else "sample", label, y_range([z[first:stop].ravel()])
        )

    whole = panel("The whole recording", 0, n)
    if n < 2 * MAX_DETAIL_SAMPLES:
        return (whole,)
    first = (n - MAX_DETAIL_SAMPLES) // 2
    last = first + MAX_DETAIL_SAMPLES
    return whole, panel(f"Detail: samples {first} to {last - 1}", first, last)


def _line(x: Array, y: Array, name: str, style: str) -> Line:
    """A curve through its readings, from one to the next however slow the sensor is; broken in long gaps."""
    at = np.flatnonzero(np.isfinite(y))
    if len(at) < 2:  # a line needs two points
        return Line(x[0] + np.arange(2.0), np.full(2, y[at[0]] if len(at) else np.nan), name, style)
    steps = np.diff(at)
    gaps = np.flatnonzero(steps > _MAX_BRIDGED * np.median(steps)) + 1
    x, y = np.insert(x[at], gaps, x[at][gaps]), np.insert(y[at], gaps, np.nan)
    kept = chosen_samples(y)
    return Line(x[kept], y[kept], name, style)
