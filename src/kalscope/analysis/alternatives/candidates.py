"""The candidates: how each classic filter is tuned to a lag or to a noise reduction, and what it costs.

Lag is the lag on a ramp, in samples. Noise gain is the variance that is left of white noise, Σh². Both follow
from a formula where the filter is a fixed sum of samples, and are measured where it is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from kalscope.analysis.alternatives import filters
from kalscope.analysis.alternatives.measured_response import Bench, Run, step_overshoot
from kalscope.common.array import Array

SETTLED = 0.01
"""A start is forgotten when 1 % of it is left."""

HOLDS = "holds its output, then continues as if no time had passed"
BRIDGES = "needs a whole window: missing samples are interpolated linearly"

MIN_CUTOFF, MAX_CUTOFF = 1e-6, 0.499
"""Cut-offs of the Butterworth filter, cycles a sample."""


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
    overshoot: float = 0.0
    """How far its answer to a step goes beyond it, share of the step; NaN where that is not known."""


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

    def median_misses(size: int) -> float:
        return abs(bench.lag(partial(filters.median, window=size)) - lag)

    return (
        moving_average(min(round(2.0 * lag) + 1, bench.longest_window)),
        exponential(1.0 / (1.0 + lag)),
        fixed_gain(_nearest_power(lambda alpha: abs((1.0 - alpha) / alpha - lag))),
        median(_nearest_window(window, bench, median_misses), bench),
        butterworth(min(max(cutoff, MIN_CUTOFF), MAX_CUTOFF)),
        savitzky_golay_delayed(window),
        savitzky_golay_centred(window),
        one_euro(_search(lambda share: lag - bench.lag(one_euro_run(share, bench))), bench),
    )


def at_noise(gain: float, bench: Bench) -> tuple[Candidate, ...]:
    """Every candidate at the setting that leaves a share nearest to `gain` of white noise, 0 … 1."""

    def median_misses(size: int) -> float:
        return abs(math.log(max(bench.noise_gain(partial(filters.median, window=size)), 1e-300) / gain))

    # On Gaussian noise a median of N leaves about π/(2N); on the recording's own it is measured.
    guess = _odd(0.5 * math.pi / gain, bench)
    better = bench.noise_gain(partial(filters.median, window=guess)) / gain * guess
    parabola = _nearest_window(2.25 / gain, bench, lambda size: abs(math.log(_parabola_noise(size) / gain)))
    return (
        moving_average(min(max(round(1.0 / gain), 1), bench.longest_window)),
        exponential(2.0 * gain / (1.0 + gain)),
        fixed_gain(_nearest_power(lambda alpha: abs(math.log(alpha / (2.0 - alpha) / gain)))),
        median(_nearest_window(better, bench, median_misses), bench),
        butterworth(_cutoff_for_noise(gain)),
        savitzky_golay_delayed(parabola),
        savitzky_golay_centred(parabola),
        one_euro(_search(lambda share: bench.noise_gain(one_euro_run(share, bench)) - gain), bench),
    )


def moving_average(window: int) -> Candidate:
    """Mean of the last `window` samples."""
    return Candidate(
        name="Moving average",
        parameters=f"window of {window}",
        run=partial(filters.moving_average, window=window),
        lag_samples=0.5 * (window - 1),
        noise_gain=1.0 / window,
        start_samples=window,
        memory=window,
        sentence="Simple to explain, but it must store its window, and a spike moves it twice.",
    )


def exponential(alpha: float) -> Candidate:
    """Exponential smoothing, 0 < α ≤ 1."""
    return Candidate(
        name="Exponential",
        parameters=f"α = {alpha:.4g}",
        run=partial(filters.exponential, alpha=alpha),
        lag_samples=(1.0 - alpha) / alpha,
        noise_gain=alpha / (2.0 - alpha),
        start_samples=1 if alpha >= 1.0 else max(1, math.ceil(math.log(SETTLED) / math.log1p(-alpha))),
        memory=1,
        sentence="The settled Kalman filter without momentum; it starts more slowly and ignores gaps.",
    )


def fixed_gain(alpha: float) -> Candidate:
    """Exponential smoothing with a power of two, by shifting bits."""
    return replace(
        exponential(alpha),
        name="Power-of-two gain",
        parameters=f"α = 1/{round(1.0 / alpha)}",
        sentence="One subtraction, one shift, one addition on integers; but the only gains are 1/2, 1/4, 1/8 …",
    )


def median(window: int, bench: Bench) -> Candidate:
    """Median of the last `window` samples, odd; measured."""
    run = partial(filters.median, window=window)
    return Candidate(
        name="Median",
        parameters=f"window of {window}",
        run=run,
        lag_samples=bench.lag(run),
        noise_gain=bench.noise_gain(run),
        start_samples=window,
        memory=window,
        sentence="Removes spikes shorter than half its window completely, but reduces plain noise less.",
    )


def butterworth(cutoff: float) -> Candidate:
    """Second-order low-pass, −3 dB at `cutoff` cycles a sample."""
    slope = math.tan(math.pi * cutoff)
    run = partial(filters.butterworth, cutoff=cutoff)
    return Candidate(
        name="2nd-order Butterworth",
        parameters=f"cut-off {cutoff:.3g}",
        run=run,
        lag_samples=math.sqrt(0.5) / slope,
        noise_gain=_butterworth_noise(cutoff),
        start_samples=math.ceil(-math.log(SETTLED) * math.sqrt(0.5) / slope) + 1,  # its poles decay by exp(−Ω/√2)
        memory=2,
        overshoot=step_overshoot(run, math.ceil(4.0 / slope) + 10),  # √2 π/Ω is where it peaks
        sentence="Falls off twice as steeply above its cut-off, and overshoots a step by 4 % for it.",
    )


def savitzky_golay_delayed(window: int) -> Candidate:
    """A parabola through `window` samples, odd, available once the window is full."""

    def run(z: Array) -> Array:
        return filters.delayed(filters.savitzky_golay(z, window), window // 2)

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
        run=partial(filters.savitzky_golay, window=window),
        lag_samples=0.0,
        sentence="The same curve without its delay: for recordings only, because it needs later samples.",
        causal=False,
    )


def one_euro(share: float, bench: Bench) -> Candidate:
    """One-euro filter with `share` times the present filter's cut-off at speed 0; measured."""
    run = one_euro_run(share, bench)
    slowest, beta = run.keywords["slowest"], run.keywords["beta"]
    return Candidate(
        name="One-euro",
        parameters=f"cut-off {slowest:.3g}, β {beta:.2g}",
        run=run,
        lag_samples=bench.lag(run),
        noise_gain=bench.noise_gain(run),
        start_samples=max(1, math.ceil(-math.log(SETTLED) / math.log1p(4.0 * math.pi * slowest))),
        memory=2,
        sentence="Smooth when still, quick when moving; its cut-off doubles at this recording's usual speed.",
        gaps="holds its output; the next sample counts for the time since",
    )


