"""`estimate_fusion`: q, momentum, and the noise and offset of each of several sensors of one quantity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.progress import OnProgress, Progress
from kalscope.estimation.estimate import checked_momentum, estimate
from kalscope.estimation.fusion import words
from kalscope.estimation.fusion.asked import Question, question
from kalscope.estimation.fusion.conclude import conclude, refused
from kalscope.estimation.fusion.moving import with_momentum
from kalscope.estimation.fusion.result import FusionEstimate
from kalscope.estimation.fusion.search.fit import Asked, Found, best_fit
from kalscope.estimation.fusion.search.likelihood import Readings
from kalscope.estimation.fusion.search.starting import starting_gains, starting_places
from kalscope.estimation.fusion.spikes import spikes_of
from kalscope.estimation.result import Estimate
from kalscope.estimation.robust.fit import checked_robust
from kalscope.estimation.robust.spikes import rounding_variance


def estimate_fusion(
    z: ArrayLike,
    *,
    dt: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    momentum: float | Literal["auto"] = "auto",
    robust: bool | Literal["auto"] = "auto",
    gains: bool = False,
    reference: int | str | None = None,
    known_r: ArrayLike | None = None,
    progress: OnProgress | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> FusionEstimate:
    """Find how one quantity moves, and the noise and offset of each sensor that reads it, by maximum likelihood.

    What the sensors share is the signal, what they do not is their noise: sensor i reads b_i + c_i x + noise of
    variance r_i. Sensors may have different rates, and miss any reading.

    Args:
        z: readings, shape (n, sensors) or (n,); NaN is a missing one.
        dt: nominal sample periods before each row, shape (n,), ≥ 0; None = 1 each.
        names: of the sensors, for the words; None = "sensor 1", "sensor 2", …
        momentum: τ in nominal sample periods, 0 … 1e5. "auto" = find it, and take it where the rule of `estimate`
            takes it for the fused value as one signal, and the likelihood of all sensors is for it too.
        robust: whether spikes are set aside before the fit, as `estimate` does for each sensor: True, False, or
            "auto" where there are any. What most sensors show at once is not a spike.
        gains: whether the gains c_i are searched too; else they are 1.
        reference: the sensor, by its index or its name, whose offset is 0 and whose gain is 1; None = the offsets
            add up to 0, each with the sign of its gain, and the sizes of the gains multiply to 1: what all sensors
            share cannot be known.
        known_r: noise variances from data sheets, unit², shape (sensors,), NaN where not known.
        progress: called with the fraction done, 0 … 1, and what is being done; None = not reported.
        cancelled: whether to stop; None = never.

    Returns:
        A FusionEstimate; its `params` are None where the record gives none, and its `message` says why.

    Raises:
        BadSetting: z holds inf or has another shape; another argument does not fit it.
        Cancelled: `cancelled()` was true.

    Source: Durbin & Koopman (2012), sections 6.4 and 7.3; the model choice as in `estimation.momentum`.
    """
    asked = question(z, dt, names, reference, known_r)
    tau, always = checked_momentum(momentum, "ml"), checked_robust(robust)
    task = Progress(progress, cancelled)
    wrong = asked.unusable(gains)
    if wrong is not None:
        return refused(asked, *wrong)
    away = np.zeros(asked.z.shape, dtype=bool)
    if always is not False:
        singles = _singles(asked, momentum, robust, task.part(0.0, 0.3))
        many = [name for name, one in zip(asked.names, singles, strict=True) if one.verdict == "too_many_outliers"]
        if many:
            return refused(asked, "too_many_outliers", words.too_many(many[0]))
        away = spikes_of(singles, asked.z)
    found = conclude(asked, away, *_fitted(asked.without(away), gains, tau, task.part(0.3, 0.9)))
    task(1.0, "done")
    return found


def _singles(
    asked: Question, momentum: float | Literal["auto"], robust: bool | Literal["auto"], progress: Progress
) -> list[Estimate]:
    """The estimate of each sensor for itself."""
    dt, count = asked.steps if len(asked.steps) else None, len(asked.names)
    parts = [progress.part(i / count, (i + 1) / count) for i in range(count)]
    return [
        estimate(column, dt=dt, progress=part, cancelled=part.cancelled, momentum=momentum, robust=robust)
        for column, part in zip(asked.z.T, parts, strict=True)
    ]


def _fitted(
    asked: Question, gains: bool, tau: float | None, progress: Progress
) -> tuple[Asked, Found, Estimate | None]:
    """What was searched, the best fit, and what the fused value as one signal says of momentum."""
    data = Readings.of(asked.z, asked.steps)
    gained = np.flatnonzero(np.arange(data.sensors) != asked.gauge) if gains else np.empty(0, np.intp)
    unit = data.scale * data.scale
    floor = np.array([rounding_variance(column) / unit for column in asked.z.T])
    searched = Asked(asked.known / unit, np.where(np.isnan(asked.known), floor, 0.0), False, gained)
    tried = [np.ones(data.sensors)]
    if gains:
        tried.append(starting_gains(data, asked.z, gained, asked.gauge))
    starts = [place for c in tried for place in starting_places(data, asked.z, searched, c)]
    plain = best_fit(data, searched, starts, progress.part(0.0, 0.5))
    if tau == 0.0 or (tau is None and plain.place.q == 0.0):
        return searched, plain, None
    found, one = with_momentum(asked, data, searched, plain, tau, progress.part(0.5, 1.0))
    return searched, found, one
