"""What an estimate finds: of one record, or of several sensors of one quantity."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalscope.common.numbers import ShortRepr
from kalscope.filtering.params import FilterParams

# Estimate: the result of every method.


@dataclass(frozen=True)
class Shared:
    """White noise that sensors have in common."""

    sensors: tuple[int, ...]
    """Two of them, or all."""
    correlation: float
    """Of the noises of these two, or the largest of any two of all, 0 … 1."""
    rise: float
    """By how much it raises twice the log-likelihood."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Estimate(ShortRepr):
    """q, r and momentum of a record, or of several sensors of one quantity, with their uncertainty.

    No field is ever NaN. Where the record cannot give a usable filter `params` is None, `verdict` is not "ok", and
    `message` says what that means and what to do instead; q and r then hold the maximum of the likelihood (r = 0
    for "no_noise", q = 0 for "no_movement"), or 0 where there is nothing to maximise. All 95 % intervals are of the
    profile of the likelihood, or from its curvature where that is as good; their ends may be 0 and inf.
    """

    method: str = "ml"
    """How it was found: "ml", "fixed_r" or "fixed_ratio"."""
    names: tuple[str, ...] = ()
    """The sensors of a fusion, in the order of the columns; () for one record."""
    q: float
    """Process-noise variance per nominal sample period, unit², ≥ 0."""
    r: Any
    """Measurement-noise variance, unit², ≥ 0: a number, or one of each sensor, shape (sensors,)."""
    loglik: float
    """Log-likelihood at (q, r), exact diffuse start, first finite sample not scored, spikes left out; 0 where
    nothing is, −inf where r = 0 contradicts two samples at one instant. Of "below_resolution" and "only_spikes" it
    is the highest, at a smaller r."""
    verdict: str
    """"ok", "no_noise" (r → 0, of one sensor at least), "no_movement" (q → 0), "flat" (any λ explains the record),
    "too_few", "constant", "bad_unit" (variances outside 1e-300 … 1e300), "too_many_outliers" (over 20 % of the
    samples set aside), "below_resolution" (the noise is smaller than the steps of the readings: r is Δ²/12) or
    "only_spikes" (no noise apart from spikes: r is the largest that the record allows, and the gate does the work).
    Of several sensors also "shared_noise" (the noises of two, or of all, are correlated: the fused value can be
    worse than predicted) and "copies" (two always move exactly alike)."""
    message: str
    """What was found, what it means and what to do, for the user."""
    params: FilterParams | None
    """The filter, diffuse start; None where there is none. With "no_noise" or "no_movement" of several sensors it
    has the largest variance that the record allows."""
    momentum: float = 0.0
    """Momentum τ, nominal sample periods; 0 = none, the five lines."""
    momentum_interval: tuple[float, float] = (0.0, 0.0)
    """The τ that the record allows, where it was searched, from 0, or up to inf."""
    prediction_gain: float = 0.0
    """By which fraction momentum makes the one-step error smaller on samples that the fit had not seen, below 0
    where larger; 0 where that was not tried."""
    q_se: float = math.inf
    """Standard error of q, unit²; inf at an edge, where there is none, and for several sensors."""
    r_se: float = math.inf
    """Standard error of r, unit²; inf as for q."""
    ratio_interval: tuple[float, float] = (0.0, math.inf)
    """The λ that one record allows, whatever the method; this and the next two are not found for several sensors,
    where `q_interval` and `r_interval` are. Where momentum is likelier but not by enough to be chosen,
    the intervals hold with it and without."""
    lag_interval: tuple[float, float] = (0.0, math.inf)
    """The same as lag behind a ramp, samples, short one first."""
    gain_interval: tuple[float, float] = (0.0, 1.0)
    """The same as steady gain."""
    outliers: NDArray[np.bool_] | None = None
    """Samples that the spike-proof fit set aside, shape of z; None where it was not used."""
    outlier_share: float = 0.0
    """Their share of the samples of one record that are not missing, 0 … 1."""
    plain_q: float = 0.0
    """The q of the fit to all samples; 0 where the spike-proof fit was not used."""
    plain_r: float = 0.0
    """The r of the fit to all samples; 0 where the spike-proof fit was not used."""
    plain_momentum: float = 0.0
    """The momentum of the fit to all samples; 0 where the spike-proof fit was not used."""
    resolution: float = 0.0
    """Step Δ of the readings, unit; 0 where they show none, or none was searched for."""
    # What only a fusion has.
    offset: Any = ()
    """Offset of each sensor, unit, shape (sensors,): that of the reference is 0; without one their sum is, each
    with the sign of its gain."""
    gain: Any = ()
    """Gain of each sensor, shape (sensors,): 1 unless they were searched."""
    q_interval: Any = ()
    """The q that the record allows, unit², shape (2,)."""
    r_interval: Any = ()
    """The r that it allows, unit², shape (sensors, 2); both ends are r itself where it was given."""
    offset_interval: Any = ()
    """The offsets that it allows, unit, shape (sensors, 2)."""
    sensor_gain_interval: Any = ()
    """The gains of the sensors that it allows, shape (sensors, 2)."""
    shared: Shared | None = None
    """The sensors whose noises are correlated; None where none shows."""
    notes: tuple[str, ...] = ()
    """What cannot be known, or should be checked; one sentence each."""

    @property
    def ratio(self) -> Any:
        """λ = q/r, 0 … inf, of one record or of each sensor; 0 where both are 0."""
        if np.ndim(self.r) == 0:
            return self.q / self.r if self.r > 0.0 else math.inf if self.q > 0.0 else 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.nan_to_num(self.q / self.r, posinf=math.inf)

    @property
    def gate(self) -> float | None:
        """The gate of `params`, standard deviations of the innovation; None where the filter is better without."""
        return None if self.params is None or self.params.gate is None else math.sqrt(self.params.gate)

    @property
    def spikes(self) -> tuple[NDArray[np.intp], ...]:
        """The rows of the samples of each sensor that were set aside."""
        return () if self.outliers is None else tuple(map(np.flatnonzero, np.atleast_2d(self.outliers.T)))


