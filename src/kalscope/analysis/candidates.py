"""The filters beside the present one: how each is tuned to a lag or to a noise reduction, and what it costs.

Lag is the lag on a ramp, in samples. Noise gain is the variance that is left of white noise, Σh². Both follow
from a formula where the filter is a fixed sum of samples, and are measured where it is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import cast

import numpy as np

from kalscope.common.numbers import Array
from kalscope.filtering.classic import (
    MAX_CUTOFF,
    MAX_SHIFT,
    MIN_CUTOFF,
    Bench,
    Butterworth,
    Chain,
    Exponential,
    Median,
    MovingAverage,
    OneEuro,
    PowerOfTwo,
    Run,
    RunningStage,
    Stage,
    step_overshoot,
)
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import settled_transfer

MAX_DIRECT = 501
"""Longest window of a parabola that is computed without Fourier transform."""

HOLDS = "holds its output, then continues as if no time had passed"
COUNTS = "holds its output; the next sample counts for the time since"
BRIDGES = "needs a whole window: missing samples are interpolated linearly"

SENTENCES: dict[type[Stage], str] = {
    MovingAverage: "Simple to explain, but it must store its window, and a spike moves it twice.",
    Exponential: "The settled Kalman filter without momentum; it starts more slowly and ignores gaps.",
    PowerOfTwo: "One subtraction, one shift, one addition on integers; but the only gains are 1/2, 1/4, 1/8 …",
    Median: "Removes spikes shorter than half its window completely, but reduces plain noise less.",
    Butterworth: "Falls off twice as steeply above its cut-off, and overshoots a step by 4 % for it.",
    OneEuro: "Smooth when still, quick when moving; its cut-off doubles at this recording's usual speed.",
}
"""Main advantage and disadvantage of each classic filter."""


@dataclass(frozen=True, kw_only=True)
class Description:
    """What a user reads about a filter at one setting."""

    name: str
    """Its usual name."""
    parameters: str
    """Its setting in words; cut-offs in cycles a sample."""
    lag_samples: float
    """Lag on a ramp in samples; of median and one-euro as measured with this recording's noise and speed."""
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


@dataclass(frozen=True, kw_only=True)
class Candidate(Description):
    """One filter at one setting."""

    run: Run
    """From z, shape (n,), NaN where missing, to its curve."""
    noise_gain: float
    """Share of the variance of white noise that is left."""


def at_lag(lag: float, bench: Bench) -> tuple[Candidate, ...]:
    """Every candidate at the setting whose lag is nearest to `lag` samples, > 0."""
    window = _odd(2.0 * lag + 1.0, bench)
    # The bilinear transform keeps the delay at frequency 0: √2/Ω with Ω = 2 tan(π f).
    cutoff = math.atan(math.sqrt(0.5) / lag) / math.pi

    def lag_of(stage: Stage) -> float:
        return bench.lag(partial(classic, stage=stage))

    return _all(
        bench,
        window,
        MovingAverage(min(round(2.0 * lag) + 1, bench.longest_window)),
        Exponential(1.0 / (1.0 + lag)),
        _nearest_power(lambda one: abs(one.lag - lag)),
        Median(_nearest_window(window, bench, lambda size: abs(lag_of(Median(size)) - lag))),
        Butterworth(min(max(cutoff, MIN_CUTOFF), MAX_CUTOFF)),
        one_euro(_search(lambda share: lag - lag_of(one_euro(share, bench))), bench),
    )


def at_noise(gain: float, bench: Bench) -> tuple[Candidate, ...]:
    """Every candidate at the setting that leaves a share nearest to `gain` of white noise, 0 … 1."""

    def left(stage: Stage) -> float:
        return bench.noise_gain(partial(classic, stage=stage))

    def missed(share: float) -> float:
        return abs(math.log(max(share, 1e-300) / gain))

    # On Gaussian noise a median of N leaves about π/(2N); on the recording's own it is measured.
    guess = _odd(0.5 * math.pi / gain, bench)
    better = left(Median(guess)) / gain * guess
    return _all(
        bench,
        _nearest_window(2.25 / gain, bench, lambda size: missed(_parabola_noise(size))),
        MovingAverage(min(max(round(1.0 / gain), 1), bench.longest_window)),
        Exponential(2.0 * gain / (1.0 + gain)),
        _nearest_power(lambda one: missed(one.noise_gain)),
        Median(_nearest_window(better, bench, lambda size: missed(left(Median(size))))),
        Butterworth(_cutoff_for_noise(gain)),
        one_euro(_search(lambda share: left(one_euro(share, bench)) - gain), bench),
    )


