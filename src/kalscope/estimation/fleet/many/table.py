"""EstimateTable: what was found in each of many series, one array a quantity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array, Mask
from kalscope.estimation.result import USABLE

VERDICTS = (
    "ok", "flat", "no_noise", "no_movement", "too_few", "constant", "bad_unit", "infinite", "bad_steps",
    "below_resolution", "only_spikes", "too_many_outliers", "not_converged", "irregular",
)  # fmt: skip
"""Every verdict by its code: those of `Estimate`, and "infinite" (a sample is inf) and "bad_steps" (a step is
negative or not finite), for which `estimate` raises an error."""

_USABLE_CODES = [VERDICTS.index(name) for name in USABLE]


@dataclass(frozen=True)
class EstimateTable:
    """q, r and the related results of k series, arrays of shape (k,). No number is NaN; see `Estimate`."""

    q: Array
    """Process-noise variance per nominal sample period, unit², ≥ 0; 0 where nothing could be fitted."""
    r: Array
    """Measurement-noise variance, unit², ≥ 0."""
    q_se: Array
    """Standard error of q, unit²; inf at an edge or where there is none."""
    r_se: Array
    """Standard error of r, unit²; inf at an edge."""
    loglik: Array
    """Log-likelihood at (q, r), exact diffuse start; 0 where nothing could be fitted."""
    ratio_interval: tuple[Array, Array]
    """The λ = q/r that the record allows: profile-likelihood 95 %, ends 0 … inf."""
    q_interval: tuple[Array, Array]
    """The q that the record allows, 95 %, from 0 where it does not exclude it, unit²; 0 and inf without any fit."""
    r_interval: tuple[Array, Array]
    """The r that the record allows, 95 %, from 0 where it does not exclude it, unit²; 0 and inf without any fit."""
    code: NDArray[np.uint8]
    """The verdict as its place in VERDICTS."""
    samples: NDArray[np.int64]
    """Finite samples; repeated lines of one time and value count once. 0 for "infinite" and "bad_steps"."""
    momentum: Array
    """Momentum τ, nominal sample periods; 0 = none."""
    momentum_interval: tuple[Array, Array]
    """The τ that the record allows, where it was searched."""
    spikes: NDArray[np.int64]
    """Samples set aside as spikes; 0 where the spike-proof fit was not used."""
    gate: Array
    """The gate that goes with the pair, standard deviations of the innovation; inf = none."""
    set_aside: NDArray[np.int64]
    """Samples set aside in all series, as indices into the concatenated series, ascending, shape (Σ spikes,)."""

    def __len__(self) -> int:
        return len(self.q)

    @property
    def ratio(self) -> Array:
        """λ = q/r, 0 … inf; 0 where both are 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.q > 0.0, self.q / self.r, 0.0)

    @property
    def verdict(self) -> NDArray[np.str_]:
        """The verdicts as words."""
        return np.array(VERDICTS)[self.code]

    @property
    def usable(self) -> Mask:
        """Where q and r are both above 0: a filter can be made of them."""
        return np.isin(self.code, _USABLE_CODES)

    @property
    def gain(self) -> Array:
        """Steady gain without momentum, 0 … 1."""
        return gains_of(self.ratio)

    @property
    def lag_samples(self) -> Array:
        """Lag on a ramp without momentum, samples, 0 … inf."""
        return lags_of(self.ratio)

    @property
    def gain_interval(self) -> tuple[Array, Array]:
        """The steady gains that the record allows, without momentum."""
        return gains_of(self.ratio_interval[0]), gains_of(self.ratio_interval[1])

    @property
    def lag_interval(self) -> tuple[Array, Array]:
        """The lags that the record allows, without momentum, samples, the short one first."""
        return lags_of(self.ratio_interval[1]), lags_of(self.ratio_interval[0])


def gains_of(ratio: Array) -> Array:
    """Steady gain of λ = 0 … inf: 2/(1 + √(1 + 4/λ))."""
    with np.errstate(divide="ignore"):
        return 2.0 / (1.0 + np.hypot(1.0, 2.0 / np.sqrt(ratio)))


def lags_of(ratio: Array) -> Array:
    """Lag on a ramp in samples of λ = 0 … inf, (1 − K)/K without cancellation."""
    with np.errstate(divide="ignore", invalid="ignore"):
        half = 2.0 / np.sqrt(ratio)
        return np.where(ratio > 0.0, 0.5 * half * (half / (np.hypot(1.0, half) + 1.0)), np.inf)


def reductions_of(ratio: Array) -> Array:
    """White noise in to out of λ = 0 … inf, dB: −10·log10(K/(2 − K))."""
    gain = gains_of(ratio)
    with np.errstate(divide="ignore"):
        return 10.0 * np.log10((2.0 - gain) / gain)
