"""`estimate`: q and r from a record by a named method; `compare_methods`: all of them side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.progress import Progress
from kalscope.common.text import number
from kalscope.errors import BadSetting
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.likelihood.search import Peak
from kalscope.estimation.methods import allan, expectation_maximization, innovation_correlations, moments
from kalscope.estimation.methods import maximum_likelihood as ml
from kalscope.estimation.methods.pair import Pair
from kalscope.estimation.momentum.verdict import with_momentum
from kalscope.estimation.result import Estimate, stack
from kalscope.estimation.verdict import conclude, each_channel, gain_of
from kalscope.filtering.params import MAX_MOMENTUM, MIN_MOMENTUM

METHODS = ("ml", "em", "moments", "als", "allan")
"""What `estimate` knows, in the order in which `compare_methods` shows them."""


def estimate(
    z: ArrayLike,
    method: str = "ml",
    dt: ArrayLike | None = None,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    momentum: float | Literal["auto"] = "auto",
) -> Estimate:
    """Find q, r and momentum in a record, with intervals and a verdict in words.

    Args:
        z: measurements, shape (n,) or (n, channels: independent signals); NaN is a missing sample.
        method: "ml" maximum likelihood (recommended), or for comparison: "em" the same by small safe steps,
            "moments" of the differences, "als" correlations of the innovations, "allan" variance.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        progress: called with the fraction done and a few words; None = not reported.
        cancelled: whether to stop; None = never.
        momentum: τ in nominal sample periods, 0 … 1e5; 0 = none, the five lines. "auto" = find it, and take it
            where both the likelihood and the prediction of unseen samples speak for it. Only "ml" knows momentum:
            with another method "auto" is 0.

    Returns:
        An Estimate; its `params` are None where the record gives no usable pair, and its `message` says why.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z; the method is unknown, or knows no
            momentum; momentum is out of its range.
        Cancelled: `cancelled()` was true.

    Source: Durbin & Koopman (2012), section 2.10; each method's module names its own.
    """
    if method not in METHODS:
        raise BadSetting(f"method must be one of {', '.join(METHODS)} (got {method!r})")

    tau = checked_momentum(momentum, method)

    def fit(data: Differences, progress: Progress) -> tuple[Pair, Peak]:
        searched = 0.1 if method == "em" else 0.9  # EM's passes take most of the time
        peak = ml.search(data, progress.part(0.0, searched))
        return _pair(method, data, peak, progress.part(searched, 1.0)), peak

    def extend(data: Differences, plain: Estimate, progress: Progress) -> Estimate:
        return with_momentum(data, plain, tau, progress)

    return each_channel(method, z, dt, Progress(progress, cancelled), fit, None if tau == 0.0 else extend)


def checked_momentum(momentum: float | Literal["auto"], method: str) -> float | None:
    """τ in sample periods, as the filter will take it; None = to be found.

    Raises:
        BadSetting: it is out of its range, or above 0 for a method that knows no momentum.
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
        raise BadSetting(f'momentum must be "auto" or 0 for the method {method!r}, which knows none (got {tau:g})')
    return tau if tau >= MIN_MOMENTUM else 0.0


