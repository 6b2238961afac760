"""Estimate: the result of every method, one value for one channel or arrays for several."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array
from kalscope.filtering.params import NO_GATE, FilterParams

Value = float | Array
Words = str | NDArray[np.str_]


@dataclass(frozen=True)
class Estimate:
    """q and r found in a record, with their uncertainty. For z of shape (n, channels) fields are arrays.

    No field is ever NaN. Where the record cannot give a usable pair `params` is None, `verdict` is not "ok",
    and `message` says what that means and what to do instead; q and r then hold the maximum of the
    likelihood (r = 0 for "no_noise", q = 0 for "no_movement"), or 0 where there is nothing to maximise.
    """

    method: str
    """How it was found: "ml", "em", "moments", "als", "allan", "fixed_r" or "fixed_ratio"."""
    q: Value
    """Process-noise variance per nominal sample period, unit², ≥ 0."""
    r: Value
    """Measurement-noise variance, unit², ≥ 0."""
    ratio: Value
    """λ = q/r, 0 … inf; 0 where both are 0."""
    loglik: Value
    """Log-likelihood at (q, r), exact diffuse start, first finite sample not scored; 0 where nothing
    is, −inf where r = 0 contradicts two samples at one instant. Of "below_resolution" and "only_spikes" it is the
    highest, at a smaller r."""
    ratio_interval: tuple[Value, Value]
    """The λ that the record allows: profile-likelihood 95 %, whatever the method; ends may be 0 and inf."""
    gain_interval: tuple[Value, Value]
    """The same as steady gain, 0 … 1."""
    lag_interval: tuple[Value, Value]
    """The same as lag behind a ramp, samples, 0 … inf, short one first."""
    q_se: Value
    """Standard error of q, unit²; inf at an edge, where there is none."""
    r_se: Value
    """Standard error of r, unit²; inf at an edge."""
    verdict: Words
    """"ok", "no_noise" (r → 0), "no_movement" (q → 0), "flat" (any λ explains the record), "too_few",
    "constant", "bad_unit" (variances outside 1e-300 … 1e300), "irregular" (the method needs regular sampling),
    "not_converged", "too_many_outliers" (over 20 % of the samples set aside), "below_resolution" (the noise is
    smaller than the steps of the readings: r is Δ²/12) or "only_spikes" (no noise apart from spikes: r is the
    largest that the record allows, and the gate does the work)."""
    message: Words
    """What was found, what it means and what to do, for the user."""
    params: FilterParams | None
    """The pair and its momentum, ready for the filter, diffuse start; None without a pair (in any channel)."""
    momentum: Value = 0.0
    """Momentum τ, nominal sample periods; 0 = none, the five lines."""
    momentum_interval: tuple[Value, Value] = (0.0, 0.0)
    """The τ that the record allows, where it was searched: profile-likelihood 95 %, from 0, or up to inf."""
    prediction_gain: Value = 0.0
    """By which fraction momentum makes the one-step error smaller on samples that the fit had not seen, below 0
    where larger; 0 where that was not tried."""
    agreement: Value = 1.0
    """Of `compare_methods`: the share of records simulated under the maximum-likelihood pair in which this method
    lies as far from it, 0 … 1; 1 where it does not count."""
    not_counted: Words = ""
    """Of `compare_methods`: why this second opinion does not count; "" where it does."""
    outliers: NDArray[np.bool_] | None = None
    """Samples that the spike-proof fit set aside, shape of z; None where it was not used (in any channel)."""
    outlier_share: Value = 0.0
    """Their share of the samples that are not missing, 0 … 1."""
    gate: Value | None = None
    """The gate that goes with the pair, standard deviations of the innovation; `params` holds its square. None
    where the filter does better without one, inf in such channels beside others."""
    plain_q: Value = 0.0
    """The q of the fit to all samples; 0 where the spike-proof fit was not used."""
    plain_r: Value = 0.0
    """The r of the fit to all samples; 0 where the spike-proof fit was not used."""
    plain_momentum: Value = 0.0
    """The momentum of the fit to all samples; 0 where the spike-proof fit was not used."""
    resolution: Value = 0.0
    """Step Δ of the readings, unit; 0 where they show none, or none was searched for."""

    def channel(self, index: int) -> Estimate:
        """One channel of an estimate for several, as scalars."""
        if np.ndim(self.q) == 0:
            return self
        values: dict[str, Any] = {
            f.name: _pick(getattr(self, f.name), index) for f in fields(self) if f.name != "outliers"
        }
        if self.outliers is not None:
            values["outliers"] = np.ascontiguousarray(self.outliers[:, index])
        if values["gate"] == math.inf:
            values["gate"] = None
        usable = values["verdict"] in USABLE
        values["params"] = _params(values) if usable else None
        return Estimate(**values)


USABLE = ("ok", "flat", "not_converged", "below_resolution", "only_spikes")
"""Verdicts with parameters: both variances are above 0, though perhaps uncertain."""


def stack(estimates: Sequence[Estimate]) -> Estimate:
    """The estimates of several channels as one, fields of shape (channels,)."""
    if not estimates:
        raise ValueError("at least one estimate is needed (got none)")
    values: dict[str, Any] = {}
    for f in fields(Estimate):
        column = [getattr(one, f.name) for one in estimates]
        if f.name.endswith("_interval"):
            values[f.name] = tuple(np.array(end) for end in zip(*column, strict=True))
        elif f.name not in ("method", "params", "outliers", "gate"):
            values[f.name] = np.array(column)
    usable = all(one.params is not None for one in estimates)
    values["method"] = estimates[0].method
    values["outliers"] = _side_by_side([one.outliers for one in estimates])
    gates = [one.gate for one in estimates]
    if any(gate is not None for gate in gates):
        values["gate"] = np.array([math.inf if gate is None else gate for gate in gates])
    values["params"] = _params(values) if usable else None
    return Estimate(**values)


def _side_by_side(columns: Sequence[NDArray[np.bool_] | None]) -> NDArray[np.bool_] | None:
    """The samples set aside in each channel, shape (n, channels); None where that is None in all of them."""
    lengths = [len(column) for column in columns if column is not None]
    if not lengths:
        return None
    none = np.zeros(lengths[0], dtype=bool)
    return np.stack([none if column is None else column for column in columns], axis=1)


def _params(values: dict[str, Any]) -> FilterParams:
    momentum, gate = values["momentum"], values.get("gate")
    return FilterParams(
        q=values["q"],
        r=values["r"],
        gate=None if gate is None else np.minimum(np.square(gate), NO_GATE),
        momentum=momentum if np.any(momentum) else 0.0,
    )


def _pick(value: Any, index: int) -> Any:
    if isinstance(value, tuple):
        return tuple(_pick(end, index) for end in cast("tuple[Any, ...]", value))
    return value[index].item() if isinstance(value, np.ndarray) else value
