"""One filter for all devices of a fleet, what each loses by it, and which devices are unlike the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array, Indices, Mask
from kalscope.errors import BadSetting
from kalscope.estimation.fleet.held_out import share_served
from kalscope.estimation.fleet.losses import Losses
from kalscope.estimation.fleet.pool import Pool
from kalscope.estimation.fleet.pooled import PooledFit, fit_pool, pool_at
from kalscope.estimation.fleet.unlike import Unlike, unlike
from kalscope.estimation.known import params_for_specification
from kalscope.filtering.params import FilterParams
from kalscope.recording import Recording
from kalscope.tuning.fleet.answer.devices import Devices
from kalscope.tuning.fleet.answer.over_time import OverTime, over_time
from kalscope.tuning.fleet.work.asked import Question

WITHIN = 0.1
"""Growth of the prediction error up to which a device counts as served."""
EXPECTED = 0.05
"""Devices that chance alone names as unlike the others, in each quantity: one in twenty fleets."""
CLOCKS = 1e-4
"""Share by which the rates of equal devices may differ: crystals, and stamps with few digits."""
QUANTITIES = ("r", "q", "rate_hz")
"""The quantities in which devices are compared."""


@dataclass(frozen=True)
class Shared:
    """One filter for all."""

    fit: PooledFit
    """The most likely one, or the one that meets the goal."""
    params: FilterParams
    """The filter itself."""
    how: str
    """How it was found, in a few words, for the tuning file."""
    losses: Losses
    """What each device loses by it, NaN for one that could not be judged."""

    @property
    def growth(self) -> Array:
        """By which share its prediction error on unseen samples is larger than with the device's own filter."""
        return self.losses.error

    @property
    def judged(self) -> int:
        """How many devices could be judged."""
        return int(np.isfinite(self.growth).sum())

    @property
    def served(self) -> float:
        """Share of the judged devices whose prediction error grows by at most WITHIN, 0 … 1."""
        return share_served(self.growth, WITHIN)

    @property
    def not_served(self) -> Indices:
        """The others, the worst first."""
        beyond = np.flatnonzero(self.growth > WITHIN)
        return beyond[np.argsort(-self.growth[beyond], kind="stable")]


@dataclass(frozen=True)
class Answer:
    """The answer for a fleet."""

    devices: Devices
    """The table."""
    shared: Shared | None
    """One filter for all; None where there is none, and `refusal` says why."""
    refusal: str
    """Why there is no such filter; "" where there is one."""
    unlike: dict[str, Unlike]
    """Which devices are unlike the others in each of QUANTITIES."""
    changed: dict[str, OverTime]
    """Which devices have changed in r and q, where a device has several recordings."""


def answer_for(devices: Devices, pool: Pool, question: Question) -> Answer:
    """The answer for a fleet.

    Args:
        devices: Its table.
        pool: What all recordings say about one filter without momentum.
        question: What was asked of each recording; a goal holds for the filter of all too.
    """
    shared, refusal = None, ""
    try:
        shared = _shared(devices, pool, question)
    except BadSetting as error:
        refusal = str(error)
    found = {name: unlike_in(devices, name) for name in QUANTITIES}
    changed = {name: one for name in ("r", "q") if (one := _over_time(devices, name)) is not None}
    return Answer(devices, shared, refusal, found, changed)


def _shared(devices: Devices, pool: Pool, question: Question) -> Shared:
    period = devices.sample_period
    time = np.arange(3.0) * (period or 1.0)
    request = question.request(Recording(time, ("",), ("",), np.zeros((3, 1)), period))
    momentum = 0.0
    if request.target:
        tau = request.checked_momentum() or 0.0
        wanted = params_for_specification(
            1.0, **request.target, sample_period=period, momentum=tau, overshoot=request.overshoot
        )
        fit, how, momentum = pool_at(pool, wanted.ratio), request.goal, wanted.momentum
    elif request.ratio is not None:
        fit, how = pool_at(pool, request.ratio), f"q/r = {request.ratio:g}"
    else:
        fit, how = fit_pool(pool), "pooled maximum likelihood"
    if fit.params is None:
        got = "r = 0" if fit.q > 0.0 else "q = 0"
        raise BadSetting(f"q and r of all must both be above 0 (got {got}): a goal such as --lag-ms 50 gives both")
    params = FilterParams(fit.q, fit.r, momentum=momentum)
    return Shared(fit, params, how, devices.losses(params))


def unlike_in(devices: Devices, name: str) -> Unlike:
    """Which devices are unlike the others in one of QUANTITIES."""
    values: Array = getattr(devices, name)
    usable = devices.usable & (values > 0.0)
    return unlike(_logs(values, usable), _log_interval(devices, name, usable), EXPECTED)


def _over_time(devices: Devices, name: str) -> OverTime | None:
    values: Array = getattr(devices, name)
    usable = devices.usable & (values > 0.0)
    interval = _log_interval(devices, name, usable)
    return over_time(devices.ids, devices.channels, _logs(values, usable), interval)


def _log_interval(devices: Devices, name: str, usable: Mask) -> tuple[Array, Array]:
    """The interval of a quantity in logarithms, unbounded where nothing was estimated."""
    if name == "rate_hz":
        logs = _logs(devices.rate_hz, usable)
        return logs - CLOCKS, logs + CLOCKS
    low, high = devices.q_interval if name == "q" else devices.r_interval
    logs = _logs(getattr(devices, name), usable)
    below, above = _logs(low, usable & (low > 0.0)), _logs(high, usable)
    return np.where(np.isnan(below), -np.inf, np.minimum(below, logs)), np.where(
        np.isnan(above), np.inf, np.maximum(above, logs)
    )


def _logs(values: Array, usable: Mask) -> Array:
    return np.log(np.where(usable, values, np.nan))
