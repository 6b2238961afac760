"""The filters beside the present one: how each is tuned to a lag or to a noise reduction, and what it costs.

Lag is the lag on a ramp, in samples. Noise gain is the variance that is left of white noise, Σh². Both follow
from a formula where the filter is a fixed sum of samples, and are measured where it is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from kalscope.analysis.filter_errors import Difference
from kalscope.common.numbers import Array
from kalscope.filtering import classic
from kalscope.filtering.classic import Bench, Chain, OneEuro, Run, Stage

HOLDS = "holds its output, then continues as if no time had passed"
COUNTS = "holds its output; the next sample counts for the time since"

SENTENCES: dict[type[Stage], str] = {
    classic.MovingAverage: "Simple to explain, but it must store its window, and a spike moves it twice.",
    classic.Exponential: "The settled Kalman filter without momentum; it starts more slowly and ignores gaps.",
    classic.Median: "Removes spikes shorter than half its window completely, but reduces plain noise less.",
    classic.Butterworth: "Falls off twice as steeply above its cut-off, and overshoots a step by 4 % for it.",
    OneEuro: "Smooth when still, quick when moving; its cut-off doubles at this recording's usual speed.",
}
"""Main advantage and disadvantage of each classic filter."""


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """One filter at one setting, what a user reads about it, and what it does to the stretch that is compared."""

    name: str
    """Its usual name."""
    parameters: str
    """Its setting in words; cut-offs in cycles a sample."""
    run: Run
    """From z, shape (n,), NaN where missing, to its curve."""
    lag_samples: float
    """Lag on a ramp in samples; of median and one-euro as measured with this recording's noise and speed."""
    noise_gain: float
    """Share of the variance of white noise that is left; NaN where that is not known."""
    start_samples: int
    """Samples until 1 % of the start is left."""
    memory: int
    """Numbers that it must remember; 0 = the whole recording."""
    sentence: str
    """Its main advantage and disadvantage."""
    gaps: str = HOLDS
    """How it treats missing samples."""
    causal: bool = True
    """Whether a device can run it: its output needs no later sample."""
    chain: Chain | None = None
    """What a device runs, with the channel's own Kalman filter where it says so; None where none is exported."""
    overshoot: float = 0.0
    """Overshoot of its step response, share of the step; NaN where that is not known."""

    curve: Array = field(default_factory=lambda: np.empty(0))
    """Filtered signal, unit, shape (last − first,); NaN before its first output."""
    rmse: float | None = None
    """RMS difference from the truth after the start, unit; None where the truth is not known."""
    prediction: float | None = None
    """RMS difference from the next sample, unit: an error that needs no truth; None if not causal."""
    matched: bool = True
    """Whether it filters at all, and is within 5 % or half a sample of the lag asked for, or 5 % of the noise."""
    against: Difference | None = None
    """Its error against that of the current filter; None for the current one and for those not causal."""

    @property
    def noise_reduction_db(self) -> float:
        """White noise, in to out, dB; on the recording's own noise for median and one-euro."""
        return math.inf if self.noise_gain == 0.0 else -10.0 * math.log10(self.noise_gain)


def at_lag(lag: float, bench: Bench) -> tuple[Alternative, ...]:
    """Every candidate at the setting whose lag is nearest to `lag` samples, > 0."""
    return tuple(of_stage(stage_at_lag(kind, lag, bench), bench) for kind in SENTENCES)


def stage_at_lag(kind: type[Stage], lag: float, bench: Bench) -> Stage:
    """The classic filter of a kind whose lag is nearest to `lag` samples, > 0; only one-euro needs the samples."""
    if kind is classic.MovingAverage:
        return classic.MovingAverage(min(round(2.0 * lag) + 1, bench.longest_window))
    if kind is classic.Exponential:
        return classic.Exponential(1.0 / (1.0 + lag))
    if kind is classic.Median:
        return classic.Median(_odd(2.0 * lag + 1.0, bench))
    if kind is classic.Butterworth:
        # The bilinear transform keeps the delay at frequency 0: √2/Ω with Ω = 2 tan(π f).
        cutoff = math.atan(math.sqrt(0.5) / lag) / math.pi
        return classic.Butterworth(min(max(cutoff, classic.MIN_CUTOFF), classic.MAX_CUTOFF))

    def misses(share: float) -> float:
        return lag - bench.lag(partial(run_stage, stage=one_euro(share, bench)))

    return one_euro(_bisect(misses, *EURO_SHARES), bench)