def _all(bench: Bench, parabola: int, *stages: Stage) -> tuple[Candidate, ...]:
    """The classic filters; the one-euro filter comes last, after the parabolas over `parabola` samples."""
    made = [of_stage(stage, bench) for stage in stages]
    return *made[:-1], savitzky_golay_delayed(parabola), savitzky_golay_centred(parabola), made[-1]


def of_stage(stage: Stage, bench: Bench) -> Candidate:
    """A classic filter; its lag and noise are measured where no formula gives them."""
    run = partial(classic, stage=stage)
    settles = math.ceil(4.0 / stage.slope) + 10 if isinstance(stage, Butterworth) else 0  # √2 π/Ω is where it peaks
    return Candidate(
        name=stage.name,
        parameters=stage.words,
        chain=Chain(1, stage),
        run=run,
        lag_samples=bench.lag(run) if stage.lag is None else stage.lag,
        noise_gain=bench.noise_gain(run) if stage.noise_gain is None else stage.noise_gain,
        start_samples=stage.start_samples,
        memory=stage.memory,
        overshoot=step_overshoot(run, settles) if settles else 0.0,
        sentence=SENTENCES[type(stage)],
        gaps=COUNTS if isinstance(stage, OneEuro) else HOLDS,
    )


def savitzky_golay_delayed(window: int) -> Candidate:
    """A parabola through `window` samples, odd, available once the window is full."""

    def run(z: Array) -> Array:
        return delayed(savitzky_golay(z, window), window // 2)

    return Candidate(
        name="Delayed Savitzky-Golay",
        parameters=f"parabola over {window}",
        run=run,
        lag_samples=0.5 * (window - 1),
        noise_gain=_parabola_noise(window),
        start_samples=window,
        memory=window,
        overshoot=step_overshoot(run, window),
        sentence="Keeps peaks and slopes in shape, at the price of a pure delay of half its window.",
        gaps=BRIDGES,
    )


def savitzky_golay_centred(window: int) -> Candidate:
    """The same without the delay, which needs later samples."""
    return replace(
        savitzky_golay_delayed(window),
        name="Centred Savitzky-Golay",
        run=partial(savitzky_golay, window=window),
        lag_samples=0.0,
        sentence="The same curve without its delay: for recordings only, because it needs later samples.",
        causal=False,
    )


def one_euro(share: float, bench: Bench) -> OneEuro:
    """The one-euro filter with `share` times the present cut-off at speed 0, and twice that at the usual speed."""
    cutoff = 1.0 / (2.0 * math.pi * (1.0 + bench.present_lag))
    # Its "speed" is the distance to its last output, which on a ramp is 1 + lag steps away.
    usual = bench.speed * (1.0 + bench.present_lag)
    return OneEuro(cutoff=share * cutoff, beta=share * cutoff / usual, speed_cutoff=cutoff)


def _parabola_noise(window: float) -> float:
    """Σh² is the middle coefficient, because fitting twice changes nothing: 3(3N² − 7)/(4N(N² − 4))."""
    n = window
    return 1.0 if n < 3 else 3.0 * (3.0 * n * n - 7.0) / (4.0 * n * (n * n - 4.0))


def _cutoff_for_noise(gain: float) -> float:
    low, high = MIN_CUTOFF, MAX_CUTOFF
    for _ in range(60):  # the noise grows with the cut-off
        middle = math.sqrt(low * high)
        low, high = (low, middle) if Butterworth(middle).noise_gain > gain else (middle, high)
    return math.sqrt(low * high)


def _odd(window: float, bench: Bench) -> int:
    """The odd window nearest to a length."""
    return min(max(2 * round(0.5 * (window - 1.0)) + 1, 1), bench.longest_window)


def _nearest_window(guess: float, bench: Bench, miss: Callable[[int], float]) -> int:
    """The best odd window near a guess: downhill from it, in steps that halve."""
    best = _odd(guess, bench)
    least, step = miss(best), max(2, 2 * round(0.02 * best))
    while step >= max(2, 2 * (best // 500)):  # half a percent of a long window is close enough
        near = [size for size in (best - step, best + step) if 1 <= size <= bench.longest_window]
        found = min(((miss(size), size) for size in near), default=(math.inf, best))
        if found[0] < least:
            least, best = found
        else:
            step = 2 * (step // 4)
    return best


def _nearest_power(miss: Callable[[PowerOfTwo], float]) -> PowerOfTwo:
    """The gain of 1, 1/2, 1/4 … that comes closest."""
    return min(map(PowerOfTwo, range(MAX_SHIFT + 1)), key=miss)


def _search(too_quick: Callable[[float], float]) -> float:
    """The share from 1e-4 to 1e4 where `too_quick` changes its sign; it grows with the share."""
    low, high = -4.0, 4.0
    while high - low > 0.002:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if too_quick(10.0**middle) > 0.0 else (middle, high)
    return 10.0 ** (0.5 * (low + high))


def classic(z: Array, stage: Stage) -> Array:
    """A classic filter as a device runs it, evenly sampled."""
    return RunningStage(stage).take(z, np.empty(0))


def settled(z: Array, params: FilterParams) -> Array:
    """The Kalman filter with the gains that it settles to, started at the first sample; scalars."""
    from scipy.signal import lfilter

    gain, product, both = settled_transfer(params)
    top, bottom = [gain, product - gain], [1.0, product - both - 1.0, both]
    return _skipping(z, lambda seen: cast("Array", lfilter(top, bottom, seen - seen[0])) + seen[0])


def savitzky_golay(z: Array, window: int) -> Array:
    """Centre of a parabola through `window` samples, odd; missing ones are interpolated linearly.

    NaN before the first sample. The ends come from the parabola through the outermost window.
    """
    from scipy.signal import savgol_filter

    bridged, first = _bridged(z)
    if 3 <= window <= MAX_DIRECT:
        if len(bridged) >= window:
            bridged = np.asarray(savgol_filter(bridged, window, 2))
    elif window > MAX_DIRECT and len(bridged) >= window:
        bridged = _long_parabola(bridged, window)
    return np.concatenate([np.full(first, np.nan), bridged])


def _long_parabola(z: Array, window: int) -> Array:
    """The same by Fourier transform, where scipy's filter would take seconds."""
    from scipy.signal import oaconvolve, savgol_coeffs

    half, level, out = window // 2, float(z.mean()), np.empty(len(z))
    out[half : len(z) - half] = oaconvolve(z - level, np.asarray(savgol_coeffs(window, 2)), "valid") + level
    place = np.linspace(-1.0, 1.0, window)
    out[:half] = np.polynomial.Polynomial.fit(place, z[:window], 2)(place[:half])
    out[len(z) - half :] = np.polynomial.Polynomial.fit(place, z[-window:], 2)(place[half + 1 :])
    return out


def delayed(curve: Array, samples: int) -> Array:
    """The curve `samples` later, as a device outputs it; NaN until then."""
    late = np.full(len(curve), np.nan)
    late[samples:] = curve[: len(curve) - samples]
    return late


def _skipping(z: Array, run: Callable[[Array], Array]) -> Array:
    """`run` on the finite samples; its last value in between, NaN before the first."""
    seen = np.isfinite(z)
    if not seen.any():
        return np.full(len(z), np.nan)
    if seen.all():
        return run(z)
    latest = np.cumsum(seen) - 1
    return np.where(latest >= 0, run(z[seen])[np.maximum(latest, 0)], np.nan)


def _bridged(z: Array) -> tuple[Array, int]:
    """The samples z from the first finite one on, gaps interpolated; and the number of samples before it."""
    seen = np.flatnonzero(np.isfinite(z))
    if len(seen) == 0:
        return np.empty(0), len(z)
    first = int(seen[0])
    return np.interp(np.arange(first, len(z)), seen, z[seen]), first
