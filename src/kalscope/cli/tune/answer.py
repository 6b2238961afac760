"""The whole answer of `kalscope tune` for one channel: the pair, what it means, and how far to trust it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from kalscope.analysis.correction import MIN_SAMPLES
from kalscope.analysis.diagnostics import Diagnostics, diagnose_held_out, diagnose_run
from kalscope.analysis.estimators import compare_methods
from kalscope.analysis.judge import Judgement, judge, needs_noise
from kalscope.analysis.residuals import Run
from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.estimation.estimate import estimate
from kalscope.estimation.finding import Found, Noise, Request, find_parameters, shows_no_noise
from kalscope.estimation.methods.still_stretch import find_still_stretch
from kalscope.estimation.result import Estimate
from kalscope.filtering.steady_state import SteadyState, steady_state
from kalscope.recording import Recording

CHOSEN = "chosen"
"""The verdict without an estimate: the pair follows from the options."""


@dataclass(frozen=True)
class Answer:
    """What `kalscope tune` says about one channel."""

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
    request: Request
    """What the user asked for."""
    found: Found
    """The pair or why there is none."""
    opinions: tuple[Estimate, ...]
    """All methods side by side, maximum likelihood first."""
    steady: SteadyState | None
    """The settled filter; None without a pair."""
    judgement: Judgement
    """Whether the pair fits, and what to do next; `held_out` is of a pair found in the first half."""

    @property
    def verdict(self) -> str:
        """The verdict of the estimate, or "chosen" where the pair needed none."""
        return CHOSEN if self.found.estimate is None else str(self.found.estimate.verdict)

    @property
    def range(self) -> Estimate:
        """The estimate whose intervals say what the record allows."""
        return self.found.estimate or self.opinions[0]

    @property
    def momentum(self) -> float:
        """Momentum of the answer in sample periods, with or without a pair; 0 without."""
        if self.found.params is not None:
            return self.found.params.momentum
        return 0.0 if self.found.estimate is None else self.found.estimate.momentum


def answer_for(
    recording: Recording, channel: str, request: Request, progress: Progress, gate: float | None = None
) -> Answer:
    """Find and judge the pair of one channel.

    Args:
        recording: where the channel is.
        channel: its name.
        request: what is asked for.
        progress: where progress is reported.
        gate: outlier gate on v²/s in place of the one that is found; NaN = off, None = as found.

    Raises:
        BadSetting: contradictory or out-of-range targets.
    """
    z, period = recording.channel(channel), recording.sample_period
    unit = recording.units[recording.index(channel)]
    dt = recording.steps() if recording.gaps == "dt" else None
    found = find_parameters(z, request, dt=dt, sample_period=period, progress=progress.part(0.0, 0.3))
    found = _with_gate(found, gate)
    opinions = compare_methods(_without_spikes(z, dt, request, found), dt, progress=progress.part(0.3, 0.7))
    progress(0.7, "judging the answer")
    residuals = held_out = None
    if found.params is not None:
        residuals = diagnose_run(Run.of_samples(z, found.params, dt), fitted=found.estimate is not None)
        held_out = _held_out(z, dt, period, request, progress.part(0.8, 1.0))
    return Answer(
        channel=channel,
        unit=unit,
        samples=len(z),
        missing=int(np.count_nonzero(np.isnan(z))),
        sample_period=period,
        request=request,
        found=found,
        opinions=opinions,
        steady=None if found.params is None else steady_state(found.params, period),
        judgement=judge(
            residuals,
            held_out,
            found.estimate,
            request,
            still=find_still_stretch(z, dt) if needs_noise(found.estimate) else None,
            unit=unit,
        ),
    )


def _without_spikes(z: Array, dt: Array | None, request: Request, found: Found) -> Array:
    """The samples that the second opinions and the range of the record are to be found in: those of the answer."""
    fit = found.estimate
    if fit is None and request.robust is not False:  # the filter was chosen
        fit = estimate(z, dt=dt, momentum=0.0, robust=request.robust)
    if fit is None or fit.outliers is None or fit.verdict == "too_many_outliers":
        return z
    return np.where(fit.outliers, np.nan, z)


def _with_gate(found: Found, gate: float | None) -> Found:
    if gate is None or found.params is None:
        return found
    return replace(found, params=replace(found.params, gate=None if math.isnan(gate) else gate))


def _held_out(
    z: Array, dt: Array | None, period: float | None, request: Request, progress: Progress
) -> Diagnostics | None:
    """The same question to the first half alone, its answer judged on the second half."""
    half = z[: len(z) // 2]
    known = request.noise.resolve(z, dt)  # a still stretch may lie in the second half: it is knowledge, not a fit
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
