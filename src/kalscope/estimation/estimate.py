"""`estimate`: q, r and momentum from a record by a named method."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

from numpy.typing import ArrayLike

from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation.known import above_rounding
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.methods import by_name
from kalscope.estimation.methods import maximum_likelihood as ml
from kalscope.estimation.methods.by_name import METHODS
from kalscope.estimation.momentum.verdict import with_given_momentum, with_momentum
from kalscope.estimation.result import Estimate
from kalscope.estimation.robust.fit import Fit, checked_robust, spike_proof
from kalscope.estimation.verdict.conclude import channel_fit, conclude, fit_record
from kalscope.filtering.params import MAX_MOMENTUM, MIN_MOMENTUM


def estimate(
    z: ArrayLike,
    method: str = "ml",
    dt: ArrayLike | None = None,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    momentum: float | Literal["auto"] = "auto",
    robust: bool | Literal["auto"] = "auto",
) -> Estimate:
    """Find q, r and momentum in a record, with intervals and a verdict in words.

    Args:
        z: measurements, shape (n,); NaN is a missing sample.
        method: "ml" maximum likelihood (recommended), or for comparison: "em" the same by small safe steps,
            "moments" of the differences, "als" correlations of the innovations, "allan" variance.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        progress: called with the fraction done and a few words; None = not reported.
        cancelled: whether to stop; None = never.
        momentum: τ in nominal sample periods, 0 … 1e5; 0 = none, the five lines. "auto" = find it, and take it
            where both the likelihood and the prediction of unseen samples favour it. Only "ml" supports momentum:
            with another method "auto" is 0.
        robust: whether spikes, samples that neither those before nor those after predict, are set aside before the
            fit: True always, False never, "auto" where there are any. Only "ml" can: with another method "auto" is
            False.

    Returns:
        An Estimate; its `params` are None where the record gives no usable pair, and its `message` says why.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z; the method is unknown, or does not support
            momentum; momentum is out of its range; robust is something else.
        Cancelled: `cancelled()` was true.

    Source: Durbin & Koopman (2012), section 2.10; each method's module names its own.
    """
    if method not in METHODS:
        raise BadSetting(f"method must be one of {', '.join(METHODS)} (got {method!r})")

    tau = checked_momentum(momentum, method)

    def walk(data: Differences, progress: Progress) -> Estimate:
        searched = 0.1 if method == "em" else 0.9  # EM's passes take most of the time
        peak = ml.search(data, progress.part(0.0, searched))
        return conclude(method, data, by_name.fit(method, data, peak, progress.part(searched, 1.0)), peak)

    def channel(tau: float | None) -> Fit:
        def fit(data: Differences, progress: Progress) -> Estimate:
            if tau:
                return with_given_momentum(data, tau, progress)
            if tau == 0.0:
                return walk(data, progress)
            return with_momentum(data, walk(data, progress.part(0.0, 0.1)), progress.part(0.1, 1.0))

        one = channel_fit(method, fit)
        return above_rounding(one) if method == "ml" else one

    full = channel(tau)
    whole = spike_proof(full, channel if tau is None else lambda _: full, checked_robust(robust, method == "ml"))
    return fit_record(z, dt, Progress(progress, cancelled), whole)


def checked_momentum(momentum: float | Literal["auto"], method: str) -> float | None:
    """τ in sample periods, as the filter will take it; None = to be found.

    Raises:
        BadSetting: it is out of its range, or above 0 for a method that does not support momentum.
    """
    if isinstance(momentum, str) and momentum == "auto":
        return None if method == "ml" else 0.0
    try:
        tau = float(momentum)
    except (TypeError, ValueError):
        tau = math.nan
    if not 0.0 <= tau <= MAX_MOMENTUM:
        raise BadSetting(f'momentum must be "auto" or sample periods from 0 to 1e5 (got {momentum!r})')
    if tau > 0.0 and method != "ml":
        raise BadSetting(f'momentum must be "auto" or 0 for the method {method!r}, which has none (got {tau:g})')
    return tau if tau >= MIN_MOMENTUM else 0.0
