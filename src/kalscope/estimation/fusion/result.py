"""FusionEstimate: what several sensors of one quantity say about it and about each other."""

from __future__ import annotations

from dataclasses import dataclass

from kalscope.common.array import Array, Indices
from kalscope.estimation.fusion.shared import Shared
from kalscope.filtering.params import FilterParams


@dataclass(frozen=True, eq=False)
class FusionEstimate:
    """The fused filter found in a record, with 95 % intervals and words. No field is ever NaN."""

    names: tuple[str, ...]
    """The sensors, in the order of the columns."""
    q: float
    """Variance of the movement per nominal sample period, unit², ≥ 0."""
    momentum: float
    """Momentum τ, nominal sample periods; 0 = none."""
    r: Array
    """Variance of the noise of each sensor, unit², ≥ 0, shape (sensors,)."""
    offset: Array
    """Offset of each sensor, unit, shape (sensors,): that of the reference is 0; without one their sum is, each
    with the sign of its gain."""
    gain: Array
    """Gain of each sensor, shape (sensors,): 1 unless they were asked for."""
    q_interval: Array
    """The q that the record allows, unit², shape (2,); ends may be 0 and inf."""
    r_interval: Array
    """The r that the record allows, unit², shape (sensors, 2); both ends are r itself where it was given."""
    offset_interval: Array
    """The offsets that it allows, unit, shape (sensors, 2)."""
    gain_interval: Array
    """The gains that it allows, shape (sensors, 2)."""
    loglik: float
    """Log-likelihood as `fuse(z, params).loglik`, of the readings without the spikes; 0 where nothing is."""
    spikes: tuple[Indices, ...]
    """The readings of each sensor that were set aside, their rows."""
    verdict: str
    """"ok", "shared_noise" (the noises of two sensors, or of all, are correlated: the fused value can be worse than
    predicted), "no_noise" (the most likely r of one sensor is 0: it is taken for the signal), "no_movement"
    (q = 0), "too_few", "constant" (a sensor always reads the same), "copies" (two sensors always move exactly
    alike), "too_many_outliers" (over 20 % of the readings of a sensor set aside), "flat" (any ratio of movement
    and noise explains the record) or "bad_unit" (variances outside 1e-300 … 1e300, or a known r of another
    unit)."""
    message: str
    """What was found and what to do, for the user."""
    notes: tuple[str, ...]
    """What cannot be known, or should be checked; one sentence each."""
    params: FilterParams | None
    """The fused filter; None where there is none: the message says why."""
    shared: Shared | None = None
    """The sensors whose noises are correlated; None where none shows."""
