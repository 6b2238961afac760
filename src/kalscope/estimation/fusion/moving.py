"""Whether the quantity keeps its direction: the rule of one signal on the fused value; the fit with momentum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.estimation.estimate import estimate
from kalscope.estimation.fusion.asked import Question
from kalscope.estimation.fusion.search.fit import Asked, Found, best_fit, climbed, step_sizes
from kalscope.estimation.fusion.search.likelihood import Place, Readings, place_at, step_of
from kalscope.estimation.fusion.search.starting import guessed_noises
from kalscope.estimation.momentum.choice import MIN_GAIN, SHORT_RECORD
from kalscope.estimation.result import Estimate

_EVEN = 0.1
"""Share of the mean r that is added to each for the weights; of the largest, the least where a search begins."""

_STILL = 1e-3
"""Share of the squared steps of the readings from which a movement is searched that no other fit shows."""


def fused_signal(z: Array, place: Place, data: Readings, weights: Array) -> Array:
    """The weighted mean of what the sensors say of the quantity, unit, shape (n,); NaN where none answers."""
    said = (z - data.centre - place.offset * data.scale) / place.c
    present = np.isfinite(z)
    total = present @ weights
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(total > 0.0, np.where(present, said, 0.0) @ weights / total, np.nan)


def with_momentum(
    asked: Question, data: Readings, searched: Asked, plain: Found, tau: float | None, progress: Progress
) -> tuple[Found, Estimate]:
    """The fit with momentum where it is given or the signal asks for it, and what the fused signal says of it.

    Args:
        asked: the record.
        data: the same as readings.
        searched: what is searched.
        plain: the fit without momentum.
        tau: the momentum that is given; None = find it.
        progress: receives progress reports.
    """
    one, count = _asked_of_signal(asked, plain, tau, progress.part(0.0, 0.5))
    start = float(one.momentum) if tau is None else tau
    if not start:
        return plain, one
    fitted = replace(searched, keeps=tau is None)
    least = _STILL * float(step_sizes(data).max()) / step_of(start)
    step = float(one.q) / data.scale**2 or plain.place.q or least
    starts = [
        place_at(data.middle(), step, start, noise, plain.place.c)
        for noise in [*guessed_noises(asked.z, data, searched, plain.place.c), lifted(plain.place, searched)]
    ]
    found = best_fit(data, fitted, starts, progress.part(0.5, 1.0))
    if tau is None:
        found = within_record(data, fitted, found)
        needed = MIN_GAIN + SHORT_RECORD / count
        if 2.0 * (found.place.loglik - plain.place.loglik) <= needed:
            return plain, replace(one, momentum=0.0)
    return found, one


def _asked_of_signal(asked: Question, plain: Found, tau: float | None, progress: Progress) -> tuple[Estimate, int]:
    """The estimate of the fused value as one signal, and of how many rows.

    Without momentum one r may come out as 0 although its sensor is no better, only quicker than the random walk
    expects. So the mean with even weights is tried where the weighted one shows no momentum.
    """
    place, data = plain.place, plain.coordinates.data
    r = place.r / place.c**2
    dt = asked.steps if len(asked.steps) else None
    signal = fused_signal(asked.z, place, data, 1.0 / (r + _EVEN * r.mean()) if r.any() else np.ones(data.sensors))
    found = _estimate(signal, dt, tau, progress.part(0.0, 0.5))
    if data.sensors > 1 and not found.momentum:
        signal = fused_signal(asked.z, place, data, np.ones(data.sensors))
        found = _estimate(signal, dt, tau, progress.part(0.5, 1.0))
    return found, int(np.isfinite(signal).sum())


def _estimate(signal: Array, dt: Array | None, tau: float | None, progress: Progress) -> Estimate:
    moves = "auto" if tau is None else tau
    return estimate(signal, dt=dt, momentum=moves, robust=False, progress=progress, cancelled=progress.cancelled)


def lifted(place: Place, searched: Asked) -> Array:
    """Its r, none of those that are searched so small that the search begins at an edge."""
    return np.where(np.isnan(searched.known), np.maximum(place.r, _EVEN * place.r.max()), place.r)


def within_record(data: Readings, searched: Asked, found: Found) -> Found:
    """A momentum longer than the record is cut to its length: the record cannot show how much longer it is."""
    if found.place.tau <= data.span:
        return found
    place = place_at(data, found.place.q, data.span, found.place.r, found.place.c)
    return climbed(data, replace(searched, keeps=False), place)
