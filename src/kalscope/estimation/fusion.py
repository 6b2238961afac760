"""`estimate_fusion`: q, momentum, and the noise, offset and gain of each of several sensors of one quantity."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.numbers import Array, Mask
from kalscope.common.progress import OnProgress, Progress
from kalscope.common.text import count, gate_text, number, percent, plural
from kalscope.errors import BadSetting
from kalscope.estimation import climb
from kalscope.estimation.climb import FitOptions, Place, Readings, SensorFit
from kalscope.estimation.fit import checked_momentum, estimate
from kalscope.estimation.momentum import MIN_GAIN, SHORT_RECORD
from kalscope.estimation.result import Estimate, Shared
from kalscope.estimation.spikes import advised_gate, checked_robust, rounding_variance
from kalscope.estimation.verdict import BAD_UNIT, FLAT, MIN_SAMPLES, MIN_VARIANCE, OTHER_UNIT
from kalscope.filtering.params import MAX_VARIANCE, FilterParams, refuse_infinite, samples_of, steps_of
from kalscope.filtering.steady import steady_state

# The arguments of `estimate_fusion`, checked once.


_MAX_SIZE = 1e140
"""Readings that vary by more, or by less than its inverse, have variances that do not fit a double."""
_MAX_FACTOR = 1e20
"""A known r this many times above or below what readings vary by, squared, has another unit."""
_SAME = 1e-12
"""Relative difference up to which two sensors are copies: that of rounding."""


@dataclass(frozen=True)
class SensorRecord:
    """A record of several sensors, and what is known of them."""

    z: Array
    """Readings, NaN where missing, shape (n, sensors)."""
    steps: Array
    """Nominal sample periods before each row; empty = 1 each."""
    names: tuple[str, ...]
    """The sensors."""
    reference: int | None
    """The sensor whose offset is 0 and whose gain is 1."""
    known: Array
    """Known r, unit², NaN where not known, shape (sensors,)."""

    @property
    def dt(self) -> Array | None:
        """The steps as the filters take them."""
        return self.steps if len(self.steps) else None

    @property
    def gauge(self) -> int:
        """The sensor whose offset and gain stay while the others are searched."""
        return 0 if self.reference is None else self.reference

    def without(self, outliers: Mask) -> SensorRecord:
        """The record without some readings, shape (n, sensors)."""
        return replace(self, z=np.where(outliers, np.nan, self.z)) if outliers.any() else self

    def unusable(self, gains: bool) -> tuple[str, str] | None:
        """Verdict and words where a sensor makes the fit meaningless; a copy may have another gain with `gains`."""
        for name, column in zip(self.names, self.z.T, strict=True):
            readings = column[np.isfinite(column)]
            if len(readings) < MIN_SAMPLES:
                return "too_few", (
                    f"{name} has too few readings ({count(len(readings))}): at least {MIN_SAMPLES} are needed to "
                    "find its noise. Record longer, or leave it out."
                )
            if np.all(readings == readings[0]):
                return "constant", (
                    f"All readings of {name} are equal, so it says nothing about the quantity: it may be dead, or "
                    "its steps are too coarse. Leave it out."
                )
            size = float(np.ptp(0.5 * readings))
            if not 1.0 / _MAX_SIZE < size < _MAX_SIZE:
                return "bad_unit", BAD_UNIT
            if np.any((self.known > _MAX_FACTOR * size * size) | (self.known < size * size / _MAX_FACTOR)):
                return "bad_unit", OTHER_UNIT
        for i, j in combinations(range(len(self.names)), 2):
            if _are_copies(self.z[:, i], self.z[:, j], gains):
                return "copies", (
                    f"{self.names[i]} and {self.names[j]} always move exactly alike: one is a copy of the other, "
                    "and a copy adds nothing. Leave one of them out."
                )
        return None


def checked_record(
    z: ArrayLike,
    dt: ArrayLike | None,
    names: Sequence[str] | None,
    reference: int | str | None,
    known_r: ArrayLike | None,
) -> SensorRecord:
    """Check what was given; BadSetting as in `estimate_fusion`."""
    readings = samples_of(z)
    readings = readings[:, None] if readings.ndim == 1 else readings
    if readings.ndim != 2 or readings.shape[1] == 0:
        raise BadSetting(f"z must have shape (n, sensors) (got {readings.shape})")
    n, sensors = readings.shape
    for column in readings.T:
        refuse_infinite(column)
    given = tuple(f"sensor {i + 1}" for i in range(sensors)) if names is None else tuple(map(str, names))
    if len(given) != sensors or len(set(given)) != sensors:
        raise BadSetting(f"names must be {sensors} different ones, one per sensor (got {', '.join(given)})")
    known = _known_noises(known_r, sensors)
    return SensorRecord(readings, steps_of(dt, n), given, _index(reference, given), known)


def _known_noises(value: ArrayLike | None, sensors: int) -> Array:
    """The known r of each sensor, NaN where it is not known."""
    try:
        known = np.array(
            np.broadcast_to(np.asarray(math.nan if value is None else value, dtype=np.float64), (sensors,))
        )
    except (TypeError, ValueError):
        raise BadSetting(f"known_r must be one number, or {sensors}, one each (got {value})") from None
    if np.any(~((known > 0.0) & (known <= MAX_VARIANCE)) & ~np.isnan(known)):
        raise BadSetting(f"known_r must be finite and above 0 (got {known.min():g} to {known.max():g})")
    return known


def _index(reference: int | str | None, names: tuple[str, ...]) -> int | None:
    if reference is None:
        return None
    places = {key: i for i, name in enumerate(names) for key in (i, name)}
    if isinstance(reference, bool) or reference not in places:
        last = len(names) - 1
        raise BadSetting(f"reference must be a sensor, its name or its index from 0 to {last} (got {reference!r})")
    return places[reference]


def _are_copies(first: Array, second: Array, gains: bool) -> bool:
    """Whether two sensors differ by the same value wherever both answer; with `gains` by a factor too."""
    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < MIN_SAMPLES:
        return False
    one, other = first[both], second[both]
    size = max(float(np.abs(one).max()), float(np.abs(other).max()))
    one, other = (one - one[0]) / size, (other - other[0]) / size
    squares = float(one @ one)
    factor = float(one @ other) / squares if gains and squares > 0.0 else 1.0
    return float(np.ptp(other - factor * one)) <= _SAME


# Whether the quantity keeps its direction: the rule of one signal on the fused value; the fit with momentum.


_EVEN = 0.1
"""Share of the mean r that is added to each for the weights; of the largest, the least where a search begins."""

_STILL = 1e-3
"""Share of the squared steps of the readings from which a movement is searched that no other fit shows."""


def fused_signal(z: Array, place: Place, data: Readings, weights: Array) -> Array:
    """The weighted mean of the sensors' values of the quantity, unit, shape (n,); NaN where none answers."""
    value = place.quantity(z, data)
    present = np.isfinite(z)
    total = present @ weights
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(total > 0.0, np.where(present, value, 0.0) @ weights / total, np.nan)