USABLE = ("ok", "flat", "below_resolution", "only_spikes")
"""Verdicts with parameters: both variances are above 0, though perhaps uncertain."""


# What each method returns.


@dataclass(frozen=True)
class Pair:
    """What one method finds in one channel, in the squared scale of its `Differences`."""

    q: float
    """Process-noise variance, scale², ≥ 0."""
    r: float
    """Measurement-noise variance, scale², ≥ 0."""
    q_se: float
    """Standard error of q, scale²; inf where unknown."""
    r_se: float
    """Standard error of r, scale²; inf where unknown."""
    verdict: str = ""
    """Such as "bad_unit"; "" = judge by the numbers."""
    text: str = ""
    """The message, in place of the one for the verdict; "" = that one."""
    note: str = ""
    """A sentence to add to the message."""


# The best q, r and τ of a record, and how well it determines them.


@dataclass(frozen=True)
class MomentumFit:
    """q, r and τ at the maximum of the likelihood, in the unit of the data."""

    q: float
    """Process-noise variance per sample, unit²."""
    r: float
    """Measurement-noise variance, unit²."""
    tau: float
    """Momentum in sample periods."""
    loglik: float
    """Log-likelihood there, comparable with that of the random walk."""
    q_se: float
    """Standard error of q, unit²; inf at an edge."""
    r_se: float
    """Standard error of r, unit²; inf at an edge."""
    tau_interval: tuple[float, float]
    """The τ that the record allows: profile-likelihood 95 %, from 0, or up to inf; τ itself where it was given."""
    region: tuple[tuple[float, float], ...]
    """Pairs (q/r, τ) on the border of what the record allows: the possible filters lie between them."""