def compare_methods(
    z: ArrayLike,
    dt: ArrayLike | None = None,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> tuple[Estimate, ...]:
    """All methods on one record, in the order of METHODS; where they disagree, the first message says so.

    All are asked for the five lines, without momentum. Under that model they estimate the same two numbers. Where
    they differ significantly, the model does not describe the signal, and no pair can be trusted.

    Args:
        z: measurements, shape (n,) or (n, channels); NaN is a missing sample.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        progress: called with the fraction done and a few words.
        cancelled: whether to stop.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z.
        Cancelled: `cancelled()` was true.
    """
    others: dict[str, list[Estimate]] = {method: [] for method in METHODS[1:]}

    def fit(data: Differences, progress: Progress) -> tuple[Pair, Peak]:
        peak = ml.search(data, progress.part(0.0, 0.1))
        best = _pair("ml", data, peak, progress)
        table = [conclude("ml", data, best, peak)]
        for method, column in others.items():
            pair = _pair(method, data, peak, progress.part(*((0.1, 0.9) if method == "em" else (0.9, 1.0))))
            column.append(conclude(method, data, pair, peak))
            table.append(column[-1])
        found = disagreement(table)
        reason = best.note or (_REASON if found else "")
        return replace(best, note=f"{found} {reason}".strip()), peak

    first = each_channel("ml", z, dt, Progress(progress, cancelled), fit)
    if np.ndim(z) == 1:
        return first, *(found[0] if found else replace(first, method=m) for m, found in others.items())
    columns = [first.channel(c) for c in range(np.shape(z)[1])]
    rest: list[Estimate] = []
    for method, found in others.items():
        waiting = iter(found)
        silent = ("too_few", "constant")
        rest.append(
            stack([replace(one, method=method) if one.verdict in silent else next(waiting) for one in columns])
        )
    return first, *rest


def disagreement(estimates: Sequence[Estimate]) -> str:
    """A sentence on how other methods differ from the first, for one channel; "" where they agree.

    They differ where q or r is off by 30 % and by four standard errors (of both methods together; a variance
    found to be 0 has none). EM climbs the same likelihood as ML and does not count.
    """
    first = estimates[0]
    against = [one for one in estimates[1:] if one.method != "em" and _differ(first, one)]
    if not against:
        return ""
    named = ", ".join(f"{_NAMES[one.method]} {_describe(one, first)}" for one in against)
    gain = gain_of(float(first.ratio))
    return f"The model does not describe this signal: maximum likelihood finds gain {number(gain, 2)}, {named}."


_NAMES = {"moments": "the differences", "als": "the innovations", "allan": "the Allan variance"}

_REASON = (
    "It contains more than a random walk and white noise: a trend, an oscillation, spikes or slow noise. "
    "Choose the filter by lag or cut-off rather than by estimation."
)


def _describe(one: Estimate, first: Estimate) -> str:
    """What the other method finds: its gain, or the factor of its variances where the gain is the same."""
    gain, there = gain_of(float(one.ratio)), gain_of(float(first.ratio))
    if abs(gain - there) > 0.1 * max(gain, there):
        return f"gain {number(gain, 2)}"
    larger = float(one.q / first.q if first.q else one.r / first.r)
    return f"the same gain from {number(larger, 2)} times the variances"


def _pair(method: str, data: Differences, peak: Peak, progress: Progress) -> Pair:
    if method == "ml":
        return replace(ml.fit(data, peak), note=moments.what_differences_say(data))
    if method == "em":
        pair = expectation_maximization.fit(data, progress)
        top = ml.fit(data, peak)
        if math.isfinite(peak.log_ratio):
            return replace(pair, q_se=top.q_se, r_se=top.r_se)  # the same likelihood has the same curvature
        # EM approaches an edge but never reaches it.
        stopped = (
            f"EM approaches this edge slowly and stopped at q/r = {number(pair.q / pair.r)}." if pair.r else ""
        )
        return replace(top, note=stopped)
    progress(0.0, method)
    return {"moments": moments, "als": innovation_correlations, "allan": allan}[method].fit(data)


def _differ(a: Estimate, b: Estimate) -> bool:
    if b.verdict in ("too_few", "irregular", "bad_unit") or a.verdict == "bad_unit":
        return False
    return any(
        abs(x - y) > 0.3 * max(x, y) and abs(x - y) > 4.0 * math.hypot(_known(x_se), _known(y_se))
        for x, y, x_se, y_se in (
            (float(a.q), float(b.q), float(a.q_se), float(b.q_se)),
            (float(a.r), float(b.r), float(a.r_se), float(b.r_se)),
        )
    )


def _known(error: float) -> float:
    return error if math.isfinite(error) else 0.0