def with_momentum(
    record: SensorRecord, options: FitOptions, plain: SensorFit, tau: float | None, progress: Progress
) -> tuple[SensorFit, Estimate]:
    """The fit with momentum where it is given or the signal asks for it, and the fused signal's own estimate.

    Args:
        record: the record.
        options: what is searched.
        plain: the fit without momentum.
        tau: the momentum that is given; None = find it.
        progress: receives progress reports.
    """
    one, rows = _estimate_signal(record, plain, tau, progress.part(0.0, 0.5))
    start = one.momentum if tau is None else tau
    if not start:
        return plain, one
    place, data, fitted = plain.place, plain.coordinates.data, replace(options, keeps=tau is None)
    least = _STILL * float(climb.step_sizes(data).max()) / climb.step_variance(start)
    step = one.q / data.scale**2 or place.q or least
    # none of the r that are searched so small that the search begins at an edge
    lifted = np.where(np.isnan(options.known), np.maximum(place.r, _EVEN * place.r.max()), place.r)
    noises = [*climb.guessed_noises(record.z, data, options, place.c), lifted]
    starts = [climb.place_at(data.middle(), step, start, noise, place.c) for noise in noises]
    fit = climb.best_fit(data, fitted, starts, progress.part(0.5, 1.0))
    if tau is not None:
        return fit, one
    if fit.place.tau > data.span:  # the record cannot show how much longer than itself it is
        cut = climb.place_at(data, fit.place.q, data.span, fit.place.r, fit.place.c)
        fit = climb.climbed(data, options, cut)
    needed = MIN_GAIN + SHORT_RECORD / rows
    if 2.0 * (fit.place.loglik - place.loglik) <= needed:
        return plain, replace(one, momentum=0.0)
    return fit, one


