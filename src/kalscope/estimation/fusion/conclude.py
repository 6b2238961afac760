"""From the top of the likelihood to a FusionEstimate: units, offsets, gains, intervals, verdict and words."""

from __future__ import annotations

import math

import numpy as np

from kalscope.common.array import Array, Mask
from kalscope.estimation.fusion import words
from kalscope.estimation.fusion.asked import Question
from kalscope.estimation.fusion.doubts import held_for, slow_sensors
from kalscope.estimation.fusion.result import FusionEstimate
from kalscope.estimation.fusion.search.climb import BESIDE
from kalscope.estimation.fusion.search.fit import Asked, Found
from kalscope.estimation.fusion.search.intervals import (
    NORMAL,
    covariance,
    momentum_interval,
    movement_interval,
    noise_interval,
)
from kalscope.estimation.fusion.search.likelihood import Place
from kalscope.estimation.fusion.shared import Shared, shared_noise
from kalscope.estimation.fusion.spikes import with_gate
from kalscope.estimation.result import Estimate
from kalscope.estimation.verdict.conclude import MIN_VARIANCE
from kalscope.estimation.verdict.words import BAD_UNIT, FLAT
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.filtering.steady_state import steady_state

LITTLE = 0.01
"""Share of the fused value below which a sensor adds almost nothing."""


def refused(asked: Question, verdict: str, message: str) -> FusionEstimate:
    """The estimate of a record that gives none."""
    sensors = len(asked.names)
    none, wide = np.zeros(sensors), np.tile([0.0, math.inf], (sensors, 1))
    return FusionEstimate(
        names=asked.names,
        q=0.0,
        momentum=0.0,
        r=none,
        offset=none,
        gain=np.ones(sensors),
        q_interval=np.array([0.0, math.inf]),
        r_interval=wide,
        offset_interval=np.tile([-math.inf, math.inf], (sensors, 1)),
        gain_interval=np.ones((sensors, 2)),
        loglik=0.0,
        spikes=tuple(np.empty(0, np.intp) for _ in asked.names),
        verdict=verdict,
        message=message,
        notes=(),
        params=None,
    )


def conclude(asked: Question, away: Mask, searched: Asked, found: Found, moving: Estimate | None) -> FusionEstimate:
    """The estimate of the best place.

    Args:
        asked: the record with all of its readings.
        away: the readings that were set aside, shape (n, sensors).
        searched: what was searched.
        found: the best fit.
        moving: what the fused value as one signal says of momentum; None where it was not asked.
    """
    data, place = found.coordinates.data, found.place
    unit = data.scale * data.scale
    gain, gain_interval, stretch = _gains(asked, found)
    offset, offset_interval = _offsets(asked, found)
    with np.errstate(over="ignore", under="ignore"):
        q, r = place.q * unit * stretch * stretch, place.r * unit
        q_interval = np.array(movement_interval(found, searched)) * unit * stretch * stretch
        r_interval = np.array([noise_interval(found, searched, i) for i in range(data.sensors)]) * unit
    if not all(MIN_VARIANCE < size <= MAX_VARIANCE for size in (q, *r) if size > 0.0):
        return refused(asked, "bad_unit", BAD_UNIT)
    used_q = q if q > 0.0 else float(q_interval[1])
    used_r = np.where(r > 0.0, r, r_interval[:, 1])
    if not (math.isfinite(used_q) and np.isfinite(used_r).all()):
        return refused(asked, "flat", FLAT)
    params = FilterParams(q=used_q, r=used_r, offset=offset, gain=gain, momentum=place.tau)
    params = with_gate(params, asked.z, asked.steps, away)
    shared = shared_noise(asked.without(away).z, asked.steps, found)
    verdict, message = _verdict(asked, params, place.q, r, shared)
    sensors = _sensor_notes(asked, away, params, r, searched.floor * unit)
    unsure = _unsure(asked, q, q_interval, r, r_interval)
    return FusionEstimate(
        names=asked.names,
        q=q,
        momentum=place.tau,
        r=r,
        offset=offset,
        gain=gain,
        q_interval=q_interval,
        r_interval=r_interval,
        offset_interval=offset_interval,
        gain_interval=gain_interval,
        loglik=place.loglik,
        spikes=tuple(np.flatnonzero(column) for column in away.T),
        verdict=verdict,
        message=message,
        notes=(*_model_notes(asked, away, found, moving), *unsure, *sensors),
        params=params,
        shared=shared,
    )


def _gains(asked: Question, found: Found) -> tuple[Array, Array, float]:
    """Gains, their intervals, and the factor that x is stretched by, so that without a reference they average 1."""
    gain, searched = found.place.c, found.coordinates.gained
    if not len(searched):
        return gain, np.stack([gain, gain], axis=1), 1.0
    sensors = len(gain)
    free = asked.reference is None
    stretch = float(np.exp(np.log(np.abs(gain)).mean())) if free else 1.0
    turned = np.eye(sensors) - (1.0 / sensors if free else 0.0)
    turned = turned[:, searched] / gain[searched]
    error = _errors(turned, covariance(found)[-len(searched) :, -len(searched) :])
    shown = gain / stretch
    with np.errstate(over="ignore"):
        return shown, np.sort(shown[:, None] * np.exp(np.outer(error, [-1.0, 1.0])), axis=1), stretch