def at_noise(gain: float, bench: Bench) -> tuple[Alternative, ...]:
    """Every candidate at the setting that leaves a share nearest to `gain` of white noise, 0 … 1."""

    def gain_of(stage: Stage) -> float:
        return bench.noise_gain(partial(run_stage, stage=stage))

    # On Gaussian noise a median of N leaves about π/(2N); on the recording's own it is measured.
    guess = _odd(0.5 * math.pi / gain, bench)
    better = gain_of(classic.Median(guess)) / gain * guess
    cutoff = _bisect(
        lambda one: classic.Butterworth(one).noise_gain - gain, classic.MIN_CUTOFF, classic.MAX_CUTOFF, 60
    )
    stages = (
        classic.MovingAverage(min(max(round(1.0 / gain), 1), bench.longest_window)),
        classic.Exponential(2.0 * gain / (1.0 + gain)),
        classic.Median(_odd(better, bench)),
        classic.Butterworth(cutoff),
        one_euro(_bisect(lambda share: gain_of(one_euro(share, bench)) - gain, *EURO_SHARES), bench),
    )
    return tuple(of_stage(stage, bench) for stage in stages)


def of_stage(stage: Stage, bench: Bench) -> Alternative:
    """A classic filter; its lag and noise are measured where no formula gives them."""
    run = partial(run_stage, stage=stage)
    # The step response of a Butterworth filter peaks √2 π/Ω after the step.
    settles = math.ceil(4.0 / stage.slope) + 10 if isinstance(stage, classic.Butterworth) else 0
    return Alternative(
        name=stage.name,
        parameters=stage.words,
        chain=Chain(1, stage),
        run=run,
        lag_samples=bench.lag(run) if stage.lag is None else stage.lag,
        noise_gain=bench.noise_gain(run) if stage.noise_gain is None else stage.noise_gain,
        start_samples=stage.start_samples,
        memory=stage.memory,
        overshoot=classic.step_overshoot(run, settles) if settles else 0.0,
        sentence=SENTENCES[type(stage)],
        gaps=COUNTS if isinstance(stage, OneEuro) else HOLDS,
    )


EURO_SHARES = 1e-4, 1e4, 12
"""Of the present cut-off, least and most that is tried for the one-euro filter, and how often that is halved."""


def one_euro(share: float, bench: Bench) -> OneEuro:
    """The one-euro filter with `share` times the present cut-off at speed 0, and twice that at the usual speed."""
    cutoff = 1.0 / (2.0 * math.pi * (1.0 + bench.present_lag))
    # Its "speed" is the distance to its last output, which on a ramp is 1 + lag steps away.
    usual = bench.speed * (1.0 + bench.present_lag)
    return OneEuro(cutoff=share * cutoff, beta=share * cutoff / usual, speed_cutoff=cutoff)


def _odd(window: float, bench: Bench) -> int:
    """The odd window nearest to a length."""
    return min(max(2 * round(0.5 * (window - 1.0)) + 1, 1), bench.longest_window)


def _bisect(too_quick: Callable[[float], float], low: float, high: float, steps: int) -> float:
    """Where `too_quick`, which grows, changes its sign between two positive numbers."""
    for _ in range(steps):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if too_quick(middle) > 0.0 else (middle, high)
    return math.sqrt(low * high)


def run_stage(z: Array, stage: Stage) -> Array:
    """A classic filter as a device runs it, evenly sampled."""
    return classic.RunningStage(stage).take(z, np.empty(0))