def _estimate_signal(
    record: SensorRecord, plain: SensorFit, tau: float | None, progress: Progress
) -> tuple[Estimate, int]:
    """The estimate of the fused value as one signal, and of how many rows.

    Without momentum one r may come out as 0 although its sensor is no better, only quicker than the random walk
    expects. So the mean with even weights is tried where the weighted one shows no momentum.
    """
    place, data = plain.place, plain.coordinates.data
    r, even = place.r / place.c**2, np.ones(data.sensors)

    def one(weights: Array, part: Progress) -> tuple[Estimate, int]:
        signal = fused_signal(record.z, place, data, weights)
        momentum = "auto" if tau is None else tau
        single = estimate(signal, record.dt, part, part.cancelled, momentum, robust=False)
        return single, int(np.isfinite(signal).sum())

    weighted = one(1.0 / (r + _EVEN * r.mean()) if r.any() else even, progress.part(0.0, 0.5))
    return weighted if data.sensors == 1 or weighted[0].momentum else one(even, progress.part(0.5, 1.0))


# Noise that sensors have in common: whether the noises of two are correlated, or one noise is in all of them.


MIN_ROWS = 30
"""Least number of rows in which the sensors that are compared answer together."""
SURE = 10.83
"""Rise of twice the log-likelihood that one parameter brings by chance once in a thousand records."""
MIN_CORRELATION = 0.2
"""Least correlation of noises that is worth reporting."""
QUIET, EVEN = 0.01, 0.5
"""Start of the search: q as a share of that found, and the least r as a share of the largest."""
RATIOS, FACTORS = (0.03, 0.1, 0.3, 1.0), (1.8, 1.35, 1.15, 1.07)
"""β where its search begins, over the ratio of the steps of the two sensors; the factors by which it goes on."""
COMPARED = 6000
"""Readings in the middle of the record that are enough to find shared noise."""
LIGHT = 0.05
"""Least r of the other sensors for their weights, as a share of the largest."""
FINE = 0.01
"""Rise of the log-likelihood that matters here."""


def shared_by_params(z: Array, steps: Array, params: FilterParams) -> Shared | None:
    """As `shared_noise` of the best fit near a filter; None where a sensor has hardly a reading."""
    if np.isfinite(z).sum(axis=0).min(initial=len(z)) < MIN_ROWS:
        return None
    data = Readings.of(z, steps)
    unit = data.scale * data.scale
    start = climb.place_at(data, params.q / unit, params.momentum, params.sensor_r / unit, params.gain)
    options = FitOptions.of_all(data.sensors, params.momentum > 0.0)
    return shared_noise(z, steps, climb.climbed(data, options, start, FINE))


def shared_noise(z: Array, steps: Array, fit: SensorFit) -> Shared | None:
    """The noise that two sensors share, or all of them, whichever explains more; None where none shows.

    Args:
        z: readings, shape (n, sensors), NaN where missing.
        steps: nominal sample periods before each row; empty = 1 each.
        fit: the best fit with independent noises.
    """
    share = min(1.0, COMPARED / len(fit.coordinates.data.value))
    part = slice(int(0.5 * (1.0 - share) * len(z)), math.ceil(0.5 * (1.0 + share) * len(z)))
    z, steps, sensors = z[part], steps[part], z.shape[1]
    tried = [_shared_by_two(z, steps, fit, pair) for pair in combinations(range(sensors), 2)]
    tried += [_shared_by_all(z, steps, fit)] if sensors > 2 else []
    best = max((one for one in tried if one is not None), key=lambda one: one.rise, default=None)
    return best if best is not None and best.rise > SURE and best.correlation >= MIN_CORRELATION else None


