"""The whole answer of `kalscope tune` for one channel: the pair, what it means, and how far to trust it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any, cast

import numpy as np

from kalscope.analysis.diagnostics import Diagnostics, diagnose, diagnose_held_out
from kalscope.analysis.fit.correction import MIN_SAMPLES
from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.estimation.agreement.comparison import compare_methods
from kalscope.estimation.agreement.words import disagreement
from kalscope.estimation.finding import METHOD_NAMES, Found, Noise, Request, find_parameters, shows_no_noise
from kalscope.estimation.result import Estimate
from kalscope.estimation.verdict import gain_of, lag_of
from kalscope.filtering.arrays import scalar
from kalscope.filtering.batch import kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SteadyState, steady_state
from kalscope.recording import Recording

CHOSEN = "chosen"
"""The verdict without an estimate: the pair follows from the options."""


@dataclass(frozen=True)
class Answer:
    """What `kalscope tune` says of one channel."""

    channel: str
    """Name of the channel."""
    unit: str
    """Its unit, "" where unknown."""
    samples: int
    """Samples, missing ones included."""
    missing: int
    """Missing ones among them."""
    sample_period: float | None
    """Nominal sample period, s; None where unknown."""
    found: Found
    """The pair or why there is none."""
    opinions: tuple[Estimate, ...]
    """All methods side by side, maximum likelihood first."""
    steady: SteadyState | None
    """The settled filter; None without a pair."""
    residuals: Diagnostics | None
    """The pair judged on the whole record; None without a pair."""
    held_out: Diagnostics | None
    """A pair found in the first half, judged on the second; None where one of them gives too little."""

    @property
    def verdict(self) -> str:
        """The verdict of the estimate, or "chosen" where the pair needed none."""
        return CHOSEN if self.found.estimate is None else str(self.found.estimate.verdict)

    @property
    def range(self) -> Estimate:
        """The estimate whose intervals say what the record allows."""
        return self.found.estimate or self.opinions[0]

    @property
    def disagreement(self) -> str:
        """How the methods contradict maximum likelihood, "" where they do not."""
        return disagreement(self.opinions, self.momentum)

    @property
    def momentum(self) -> float:
        """Momentum of the answer in sample periods, with or without a pair; 0 without."""
        if self.found.params is not None:
            return scalar(self.found.params.momentum)
        return 0.0 if self.found.estimate is None else scalar(self.found.estimate.momentum)


def answer_for(recording: Recording, channel: str, request: Request, progress: Progress) -> Answer:
    """Find and judge the pair of one channel.

    Raises:
        BadSetting: contradictory or out-of-range targets.
    """
    z, period = recording.channel(channel), recording.sample_period
    dt = recording.steps() if recording.gaps == "dt" else None
    found = find_parameters(z, request, dt=dt, sample_period=period, progress=progress.part(0.0, 0.3))
    opinions = compare_methods(z, dt, progress=progress.part(0.3, 0.7))
    progress(0.7, "judging the answer")
    residuals = None
    if found.params is not None:
        residuals = diagnose(kalman_filter(z, found.params, dt), fitted=found.estimate is not None)
    return Answer(
        channel=channel,
        unit=recording.units[recording.index(channel)],
        samples=len(z),
        missing=int(np.count_nonzero(np.isnan(z))),
        sample_period=period,
        found=found,
        opinions=opinions,
        steady=None if found.params is None else steady_state(found.params, period),
        residuals=residuals if isinstance(residuals, Diagnostics) else None,
        held_out=None if found.params is None else _held_out(z, dt, period, request, progress.part(0.8, 1.0)),
    )


def _held_out(
    z: Array, dt: Array | None, period: float | None, request: Request, progress: Progress
) -> Diagnostics | None:
    """The same question to the first half alone, its answer judged on the second half."""
    half = z[: len(z) // 2]
    known = request.noise.resolve(z)  # a still stretch may lie in the second half: it is knowledge, not a fit
    if known:
        request = replace(request, noise=Noise(r=known[0]))
    elif shows_no_noise(half):
        return None
    half_dt = None if dt is None else dt[: len(half)]
    params = find_parameters(half, request, dt=half_dt, sample_period=period, progress=progress).params
    if params is None:
        return None
    judged = diagnose_held_out(z, params, dt)
    return judged if judged.n >= MIN_SAMPLES else None


def as_plain(answer: Answer) -> dict[str, Any]:
    """The answer as JSON can say it: None for what is not there, "inf" for infinity, never NaN."""
    params, limits = answer.found.params, answer.range
    return finite(
        {
            "channel": answer.channel,
            "unit": answer.unit,
            "samples": answer.samples,
            "missing": answer.missing,
            "sample_period": answer.sample_period,
            **_pair(params),
            "verdict": answer.verdict,
            "message": answer.found.message,
            "how": answer.found.how,
            "ratio_interval": limits.ratio_interval,
            "gain_interval": limits.gain_interval,
            "lag_interval": limits.lag_interval,
            "momentum_interval": limits.momentum_interval,
            "prediction_gain": limits.prediction_gain,
            "steady": None if answer.steady is None else asdict(answer.steady),
            "opinions": [_opinion(one) for one in answer.opinions],
            "disagreement": answer.disagreement,
            "advice": None if answer.residuals is None else answer.residuals.advice,
            "residuals": _judged(answer.residuals),
            "held_out": _judged(answer.held_out),
        }
    )


def _pair(params: FilterParams | None) -> dict[str, Any]:
    names = ("q", "r", "ratio", "momentum")
    return {name: None if params is None else getattr(params, name) for name in names}


def _opinion(one: Estimate) -> dict[str, Any]:
    names = ("method", "q", "r", "ratio", "q_se", "r_se", "loglik", "verdict", "message")
    values = {name: getattr(one, name) for name in names}
    ratio = float(one.ratio)
    return {**values, "name": METHOD_NAMES[one.method], "gain": gain_of(ratio), "lag_samples": lag_of(ratio)}


def _judged(judged: Diagnostics | None) -> dict[str, Any] | None:
    if judged is None:
        return None
    names = (
        *("n", "advice", "nis", "nis_low", "nis_high", "r1", "r1_bound", "ljung_box", "ljung_box_p"),
        *("spikes", "spikes_expected", "jumps", "variance_ratio", "variance_ratio_p", "q_factor", "r_factor"),
    )
    return {name: getattr(judged, name) for name in names}


def finite(value: Any) -> Any:
    """The value without numbers that JSON has not; numpy's as Python's."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in cast("dict[str, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in cast("list[Any]", value)]
    if isinstance(value, float):
        number = float(value)
        return None if math.isnan(number) else number if math.isfinite(number) else str(number)
    return value.item() if hasattr(value, "item") else value
