"""`estimate_fusion`: q, momentum, and the noise and offset of each of several sensors of one quantity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.progress import OnProgress, Progress
from kalscope.estimation.estimate import checked_momentum
from kalscope.estimation.fusion.asked import Question, question
from kalscope.estimation.fusion.conclude import conclude, refused
from kalscope.estimation.fusion.result import FusionEstimate
from kalscope.estimation.fusion.search.fit import Asked, best_fit
from kalscope.estimation.fusion.search.likelihood import Readings
from kalscope.estimation.fusion.search.starting import starting_gains, starting_places
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
        momentum: τ in nominal sample periods, 0 … 1e5; "auto" = find it, by the rule of `estimate`.
        robust: whether spikes of each sensor are set aside before the fit, as in `estimate`.
        gains: whether the gains c_i are searched too; else they are 1.
        reference: the sensor, by its index or its name, whose offset is 0 and whose gain is 1; None = the offsets
            add up to 0, and the sizes of the gains multiply to 1: what all sensors share cannot be known.
        known_r: noise variances from data sheets, unit², shape (sensors,), NaN where not known.
        progress: called with the fraction done, 0 … 1, and what is being done.
        cancelled: whether to stop.

    Returns:
        A FusionEstimate; its `params` are None where the record gives none, and its `message` says why.

    Raises:
        BadSetting: z holds inf or has another shape; another argument does not fit it.
        Cancelled: `cancelled()` was true.

    Source: Durbin & Koopman (2012), sections 6.4 and 7.3; the model choice as in `estimation.momentum`.
    """
    asked = question(z, dt, names, reference, known_r)
    checked_momentum(momentum, "ml")
    checked_robust(robust)
    wrong = asked.unusable()
    if wrong is not None:
        return refused(asked, *wrong)
    return _fitted(asked, gains, Progress(progress, cancelled))


def _fitted(asked: Question, gains: bool, progress: Progress) -> FusionEstimate:
    z = asked.z
    data = Readings.of(z, asked.steps)
    gained = np.flatnonzero(np.arange(data.sensors) != asked.gauge) if gains else np.empty(0, np.intp)
    unit = data.scale * data.scale
    floor = np.array([rounding_variance(column) / unit for column in z.T])
    searched = Asked(asked.known / unit, np.where(np.isnan(asked.known), floor, 0.0), False, gained)
    gains_to_try = [np.ones(data.sensors)]
    if gains:
        gains_to_try.append(starting_gains(data, z, gained, asked.gauge))
    starts = [place for c in gains_to_try for place in starting_places(data, z, searched, c)]
    found = best_fit(data, searched, starts, progress)
    return conclude(asked, data, searched, found)