def _shared_by_two(z: Array, steps: Array, fit: SensorFit, pair: tuple[int, ...]) -> Shared | None:
    """The noise that sensors i and j share.

    Reading j less β times reading i has a noise independent of that of i where β = ρ σ_j/σ_i. In place of reading
    j it makes all noises independent, so that the same likelihood serves. Readings j without one of i in their row
    are left out. The search starts from a slow signal, because shared noise may have been fitted as movement.
    """
    data, place = fit.coordinates.data, fit.place
    i, j = sorted(pair, key=lambda one: -float(place.r[one]))
    both = np.isfinite(z[:, [i, j]]).all(axis=1)
    moves = [float(np.mean(np.diff(z[both, one]) ** 2)) for one in (i, j)] if both.sum() >= MIN_ROWS else [0.0]
    if not min(moves) > 0.0:
        return None
    if data.sensors == 2 and (place.r.min() == 0.0 or place.q == 0.0):  # as where all share it
        return None
    weights = place.c**2 / np.maximum(place.r, LIGHT * place.r.max())
    weights[[i, j]] = 0.0
    columns, gain, r = [z[:, i], z[:, j]], place.c[[i, j]], place.r[[i, j]]
    if weights.any():  # the others, as one sensor
        columns.append(fused_signal(z, place, data, weights))
        gain, r = np.append(gain, 1.0), np.append(r, 1.0 / weights.sum())
    if not np.isfinite(columns[-1]).any():
        return None
    options = FitOptions.of_all(len(r), fit.keeps)

    def fitted(beta: float, q: float, noise: Array) -> Place:
        turned = np.stack([columns[0], columns[1] - beta * columns[0], *columns[2:]], axis=1)
        part = Readings.of(turned, steps, data.scale)
        gains = np.array([gain[0], gain[1] - beta * gain[0], *gain[2:]])
        return climb.climbed(part, options, climb.place_at(part, q, place.tau, noise, gains), FINE).place

    def correlated(beta: float) -> tuple[float, float, Place]:
        one = fitted(beta, QUIET * place.q, np.maximum(r, EVEN * r.max()))
        return one.loglik, beta, one

    alone = fitted(0.0, place.q, r).loglik
    best = max(correlated(one * math.sqrt(moves[1] / moves[0])) for one in RATIOS)
    for factor in FACTORS if best[0] > alone else ():
        best = max(best, correlated(best[1] / factor), correlated(best[1] * factor))
    explained = best[1] ** 2 * float(best[2].r[0])
    correlation = math.sqrt(explained / max(explained + float(best[2].r[1]), 1e-300))
    return Shared(tuple(sorted(pair)), correlation, 2.0 * (best[0] - alone))


def _shared_by_all(z: Array, steps: Array, fit: SensorFit) -> Shared | None:
    """The noise that all sensors share.

    Over the rows in which all sensors answer, the fused value is one signal of which the noise is known, 1/Σ c²/r.
    Where it shows more, that is common to all: it counts as movement.
    """
    data, place = fit.coordinates.data, fit.place
    rows = np.isfinite(z).all(axis=1)
    if rows.sum() < MIN_ROWS or place.r.min() == 0.0 or place.q == 0.0:
        return None
    signal = np.where(rows, fused_signal(z, place, data, place.c**2 / place.r), np.nan)
    one = Readings.of(signal[:, None], steps)
    expected = data.scale**2 / float(np.sum(place.c**2 / place.r)) / one.scale**2
    step = place.q * data.scale**2 / one.scale**2
    start = climb.place_at(one, step, place.tau, np.array([expected]), np.ones(1))
    options = FitOptions.of_all(1, False)
    fixed = climb.climbed(one, replace(options, known=np.array([expected])), start).place
    free = climb.climbed(one, options, fixed).place
    common = float(free.r[0] - expected) * one.scale**2 / data.scale**2
    least = np.sort(place.r / place.c**2)[:2]
    correlation = common / math.sqrt(float(np.prod(least + common))) if common > 0.0 else 0.0
    return Shared(tuple(range(data.sensors)), correlation, 2.0 * (free.loglik - fixed.loglik))