def one_euro_run(share: float, bench: Bench) -> partial[Array]:
    """The one-euro filter with `share` times the cut-off of the current filter."""
    own = 1.0 / (2.0 * math.pi * (1.0 + bench.present_lag))
    # Its "speed" is the distance to its own last output, which on a ramp is 1 + lag steps away.
    usual = bench.speed * (1.0 + bench.present_lag)
    return partial(filters.one_euro, slowest=share * own, beta=share * own / usual, speed_cutoff=own)


def _parabola_noise(window: float) -> float:
    """Σh² is the middle coefficient, because fitting twice changes nothing: 3(3N² − 7)/(4N(N² − 4))."""
    n = window
    return 1.0 if n < 3 else 3.0 * (3.0 * n * n - 7.0) / (4.0 * n * (n * n - 4.0))


def _butterworth_noise(cutoff: float) -> float:
    """∫|H|² with |H|² = 1/(1 + (tan πf / c)⁴), c = tan πf₀, in closed form."""
    c = math.tan(math.pi * cutoff)
    return (c**4 + math.sqrt(0.5) * (c - c**3)) / (1.0 + c**4)


def _cutoff_for_noise(gain: float) -> float:
    low, high = MIN_CUTOFF, MAX_CUTOFF
    for _ in range(60):  # the noise grows with the cut-off
        middle = math.sqrt(low * high)
        low, high = (low, middle) if _butterworth_noise(middle) > gain else (middle, high)
    return math.sqrt(low * high)


def _odd(window: float, bench: Bench) -> int:
    """The odd window nearest to a length."""
    return min(max(2 * round(0.5 * (window - 1.0)) + 1, 1), bench.longest_window)


def _nearest_window(guess: float, bench: Bench, miss: Callable[[int], float]) -> int:
    """The best odd window near a guess: downhill from it, in steps that halve."""
    best = _odd(guess, bench)
    least, step = miss(best), max(2, 2 * round(0.02 * best))
    while step >= max(2, 2 * (best // 500)):  # half a hundredth of a long window is near enough
        near = [size for size in (best - step, best + step) if 1 <= size <= bench.longest_window]
        found = min(((miss(size), size) for size in near), default=(math.inf, best))
        if found[0] < least:
            least, best = found
        else:
            step = 2 * (step // 4)
    return best


def _nearest_power(miss: Callable[[float], float]) -> float:
    """The power of two 1, 1/2, 1/4 … that misses least."""
    return min((2.0**-k for k in range(31)), key=miss)


def _search(too_quick: Callable[[float], float]) -> float:
    """The share from 1e-4 to 1e4 where `too_quick` changes its sign; it grows with the share."""
    low, high = -4.0, 4.0
    while high - low > 0.002:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if too_quick(10.0**middle) > 0.0 else (middle, high)
    return 10.0 ** (0.5 * (low + high))
