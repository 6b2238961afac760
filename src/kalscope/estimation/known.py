"""q and r from what the user knows: a still stretch, a data sheet, a lag or cut-off, or one of the two."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.common.checks import above_zero
from kalscope.common.progress import Progress
from kalscope.common.text import number
from kalscope.errors import BadSetting
from kalscope.estimation import verdict_text as words
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.likelihood.search import Peak, find_peak, grid_for
from kalscope.estimation.methods import maximum_likelihood as ml
from kalscope.estimation.methods.pair import Pair
from kalscope.estimation.result import Estimate
from kalscope.estimation.robust.fit import checked_robust, spike_proof
from kalscope.estimation.verdict import NOWHERE, channel_fit, each_channel, exp
from kalscope.filtering.arrays import samples_of
from kalscope.filtering.momentum.specification import momentum_for_overshoot
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.filtering.steady_state import ratio_for

_MAX_FACTOR = 1e100
"""A given r this many times above or below the largest squared step of the readings has another unit."""

_MIN_STEP = 64.0 * np.finfo(np.float64).eps
"""Two readings closer than this, relative to the largest, differ only by rounding."""


@dataclass(frozen=True)
class StillNoise:
    """The noise of a sensor whose input does not change."""

    r: float
    """Measurement-noise variance, unit²: the variance without the drift, but at least `floor`."""
    variance: float
    """Variance about the straight line through the stretch, unit²."""
    drift: float
    """Slope of that line, unit a sample."""
    quantum: float
    """Resolution Δ of the readings, unit; 0 where none is visible."""
    floor: float
    """Δ²/12, the variance that rounding to steps of Δ adds, unit²."""
    samples: int
    """Finite samples used."""
    message: str
    """What r is based on, for the user."""


def noise_from_still(z_segment: ArrayLike, quantum: float | None = None) -> StillNoise:
    """The noise variance r from a stretch in which the true value did not change.

    Args:
        z_segment: measurements of that stretch, shape (n,), at least 8 of them finite; NaN is a missing sample.
        quantum: resolution Δ of the readings in their unit, ≥ 0; None = the smallest step between two readings.

    Raises:
        BadSetting: too few finite samples, inf, another shape, a negative quantum, or equal readings without a
            quantum.

    Source: residual variance of a straight line, Σe²/(n − 2); rounding to steps of Δ adds Δ²/12 (Widrow 1956).
    """
    column = samples_of(z_segment)
    if column.ndim != 1 or np.isinf(column).any():
        raise BadSetting(f"the still stretch must be finite samples, shape (n,) (got shape {column.shape})")
    place = np.flatnonzero(np.isfinite(column))
    if len(place) < words.MIN_SAMPLES:
        raise BadSetting(f"the still stretch must hold at least {words.MIN_SAMPLES} samples (got {len(place)})")
    if quantum is not None and not 0.0 <= quantum < math.inf:
        raise BadSetting(f"quantum must be a finite step, 0 or more (got {quantum})")
    samples = column[place]
    step = _smallest_step(samples) if quantum is None else float(quantum)
    middle = place - place.mean()
    level = samples - samples[0]
    drift = float(middle @ level / (middle @ middle))
    left = level - level.mean() - drift * middle
    variance = float(left @ left) / (len(place) - 2)
    floor = step**2 / 12.0
    if max(variance, floor) == 0.0:
        raise BadSetting("the still stretch must show noise, or quantum must be given (got equal readings)")
    if floor > variance:
        message = f"The readings hardly change: r is Δ²/12, the variance of rounding to steps of {number(step, 4)}."
    else:
        message = f"Standard deviation {number(math.sqrt(variance), 4)} over {len(place)} readings, drift removed."
    return StillNoise(max(variance, floor), variance, drift, step, floor, len(place), message)


def noise_from_datasheet(
    *, sigma: float | None = None, density: float | None = None, bandwidth_hz: float | None = None
) -> float:
    """The noise variance r, unit², from a data sheet.

    Args:
        sigma: RMS noise (one standard deviation), unit, > 0: r = σ².
        density: noise density, unit/√Hz, > 0, with bandwidth_hz: r = density² · bandwidth.
        bandwidth_hz: noise bandwidth at the output, Hz, > 0; for a first-order low-pass π/2 times its −3 dB
            frequency; without any filter half the sample rate.

    Raises:
        BadSetting: neither or both of sigma and density, density without bandwidth, or a value not above 0.
    """
    if (sigma is None) == (density is None):
        raise BadSetting(f"one of sigma and density must be given (got sigma = {sigma}, density = {density})")
    if sigma is not None:
        return above_zero("sigma", sigma, MAX_VARIANCE) ** 2
    if density is None or bandwidth_hz is None:
        raise BadSetting("density needs bandwidth_hz, the bandwidth of the noise in Hz (got None)")
    bandwidth = above_zero("bandwidth_hz", bandwidth_hz, MAX_VARIANCE)
    return above_zero("density", density, MAX_VARIANCE) ** 2 * bandwidth


def params_for_specification(
    r: float,
    *,
    gain: float | None = None,
    lag_samples: float | None = None,
    lag_s: float | None = None,
    cutoff_hz: float | None = None,
    noise_reduction_db: float | None = None,
    sample_period: float | None = None,
    momentum: float = 0.0,
    overshoot: float | None = None,
) -> FilterParams:
    """The filter that meets a target once settled: λ from `ratio_for`, then q = λ r.

    With an overshoot that is allowed too, the momentum follows from it: of all filters within the lag and the
    overshoot this one leaves the least noise; with a noise reduction in place of the lag it has the least lag.

    Args:
        r: measurement-noise variance, unit², > 0.
        gain: steady gain K; or one of
        lag_samples: largest lag behind a ramp, samples;
        lag_s: the same in s;
        cutoff_hz: −3 dB frequency;
        noise_reduction_db: white noise, in to out.
        sample_period: nominal sample period in s, for a target in s or Hz.
        momentum: τ of the filter in sample periods, 0 … 1e5.
        overshoot: how far the answer to a step may go beyond it, share of the step, about 0.2 at most; 0 is the
            filter without momentum. In place of `momentum`.

    Raises:
        BadSetting: r is not above 0, no target or several, a target out of range, or an overshoot that no momentum
            has with this target; the message says the largest.
    """

    def ratio_at(tau: float) -> float:
        return ratio_for(
            gain=gain,
            lag_samples=lag_samples,
            lag_s=lag_s,
            cutoff_hz=cutoff_hz,
            noise_reduction_db=noise_reduction_db,
            sample_period=sample_period,
            momentum=tau,
        )

    noise = above_zero("r", r, MAX_VARIANCE)
    if overshoot is not None:
        if momentum:
            raise BadSetting(f"overshoot must come without momentum, which follows from it (got {momentum:g} too)")
        momentum = momentum_for_overshoot(overshoot, ratio_at)
    return FilterParams(q=ratio_at(momentum) * noise, r=noise, momentum=momentum)


def estimate_fixed_r(
    z: ArrayLike, r: float, dt: ArrayLike | None = None, robust: bool | Literal["auto"] = "auto"
) -> Estimate:
    """Find q by maximum likelihood where r is known (a still stretch, a data sheet); method "fixed_r".

    Args:
        z: measurements, shape (n,) or (n, channels); NaN is a missing sample.
        r: measurement-noise variance of every channel, unit², > 0.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        robust: whether spikes are set aside, as in `estimate`.

    Raises:
        BadSetting: r is not above 0; z holds inf or has another shape; dt does not fit z.
    """
    noise = above_zero("r", r, MAX_VARIANCE)

    def fit(data: Differences, progress: Progress) -> tuple[Pair, Peak]:
        scaled = noise / data.scale / data.scale
        if not _MAX_FACTOR**-1 < scaled < _MAX_FACTOR:
            return Pair(0.0, 0.0, math.inf, math.inf, verdict="bad_unit", text=words.OTHER_UNIT), NOWHERE
        constant = data.m * (math.log(2.0 * math.pi) + math.log(noise))

        def loglik(log_ratios: Array) -> Array:
            chi2, logdet = data.sums(np.exp(log_ratios))
            return -0.5 * (constant + logdet + chi2 / scaled)

        # λ can hardly exceed the largest squared difference (at most 1 in this scale) over r
        peak = find_peak(loglik, grid_for(data.m, max(24.0, 4.0 - math.log(scaled))), -math.inf, progress)
        q = math.exp(peak.log_ratio) * scaled
        q_se = q / math.sqrt(-peak.curvature) if peak.curvature < 0.0 else math.inf
        return Pair(q, scaled, q_se, 0.0), peak

    one = channel_fit("fixed_r", fit)
    return each_channel(z, dt, Progress(), spike_proof(one, lambda _: one, checked_robust(robust)))


def estimate_fixed_ratio(
    z: ArrayLike, ratio: float = 0.01, dt: ArrayLike | None = None, robust: bool | Literal["auto"] = "auto"
) -> Estimate:
    """Find r by maximum likelihood where λ = q/r is chosen; method "fixed_ratio". r = Σv²/f / m.

    Args:
        z: measurements, shape (n,) or (n, channels); NaN is a missing sample.
        ratio: λ = q/r, > 0; 0.01, r a hundred times q, is the advice of Ma'arif et al. (2019), section 4.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        robust: whether spikes are set aside, as in `estimate`.

    Raises:
        BadSetting: ratio is not above 0; z holds inf or has another shape; dt does not fit z.
    """
    chosen = above_zero("ratio", ratio, MAX_VARIANCE)

    def fit(data: Differences, progress: Progress) -> tuple[Pair, Peak]:
        r = float(data.sums(np.array([chosen]))[0][0]) / data.m
        r_se = r * math.sqrt(2.0 / data.m)
        peak = ml.search(data, progress)
        low, high = peak.interval
        text = words.chosen_ratio(exp(low), exp(high), chosen)
        return Pair(chosen * r, r, chosen * r_se, r_se, text=text), peak

    one = channel_fit("fixed_ratio", fit)
    return each_channel(z, dt, Progress(), spike_proof(one, lambda _: one, checked_robust(robust)))


def _smallest_step(samples: Array) -> float:
    """The smallest difference between two readings that is not rounding; 0 where all are equal."""
    levels = np.diff(np.unique(samples))
    levels = levels[levels > _MIN_STEP * np.abs(samples).max()]
    return float(levels.min(initial=math.inf)) if len(levels) else 0.0