# From the top of the likelihood to an Estimate: units, offsets, gains, intervals, verdict and words.


def listed(names: Sequence[str]) -> str:
    """Names as a list in words: a, b and c."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def common_part(names: Sequence[str], correlation: float) -> str:
    """Which sensors share noise, and how much of it."""
    return f"{listed(names)} share noise (correlation {'up to ' if len(names) > 2 else ''}{number(correlation, 2)})"


def refused(record: SensorRecord, verdict: str, message: str) -> Estimate:
    """The estimate of a record that gives none."""
    sensors = len(record.names)
    none, wide = np.zeros(sensors), np.tile([0.0, math.inf], (sensors, 1))
    return Estimate(
        names=record.names, q=0.0, r=none, loglik=0.0, verdict=verdict, message=message, params=None,
        outliers=np.zeros(record.z.shape, bool), offset=none, gain=np.ones(sensors), q_interval=wide[0],
        r_interval=wide, offset_interval=wide - wide[:, ::-1], sensor_gain_interval=np.ones((sensors, 2)),
    )  # fmt: skip


def conclude(
    record: SensorRecord, outliers: Mask, options: FitOptions, fit: SensorFit, moving: Estimate | None
) -> Estimate:
    """The estimate of the best place.

    Args:
        record: the record with all of its readings.
        outliers: the readings that were set aside, shape (n, sensors).
        options: what was searched.
        fit: the best fit.
        moving: the estimate of the fused value as one signal; None where it was not needed.
    """
    data, place = fit.coordinates.data, fit.place
    unit = data.scale * data.scale
    gain, gain_interval, stretch = _gains(record, fit)
    offset, offset_interval = _offsets(record, fit)
    with np.errstate(over="ignore", under="ignore"):
        q, r = place.q * unit * stretch * stretch, place.r * unit
        q_interval = np.array(climb.movement_interval(fit, options)) * unit * stretch * stretch
        r_interval = np.array([climb.noise_interval(fit, options, i) for i in range(data.sensors)]) * unit
    if not all(MIN_VARIANCE < size <= MAX_VARIANCE for size in (q, *r) if size > 0.0):
        return refused(record, "bad_unit", BAD_UNIT)
    used_q = q if q > 0.0 else float(q_interval[1])
    used_r = np.where(r > 0.0, r, r_interval[:, 1])
    if not (math.isfinite(used_q) and np.isfinite(used_r).all()):
        return refused(record, "flat", FLAT)
    params = FilterParams(q=used_q, r=used_r, offset=offset, gain=gain, momentum=place.tau)
    gate = advised_gate(record.z, record.steps, params, outliers) if outliers.any() else None
    params = replace(params, gate=None if gate is None else gate * gate)
    kept = record.without(outliers).z
    shared = shared_noise(kept, record.steps, fit)
    verdict, message = _verdict(record, params, place.q, r, shared)
    notes = _model_notes(record, kept, fit, moving) + _sensor_notes(
        record, outliers, params, r, options.floor * unit
    )
    return Estimate(
        names=record.names, q=q, r=r, momentum=place.tau, loglik=place.loglik, verdict=verdict, message=message,
        params=params, offset=offset, gain=gain, q_interval=q_interval, r_interval=r_interval,
        offset_interval=offset_interval, sensor_gain_interval=gain_interval,
        momentum_interval=climb.momentum_interval(fit) if place.tau > 0.0 else (0.0, 0.0),
        prediction_gain=0.0 if moving is None else moving.prediction_gain,
        outliers=outliers, shared=shared, notes=tuple(notes),
    )  # fmt: skip


def _gains(record: SensorRecord, fit: SensorFit) -> tuple[Array, Array, float]:
    """Gains, their intervals, and the factor that x is stretched by, so that without a reference they average 1."""
    gain, searched = fit.place.c, fit.coordinates.gained
    if not len(searched):
        return gain, np.stack([gain, gain], axis=1), 1.0
    sensors = len(gain)
    free = record.reference is None
    stretch = float(np.exp(np.log(np.abs(gain)).mean())) if free else 1.0
    turned = np.eye(sensors) - (1.0 / sensors if free else 0.0)
    turned = turned[:, searched] / gain[searched]
    error = _errors(turned, fit.top.covariance[-len(searched) :, -len(searched) :])
    shown = gain / stretch
    with np.errstate(over="ignore"):
        return shown, np.sort(shown[:, None] * np.exp(np.outer(error, [-1.0, 1.0])), axis=1), stretch


def _offsets(record: SensorRecord, fit: SensorFit) -> tuple[Array, Array]:
    """Offsets and their intervals; where the gains are not sure, what they would be with others counts too."""
    searched = fit.coordinates.gained
    offset, turned = _without_common(record, fit.coordinates.data, fit.place)
    error = _errors(turned, fit.place.spread * fit.coordinates.data.scale**2)
    if len(searched):
        slopes = np.empty((len(offset), len(searched)))
        for j in range(len(searched)):
            at = fit.top.at.copy()
            at[j - len(searched)] += climb.BESIDE
            beside, _ = _without_common(record, fit.coordinates.data, fit.coordinates.place(at))
            slopes[:, j] = (beside - offset) / climb.BESIDE
        error = np.hypot(error, _errors(slopes, fit.top.covariance[-len(searched) :, -len(searched) :]))
    return offset, offset[:, None] + np.outer(error, [-1.0, 1.0])


def _without_common(record: SensorRecord, data: Readings, place: Place) -> tuple[Array, Array]:
    """The offsets of a place less what all sensors share, unit, and the matrix that takes it away."""
    gain = place.c
    rule = np.sign(gain) if record.reference is None else np.eye(data.sensors)[record.reference]
    turned = np.eye(data.sensors) - np.outer(gain, rule) / (rule @ gain)
    return turned @ (place.offset * data.scale + data.centre), turned


def _errors(turned: Array, spread: Array) -> Array:
    """Half the 95 % intervals of `turned` times values of covariance `spread`; inf where one is not known."""
    lost = ~np.isfinite(np.diag(spread))
    known = np.where(lost | lost[:, None], 0.0, spread)
    variance = np.diag(turned @ known @ turned.T)
    unknown = (np.abs(turned[:, lost]) > 1e-12).any(axis=1)
    return np.where(unknown, math.inf, climb.NORMAL * np.sqrt(np.maximum(variance, 0.0)))


def _verdict(
    record: SensorRecord, params: FilterParams, q: float, r: Array, shared: Shared | None
) -> tuple[str, str]:
    """The code, and what was found: first what is wrong, then the filter."""
    settled, names = steady_state(params.as_single), record.names
    parts = [f"{percent(share)} from {name}" for name, share in zip(names, params.shares.tolist(), strict=True)]
    verdict, wrong = "ok", ""
    if shared is not None:
        verdict, who = "shared_noise", [names[i] for i in shared.sensors]
        wrong = (
            f"{common_part(who, shared.correlation)}, such as interference or a common supply: it does not average "
            "out, so the error of the fused value can be larger than predicted. "
        )
        if len(who) == len(names):
            wrong += (
                "It passes as movement, because no sensor differs from the others by it: choose a longer lag to "
                "smooth it. "
            )
        else:
            wrong += "Leave one of them out, or remove what they share. "
        wrong += "" if np.isnan(record.known).all() else "Or an r that was given is too small. "
    elif q == 0.0:
        verdict = "no_movement"
        wrong = (
            "No movement can be identified: a constant plus noise explains this record best, so only the noise of "
            f"the sensors is known. q = {number(params.q)} is the largest that the record allows (95 %). Record "
            "while the quantity moves, or choose a lag. "
        )
    elif r.min() == 0.0:
        verdict, i = "no_noise", int(r.argmin())
        others = "" if len(names) == 1 else ", and what the others show beside it counts as their noise"
        wrong = (
            f"No noise can be identified in {names[i]}: every change of it looks like movement{others}. "
            f"r = {number(params.sensor_r[i])} is the largest that the record allows for it (95 %). Usual reasons: "
            "it smooths or rounds its output, or the sensors do not see the same quantity. Give its r from a still "
            "stretch or the data sheet. "
        )
    return verdict, (
        f"{wrong}The fused value takes {listed(parts)}. While all sensors answer it settles at gain "
        f"{number(settled.gain)}: it lags a ramp by {plural(settled.lag_samples, 'sample')}."
    )


def _model_notes(record: SensorRecord, z: Array, fit: SensorFit, moving: Estimate | None) -> list[str]:
    """What is to know of all sensors together; `z` are the readings without the spikes."""
    notes: list[str] = []
    tau, names = fit.place.tau, record.names
    if tau > 0.0 and not fit.keeps and (moving is None or moving.prediction_gain == 0.0):
        notes.append(f"The momentum of {plural(tau, 'sample')} was given.")
    elif tau > 0.0 and moving is not None:
        low, high = climb.momentum_interval(fit)
        span = f"{number(low)} to {number(high)}" if high < math.inf else f"{number(low)} or more"
        notes.append(
            f"The quantity keeps its direction for about {number(tau)} samples ({span}): with this momentum the "
            f"error of predicting unseen samples of the fused value is {percent(moving.prediction_gain)} smaller."
        )
    if len(names) > 1 and record.reference is None:
        signs = ", each with the sign of its gain," if fit.place.c.min() < 0.0 else ""
        also, product = "", ""
        if len(fit.coordinates.gained):
            also, product = " or gain", ", and the gains so that their sizes multiply to 1"
        notes.append(
            f"An offset{also} that all sensors share cannot be known: the offsets are given so that their "
            f"sum{signs} is 0{product}. Name a reference sensor where one of them is right."
        )
    slow = slow_sensors(z, fit)
    if slow:
        some = f"the fused value and {listed([names[i] for i in slow])}"
        notes.append(
            f"The difference between {'the sensors' if len(slow) == len(names) else some} changes slowly: an "
            "offset that drifts, or not quite the same quantity. It counts as noise, so trust neither the shares "
            "nor the intervals too far."
        )
    return notes


def _sensor_notes(record: SensorRecord, outliers: Mask, params: FilterParams, r: Array, floor: Array) -> list[str]:
    """What is to know of single sensors; `floor` is the variance of rounding of each, unit²."""
    notes: list[str] = []
    for i, name in enumerate(record.names):
        readings = record.z[np.isfinite(record.z[:, i]), i]
        spikes, rows = int(outliers[:, i].sum()), held_for(readings)
        if spikes:
            part = percent(spikes / len(readings))
            notes.append(f"{plural(spikes, 'spike')} of {name} ({part}) set aside before the fit.")
        if rows > 1 and len(record.names) > 1:
            notes.append(
                f"Each reading of {name} fills about {rows} rows, as where a logger repeats the last one of a slow "
                "sensor: it counts that often, and the sensor seems far better than it is. Leave the repeated "
                "cells empty."
            )
        if 0.0 < r[i] <= 1.0001 * floor[i]:
            size = f"r = {number(r[i])} is the variance of rounding, Δ²/12"
            notes.append(f"The noise of {name} is smaller than its steps: {size}.")
    if params.gate is not None:
        notes.append(f"The filter gets a gate of {gate_text(params.gate)}, which ignores such spikes.")
    return notes


# What the model of independent white noise does not describe: repeated readings, and slow disagreement.


SLOW = 0.2
"""Correlation of a sensor's difference with that of the row before, beyond which the difference counts as slow."""

