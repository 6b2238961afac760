"""The answer of `kalscope tune --fuse`: the fused filter, what each sensor is worth, and how far to trust it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from kalscope.analysis.fused import FusionJudgement, judge_fusion
from kalscope.cli.tune.fusion.options import FusionOptions, known_noise, request_of
from kalscope.cli.tune.options import TuneOptions
from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation.finding import Request
from kalscope.estimation.fusion.estimate_fusion import estimate_fusion
from kalscope.estimation.fusion.result import FusionEstimate
from kalscope.estimation.known import params_for_specification
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SteadyState, steady_state
from kalscope.recording import Recording
from kalscope.tuning.choose_fusion import units_of
from kalscope.tuning.fused_channels import channels_to_fuse, sensor_named


@dataclass(frozen=True)
class FusionAnswer:
    """What `kalscope tune --fuse` says."""

    sensors: tuple[str, ...]
    """The fused channels."""
    units: tuple[str, ...]
    """The unit of each, "" where unknown."""
    unit: str
    """The unit of the fused value: theirs, or that of the reference."""
    rows: int
    """Rows of the recording."""
    readings: tuple[int, ...]
    """Readings of each sensor."""
    sample_period: float | None
    """Nominal sample period, s; None where unknown."""
    request: Request
    """What was asked for."""
    estimate: FusionEstimate
    """What maximum likelihood found."""
    params: FilterParams | None
    """The filter: the estimate, or the one that meets the target; None where there is none."""
    how: str
    """How it was found, for the tuning file."""
    steady: SteadyState | None
    """The settled filter while all sensors answer; None without a filter."""
    verdict: FusionJudgement | None
    """What the fusion is worth, and which sensor to look at; None without a filter."""


def answer_fusion(
    recording: Recording, asked: TuneOptions, fusing: FusionOptions, progress: Progress
) -> FusionAnswer:
    """Find and judge the filter that fuses channels of a recording.

    Raises:
        BadSetting: no such channels, two units, options that contradict each other, or a target out of reach.
    """
    sensors, reference = _sensors(recording, fusing)
    units = {name: units_of(recording)[name] for name in sensors}
    request = request_of(asked, recording)
    z = recording.values[:, [recording.index(name) for name in sensors]]
    dt = recording.steps() if recording.gaps == "dt" else None
    known = known_noise(asked, recording, sensors)

    def fitted(z: Array, dt: Array | None, progress: Progress) -> tuple[FusionEstimate, FilterParams | None]:
        """The estimate, and the filter that is asked for."""
        found = estimate_fusion(
            z,
            dt=dt,
            names=sensors,
            momentum=0.0 if request.goal else request.momentum,
            robust=asked.robust,
            gains=fusing.gains,
            reference=reference,
            known_r=known,
            progress=progress,
        )
        return found, _with_gate(_at_goal(found, request, recording.sample_period), asked.gate)

    found, params = fitted(z, dt, progress.part(0.0, 0.5))
    verdict = None
    if params is not None:
        judging = progress.part(0.5, 1.0)
        verdict = judge_fusion(
            z,
            replace(found, params=params),
            dt,
            names=sensors,
            unit=units[reference or sensors[0]],
            sample_period=recording.sample_period,
            fit=lambda half, steps: fitted(half, steps, judging)[1] or params,
        )
    return FusionAnswer(
        sensors=sensors,
        units=tuple(units.values()),
        unit=units[reference or sensors[0]],
        rows=len(z),
        readings=tuple(np.isfinite(z).sum(axis=0).tolist()),
        sample_period=recording.sample_period,
        request=request,
        estimate=found,
        params=params,
        how=_how(asked, request),
        steady=None if params is None else steady_state(params.as_single, recording.sample_period),
        verdict=verdict,
    )


def _sensors(recording: Recording, fusing: FusionOptions) -> tuple[tuple[str, ...], str | None]:
    """The channels to fuse, and the reference among them, if one is named."""
    reference = fusing.reference
    mixed = fusing.gains and reference is not None
    sensors = channels_to_fuse(units_of(recording), fusing.names or "", mixed_units=mixed)
    return sensors, None if reference is None else sensor_named(sensors, "--reference", reference)


def _at_goal(found: FusionEstimate, request: Request, period: float | None) -> FilterParams | None:
    """The filter with the q and momentum that meet the target while all sensors answer; as found without a target.

    A target needs no q of the record: the noises of the sensors are enough.
    """
    if not request.goal:
        return found.params
    params = found.params
    if params is None and np.all(found.r > 0.0):
        params = FilterParams(1.0, found.r, offset=found.offset, gain=found.gain)
    if params is None:
        return None
    r = float(params.as_single.r)
    if request.ratio is not None:
        return replace(params, q=request.ratio * r, momentum=0.0)
    momentum = 0.0 if request.momentum == "auto" else request.momentum
    met = params_for_specification(
        r, **request.target, sample_period=period, momentum=momentum, overshoot=request.overshoot
    )
    if not met.q:
        raise BadSetting("the target must leave q above 0: ask for less smoothing (got q = 0)")
    return replace(params, q=met.q, momentum=met.momentum)


def _with_gate(params: FilterParams | None, gate: float | None) -> FilterParams | None:
    if params is None or gate is None:
        return params
    return replace(params, gate=None if math.isnan(gate) else gate)


def _how(asked: TuneOptions, request: Request) -> str:
    """How the filter was found, for the tuning file."""
    known = [*asked.each, *(name for name in ("--r", "--sigma", "--density") if name in asked.numbers)]
    origin = "r given" if known else "r from a still stretch" if asked.still is not None else ""
    parts = [part for part in (request.goal, origin) if part]
    return ", ".join(["fused", *parts, *([] if request.goal else ["maximum likelihood"])])
