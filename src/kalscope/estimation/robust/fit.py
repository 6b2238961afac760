"""The loop of the spike-proof fit: fit, set aside what neither side predicts, fit again until nothing changes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation.result import Estimate
from kalscope.estimation.robust import words
from kalscope.estimation.robust.gate import advised_gate
from kalscope.estimation.robust.spikes import SIGMAS, Mask, far_from_median, more_than_chance, unpredicted
from kalscope.estimation.robust.truncation import kept_variance
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state

Fit = Callable[[Array, Array, Progress], Estimate]
"""The fit of one channel: samples, shape (n,), NaN where missing; steps, empty = 1 each."""

MAX_SHARE = 0.2
"""Share of the samples set aside beyond which no pair is given: that much is not a few spikes."""
MAX_FITS = 20
"""Rounds of the loop, at most."""
_NOTHING_TO_JUDGE = ("too_few", "constant", "bad_unit")


@dataclass(frozen=True)
class _Found:
    """A fit to the samples that are left."""

    estimate: Estimate
    away: Mask
    """The samples set aside."""
    scores: Array
    """e²/s of the samples that neither side predicts by this fit."""


def checked_robust(robust: Any, known: bool = True) -> bool | None:
    """True = always, False = never, None = where spikes are found.

    Args:
        robust: as `estimate` takes it.
        known: whether the method has a spike-proof fit; "auto" is False where it has none.

    Raises:
        BadSetting: something else, or True for a method without such a fit.
    """
    if isinstance(robust, str) and robust == "auto":
        return None if known else False
    if not isinstance(robust, bool):
        raise BadSetting(f'robust must be "auto", True or False (got {robust!r})')
    if robust and not known:
        raise BadSetting('robust must be "auto" or False with this method: only "ml" sets spikes aside (got True)')
    return robust


def spike_proof(full: Fit, with_momentum: Callable[[float], Fit], always: bool | None) -> Fit:
    """A fit that sets spikes aside.

    Args:
        full: the fit as asked for.
        with_momentum: the same with a momentum that is given, for the steps in between; may return `full`.
        always: False = `full` itself; None = its numbers, bit for bit, unless there are spikes that can be
            distinguished from movement. They cannot where no noise is left without them and a gate does more harm
            than good.
    """
    if always is False:
        return full

    def fit(z: Array, steps: Array, progress: Progress) -> Estimate:
        plain = full(z, steps, progress.part(0.0, 0.3))
        if plain.verdict in _NOTHING_TO_JUDGE:
            return plain
        start = far_from_median(z)
        if always is None and not (start.looks_spiky or more_than_chance(_scores(z, steps, plain), z)):
            return plain
        found = _settle(z, steps, plain, full, with_momentum, start.far, progress.part(0.3, 0.95))
        if always is None and not more_than_chance(np.where(found.away, found.scores, 0.0), z):
            return plain
        answer = _conclude(z, steps, plain, found)
        if always is None and answer.verdict == "no_noise" and plain.params is not None:
            return replace(plain, message=f"{plain.message} {words.kept(int(found.away.sum()))}")
        return answer

    return fit


def _settle(
    z: Array,
    steps: Array,
    plain: Estimate,
    full: Fit,
    with_momentum: Callable[[float], Fit],
    away: Mask,
    progress: Progress,
) -> _Found:
    """Fit and set aside in turn. The full fit has the last word: momentum is better found without spikes."""
    seen: list[bytes] = []
    tau, start = float(plain.momentum), away
    fit = with_momentum(tau)
    for count in range(MAX_FITS):
        progress.step(count, "samples that neither side predicts")
        one = fit(np.where(away, np.nan, z), steps, progress.part(1.0 - 0.8**count, 1.0 - 0.8 ** (count + 1)))
        if one.verdict in _NOTHING_TO_JUDGE:
            return _Found(one, away, np.where(away, math.inf, 0.0))
        scores = _scores(z, steps, one)
        next_away = scores > 0.0
        if np.array_equal(next_away, away):
            if fit is full:
                return _Found(one, away, scores)
            fit = full
            continue
        if next_away.tobytes() in seen:  # a few doubtful samples come and go: they stay in
            away = away & next_away
            break
        seen.append(away.tobytes())
        away = next_away
        if float(one.momentum) != tau:  # another model: from the start
            tau, away, seen = float(one.momentum), start | away, []
        fit = with_momentum(tau)
    one = full(np.where(away, np.nan, z), steps, progress)
    return _Found(one, away, _scores(z, steps, one))


def _scores(z: Array, steps: Array, one: Estimate) -> Array:
    return unpredicted(z, steps, float(one.q), float(one.r), float(one.momentum))


def _conclude(z: Array, steps: Array, plain: Estimate, found: _Found) -> Estimate:
    """The estimate with all that is known about the samples set aside."""
    one, count = found.estimate, int(found.away.sum())
    present = int(np.isfinite(z).sum())
    known: dict[str, Any] = {
        "outliers": found.away,
        "outlier_share": count / present,
        "plain_q": plain.q,
        "plain_r": plain.r,
        "plain_momentum": plain.momentum,
    }
    if count > MAX_SHARE * present:
        text = words.too_many(count, present)
        return replace(one, verdict="too_many_outliers", message=text, params=None, **known)
    gate = None
    if count:
        one, gate = _with_gate(z, steps, one, found.away)
    message = f"{words.set_aside(count, present, plain, gate)} {one.message}".strip()
    return replace(one, message=message, gate=gate, **known)


def _with_gate(z: Array, steps: Array, one: Estimate, away: Mask) -> tuple[Estimate, float | None]:
    """The estimate with a gate in its parameters, and the gate in σ; None where the filter does better without."""
    some = _only_spikes(one) if one.verdict == "no_noise" else _untruncated(one)
    if some.params is None:
        return some, None
    gate = advised_gate(z, steps, some.params, away)
    if gate is None:
        return (one if some.verdict == "only_spikes" else some), None
    return replace(some, params=replace(some.params, gate=gate * gate)), gate


def _only_spikes(one: Estimate) -> Estimate:
    """The estimate of a record whose only noise is spikes, with the largest r that it allows: a pair to gate."""
    least = float(one.ratio_interval[0])
    if least <= 0.0:
        return one
    params = FilterParams(q=float(one.q), r=float(one.q) / least, momentum=float(one.momentum))
    return replace(
        one,
        r=float(one.q) / least,
        ratio=least,
        verdict="only_spikes",
        message=words.only_spikes(params),
        params=params,
    )


def _untruncated(one: Estimate) -> Estimate:
    """With the noise of the good samples that the rule set aside too; q/r, and all that follows from it, stays."""
    if one.params is None:
        return one
    shown = kept_variance(steady_state(one.params).gain, SIGMAS)
    q, r = float(one.q) / shown, float(one.r) / shown
    return replace(
        one,
        q=q,
        r=r,
        q_se=float(one.q_se) / shown,
        r_se=float(one.r_se) / shown,
        params=replace(one.params, q=q, r=r),
    )