EVENLY, MIN_CHANGE = 0.8, 2.0
"""Share of readings that are repeated equally often, and usual change between them over the least, where a logger
repeats the last reading of a slow sensor. One that rounds repeats itself too, but unevenly or in single steps."""


def held_for(readings: Array) -> int:
    """How many rows each new reading of a sensor stays, where a logger repeats it; else 1.

    Args:
        readings: of one sensor, finite, shape (m,).
    """
    changed = np.flatnonzero(np.diff(readings))
    rows = np.diff(changed)
    if len(rows) < MIN_ROWS:
        return 1
    usual, sizes = float(np.median(rows)), np.abs(np.diff(readings)[changed])
    near = np.abs(rows - usual) <= max(1.0, 0.1 * usual)  # the rows need not divide the period of the sensor
    evenly = float(np.mean(near & (rows > 1))) >= EVENLY
    return round(usual) if evenly and float(np.median(sizes)) > MIN_CHANGE * float(sizes.min()) else 1


def slow_sensors(z: Array, fit: SensorFit) -> list[int]:
    """The sensors that differ from the fused value by more than white noise: the difference stays for some rows."""
    data, place = fit.coordinates.data, fit.place
    rows = np.isfinite(z).all(axis=1)
    if data.sensors < 2 or rows.sum() < MIN_ROWS:
        return []
    exact = (place.r == 0.0).astype(np.float64)
    weights = exact if exact.any() else place.c**2 / place.r
    signal = np.where(rows, fused_signal(z, place, data, weights), np.nan)
    slow: list[int] = []
    apart = place.quantity(z, data) - signal[:, None]
    for i in range(data.sensors):
        level: Array = apart[:, i] - np.nanmean(apart[:, i])
        pairs = level[1:] * level[:-1]
        pairs = pairs[np.isfinite(pairs)]
        size = float(np.nanmean(level**2))
        certain = len(pairs) >= MIN_ROWS and size > 0.0
        if certain and float(pairs.mean()) / size > max(SLOW, 4.0 / math.sqrt(len(pairs))):
            slow.append(i)
    return slow


