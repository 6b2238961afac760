"""What an estimate finds: of one record, and of one with momentum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope.filtering.params import FilterParams

# Estimate: the result of every method.


@dataclass(frozen=True)
class Estimate:
    """q and r found in a record, with their uncertainty.

    No field is ever NaN. Where the record cannot give a usable pair `params` is None, `verdict` is not "ok",
    and `message` says what that means and what to do instead; q and r then hold the maximum of the
    likelihood (r = 0 for "no_noise", q = 0 for "no_movement"), or 0 where there is nothing to maximise.
    """

    method: str
    """How it was found: "ml", "moments", "als", "allan", "fixed_r" or "fixed_ratio"."""
    q: float
    """Process-noise variance per nominal sample period, unit², ≥ 0."""
    r: float
    """Measurement-noise variance, unit², ≥ 0."""
    ratio: float
    """λ = q/r, 0 … inf; 0 where both are 0."""
    loglik: float
    """Log-likelihood at (q, r), exact diffuse start, first finite sample not scored; 0 where nothing
    is, −inf where r = 0 contradicts two samples at one instant. Of "below_resolution" and "only_spikes" it is the
    highest, at a smaller r."""
    ratio_interval: tuple[float, float]
    """The λ that the record allows: profile-likelihood 95 %, whatever the method; ends may be 0 and inf. Where
    momentum is likelier but not by enough to be chosen, the intervals hold with it and without."""
    gain_interval: tuple[float, float]
    """The same as steady gain, 0 … 1."""
    lag_interval: tuple[float, float]
    """The same as lag behind a ramp, samples, 0 … inf, short one first."""
    q_se: float
    """Standard error of q, unit²; inf at an edge, where there is none."""
    r_se: float
    """Standard error of r, unit²; inf at an edge."""
    verdict: str
    """"ok", "no_noise" (r → 0), "no_movement" (q → 0), "flat" (any λ explains the record), "too_few",
    "constant", "bad_unit" (variances outside 1e-300 … 1e300), "irregular" (the method needs regular sampling),
    "too_many_outliers" (over 20 % of the samples set aside), "below_resolution" (the noise is
    smaller than the steps of the readings: r is Δ²/12) or "only_spikes" (no noise apart from spikes: r is the
    largest that the record allows, and the gate does the work)."""
    message: str
    """What was found, what it means and what to do, for the user."""
    params: FilterParams | None
    """The pair and its momentum, ready for the filter, diffuse start; None without a pair."""
    momentum: float = 0.0
    """Momentum τ, nominal sample periods; 0 = none, the five lines."""
    momentum_interval: tuple[float, float] = (0.0, 0.0)
    """The τ that the record allows, where it was searched: profile-likelihood 95 %, from 0, or up to inf."""
    prediction_gain: float = 0.0
    """By which fraction momentum makes the one-step error smaller on samples that the fit had not seen, below 0
    where larger; 0 where that was not tried."""
    outliers: NDArray[np.bool_] | None = None
    """Samples that the spike-proof fit set aside, shape of z; None where it was not used."""
    outlier_share: float = 0.0
    """Their share of the samples that are not missing, 0 … 1."""
    gate: float | None = None
    """The gate that goes with the pair, standard deviations of the innovation; `params` holds its square. None
    where the filter does better without one."""
    plain_q: float = 0.0
    """The q of the fit to all samples; 0 where the spike-proof fit was not used."""
    plain_r: float = 0.0
    """The r of the fit to all samples; 0 where the spike-proof fit was not used."""
    plain_momentum: float = 0.0
    """The momentum of the fit to all samples; 0 where the spike-proof fit was not used."""
    resolution: float = 0.0
    """Step Δ of the readings, unit; 0 where they show none, or none was searched for."""


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
    """A verdict of the method itself: "irregular", "too_few"; "" = judge by the numbers."""
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
