"""One filter for a whole fleet: the pair that maximises the summed log-likelihood, or that meets a target."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from kalscope.common.array import Array
from kalscope.common.checks import above_zero
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation.fleet.pool import Pool, refuse_empty
from kalscope.estimation.likelihood.profile import DEFAULT_LOG_RATIOS
from kalscope.estimation.likelihood.search import Peak, find_peak
from kalscope.estimation.verdict.conclude import exp
from kalscope.filtering.params import MAX_VARIANCE, FilterParams

Scale = Literal["each", "common"]


@dataclass(frozen=True)
class PooledFit:
    """One filter for all devices of a fleet."""

    q: float
    """Process-noise variance per nominal sample period, unit²; 0 for "no_movement"."""
    r: float
    """Measurement-noise variance, unit²: the common one, or the geometric mean of those of the devices; 0 for
    "no_noise"."""
    ratio: float
    """λ = q/r that all share, 0 … inf."""
    loglik: float
    """Summed log-likelihood there."""
    ratio_interval: tuple[float, float]
    """The λ that another fleet of such devices may have as its best one, 95 %: profile likelihood, wider where the
    devices differ. It is narrow for a large fleet, and does not show how far its devices differ: see `unlike`."""
    verdict: str
    """"ok", "no_noise", "no_movement" or "flat", as in `Estimate`; "given" where a target fixed λ."""
    scale: Scale
    """Whether every device has its own r ("each"), or all share one ("common")."""
    devices: int
    """Devices that count."""
    innovations: int
    """Their scored innovations."""

    @property
    def params(self) -> FilterParams | None:
        """The filter that all get, diffuse start; None where q or r is 0."""
        return FilterParams(q=self.q, r=self.r) if self.q > 0.0 and self.r > 0.0 else None


def fit_pool(pool: Pool, scale: Scale = "each") -> PooledFit:
    """The most likely filter for all devices of a fleet.

    Args:
        pool: of the fleet, the sum of the pools of its batches.
        scale: "each": one λ, and every device its own r, concentrated out (the filter only knows λ); "common": one
            (q, r) for all, in one unit.

    Raises:
        BadSetting: no device counts; scale is something else.
    """
    common = _is_common(scale)
    refuse_empty(pool)
    ends = [float(pool.loglik(DEFAULT_LOG_RATIOS[:1] * 0.0 + end, common)[0]) for end in (-math.inf, math.inf)]
    peak = find_peak(lambda at: pool.loglik(at, common), DEFAULT_LOG_RATIOS[::2], ends[1], Progress())
    low, high = peak.interval if common else _interval(pool, peak, ends[1])
    noise = pool.noise(peak.log_ratio, common)
    q, r = exp(peak.log_ratio) * noise, noise
    verdict = "flat" if (low, high) == (-math.inf, math.inf) else "ok"
    if peak.log_ratio == math.inf:
        q, r, verdict = noise, 0.0, "no_noise"
    elif peak.log_ratio == -math.inf:
        q, verdict = 0.0, "no_movement"
    return PooledFit(
        q,
        r,
        exp(peak.log_ratio),
        peak.loglik,
        (exp(low), exp(high)),
        verdict,
        scale,
        pool.devices,
        pool.innovations,
    )


def _interval(pool: Pool, peak: Peak, at_infinity: float) -> tuple[float, float]:
    """The interval of ln λ, which accounts for how much the devices differ.

    The slopes of the devices at the top scatter by the curvature where all share λ, by more where they do not; the
    likelihood is flattened by that factor.

    Source: Kent (1982), Biometrika 69, 19, for the likelihood ratio of a model that is not quite true.
    """
    if not (math.isfinite(peak.log_ratio) and peak.curvature < 0.0):
        return peak.interval
    factor = pool.slopes(peak.log_ratio) / -peak.curvature
    if factor <= 1.0:
        return peak.interval

    def flattened(at: Array) -> Array:
        return pool.loglik(at, False) / factor

    return find_peak(flattened, DEFAULT_LOG_RATIOS[::2], at_infinity / factor, Progress()).interval


def pool_at(pool: Pool, ratio: float, scale: Scale = "each") -> PooledFit:
    """The filter of a given λ (of `ratio_for` a lag, say) for all devices of a fleet, with the r that fits it best.

    Args:
        pool: of the fleet.
        ratio: λ = q/r, > 0.
        scale: as in `fit_pool`.

    Raises:
        BadSetting: no device counts; ratio is not above 0; scale is something else.
    """
    common = _is_common(scale)
    refuse_empty(pool)
    chosen = above_zero("ratio", ratio, MAX_VARIANCE)
    best = fit_pool(pool, scale)
    r = pool.noise(math.log(chosen), common)
    loglik = float(pool.loglik(DEFAULT_LOG_RATIOS[:1] * 0.0 + math.log(chosen), common)[0])
    return PooledFit(
        chosen * r, r, chosen, loglik, best.ratio_interval, "given", scale, pool.devices, pool.innovations
    )


def _is_common(scale: Scale) -> bool:
    if scale not in ("each", "common"):
        raise BadSetting(f'scale must be "each" or "common" (got {scale!r})')
    return scale == "common"