def _offsets(asked: Question, found: Found) -> tuple[Array, Array]:
    """Offsets and their intervals; where the gains are not sure, what they would be with others counts too."""
    searched = found.coordinates.gained
    offset, turned = _without_common(asked, found, found.place)
    error = _errors(turned, found.place.spread * found.coordinates.data.scale**2)
    if len(searched):
        slopes = np.empty((len(offset), len(searched)))
        for j in range(len(searched)):
            at = found.top.at.copy()
            at[j - len(searched)] += BESIDE
            slopes[:, j] = (_without_common(asked, found, found.coordinates.place(at))[0] - offset) / BESIDE
        error = np.hypot(error, _errors(slopes, covariance(found)[-len(searched) :, -len(searched) :]))
    return offset, offset[:, None] + np.outer(error, [-1.0, 1.0])


def _without_common(asked: Question, found: Found, place: Place) -> tuple[Array, Array]:
    """The offsets of a place less what all sensors share, unit, and the matrix that takes it away."""
    data, gain = found.coordinates.data, place.c
    rule = np.sign(gain) if asked.reference is None else np.eye(data.sensors)[asked.reference]
    turned = np.eye(data.sensors) - np.outer(gain, rule) / (rule @ gain)
    return turned @ (place.offset * data.scale + data.centre), turned


def _errors(turned: Array, spread: Array) -> Array:
    """Half the 95 % intervals of `turned` times values of covariance `spread`; inf where one is not known."""
    lost = ~np.isfinite(np.diag(spread))
    known = np.where(lost | lost[:, None], 0.0, spread)
    variance = np.diag(turned @ known @ turned.T)
    unknown = (np.abs(turned[:, lost]) > 1e-12).any(axis=1)
    return np.where(unknown, math.inf, NORMAL * np.sqrt(np.maximum(variance, 0.0)))


def _verdict(asked: Question, params: FilterParams, q: float, r: Array, shared: Shared | None) -> tuple[str, str]:
    settled = steady_state(params.as_single)
    said = words.found(asked.names, params.shares.tolist(), settled.gain, settled.lag_samples)
    if shared is not None:
        who, known = [asked.names[i] for i in shared.sensors], not bool(np.isnan(asked.known).all())
        passes = len(who) == len(asked.names)
        return "shared_noise", f"{words.shared_noise(who, shared.correlation, passes, known)} {said}"
    if q == 0.0:
        return "no_movement", f"{words.no_movement(params.q)} {said}"
    if r.min() == 0.0:
        i = int(r.argmin())
        return "no_noise", f"{words.no_noise(asked.names[i], float(params.sensor_r[i]), len(r) == 1)} {said}"
    return "ok", said


def _model_notes(asked: Question, away: Mask, found: Found, moving: Estimate | None) -> list[str]:
    """What is said of all sensors together."""
    notes: list[str] = []
    if found.place.tau > 0.0 and not found.coordinates.keeps and (moving is None or moving.prediction_gain == 0.0):
        notes.append(words.given_momentum(found.place.tau))
    elif found.place.tau > 0.0 and moving is not None:
        span = momentum_interval(found)
        notes.append(words.momentum(found.place.tau, span, float(moving.prediction_gain)))
    if len(asked.names) == 1:
        return notes
    if asked.reference is None:
        notes.append(words.common(len(found.coordinates.gained) > 0, bool(found.place.c.min() < 0.0)))
    z = asked.without(away).z
    slow = slow_sensors(z, found)
    if slow:
        notes.append(words.slow([asked.names[i] for i in slow], len(asked.names)))
    return notes


def _unsure(asked: Question, q: float, q_interval: Array, r: Array, r_interval: Array) -> list[str]:
    """What is said of variances above 0 of which the record does not exclude that they are 0."""
    names = ["q"] if q > 0.0 and q_interval[0] == 0.0 else []
    lowest = zip(asked.names, r, r_interval[:, 0], strict=True)
    names += [f"the r of {name}" for name, size, low in lowest if size > 0.0 and low == 0.0]
    return [words.not_excluded(names)] if names else []


def _sensor_notes(asked: Question, away: Mask, params: FilterParams, r: Array, floor: Array) -> list[str]:
    """What is said of single sensors; `floor` is the variance of rounding of each, unit²."""
    notes: list[str] = []
    for i, (name, share) in enumerate(zip(asked.names, params.shares.tolist(), strict=True)):
        spikes, rows = int(away[:, i].sum()), held_for(asked.z[np.isfinite(asked.z[:, i]), i])
        if spikes:
            notes.append(words.set_aside(name, spikes, int(np.isfinite(asked.z[:, i]).sum())))
        if rows > 1 and len(asked.names) > 1:
            notes.append(words.held(name, rows))
        if share < LITTLE:
            notes.append(words.adds_nothing(name, share))
        if 0.0 < r[i] <= 1.0001 * floor[i]:
            notes.append(words.at_rounding(name, float(r[i])))
    if params.gate is not None:
        notes.append(words.gate(params.gate))
    return notes