# `estimate_fusion`: q, momentum, and the noise and offset of each of several sensors of one quantity.


TOO_MANY = (
    "Over 20 % of the readings of {} are predicted neither by those before nor by those after them: too many for "
    "spikes. Check its wiring and its supply, leave it out, or switch the spike-proof fit off."
)


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
) -> Estimate:
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
        An Estimate; its `params` are None where the record gives none, and its `message` says why.

    Raises:
        BadSetting: z holds inf or has another shape; another argument does not fit it.
        Cancelled: `cancelled()` was true.

    Source: Durbin & Koopman (2012), sections 6.4 and 7.3; the model choice as in `estimation.momentum`.
    """
    record = checked_record(z, dt, names, reference, known_r)
    tau, always = checked_momentum(momentum), checked_robust(robust)
    task = Progress(progress, cancelled)
    wrong = record.unusable(gains)
    if wrong is not None:
        return refused(record, *wrong)
    outliers = np.zeros(record.z.shape, dtype=bool)
    for i, column in enumerate(record.z.T if always is not False else ()):
        part = task.part(0.3 * i / len(record.names), 0.3 * (i + 1) / len(record.names))
        one = estimate(column, record.dt, part, part.cancelled, momentum, robust)
        if one.verdict == "too_many_outliers":
            return refused(record, one.verdict, TOO_MANY.format(record.names[i]))
        outliers[:, i] = False if one.outliers is None else one.outliers
    if len(record.names) > 1:  # what most of the sensors see at once belongs to the quantity
        outliers &= 2 * outliers.sum(axis=1, keepdims=True) <= np.isfinite(record.z).sum(axis=1, keepdims=True)
    fitted = _fitted(record.without(outliers), gains, tau, task.part(0.3, 0.9))
    task(1.0, "done")
    return conclude(record, outliers, *fitted)


def _fitted(
    record: SensorRecord, gains: bool, tau: float | None, progress: Progress
) -> tuple[FitOptions, SensorFit, Estimate | None]:
    """What was searched, the best fit, and the estimate of the fused value as one signal."""
    data = Readings.of(record.z, record.steps)
    gained = np.flatnonzero(np.arange(data.sensors) != record.gauge) if gains else np.empty(0, np.intp)
    unit = data.scale * data.scale
    floor = np.array([rounding_variance(column) / unit for column in record.z.T])
    options = FitOptions(record.known / unit, np.where(np.isnan(record.known), floor, 0.0), False, gained)
    tried = [np.ones(data.sensors)]
    if gains:
        tried.append(climb.starting_gains(data, record.z, gained, record.gauge))
    starts = [place for c in tried for place in climb.starting_places(data, record.z, options, c)]
    plain = climb.best_fit(data, options, starts, progress.part(0.0, 0.5))
    if tau == 0.0 or (tau is None and plain.place.q == 0.0):
        return options, plain, None
    fit, one = with_momentum(record, options, plain, tau, progress.part(0.5, 1.0))
    return options, fit, one
