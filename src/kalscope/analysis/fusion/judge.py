"""`judge_fusion`: what fusing sensors brings, and which of them to look at."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from kalscope.analysis.fusion import agreement, errors, faults
from kalscope.analysis.fusion.result import Fault, FusionVerdict, SensorVerdict
from kalscope.analysis.fusion.words import Words
from kalscope.common.array import Array
from kalscope.common.text import number
from kalscope.errors import BadSetting
from kalscope.estimation.fusion.result import FusionEstimate
from kalscope.estimation.fusion.shared import Shared, shared_by_params
from kalscope.filtering.arrays import checked_readings, samples_of, steps_of
from kalscope.filtering.filter import fuse
from kalscope.filtering.params import FilterParams

FusionFit = Callable[[Array, Array | None], FilterParams]

MIN_SPIKES, MIN_SPIKE_SHARE = 3, 5e-4
"""Spikes that are worth reporting: at least this many, and at least this share of the readings of the sensor."""


def judge_fusion(
    z: ArrayLike,
    estimate: FusionEstimate | FilterParams,
    dt: ArrayLike | None = None,
    *,
    names: Sequence[str] | None = None,
    unit: str = "",
    sample_period: float | None = None,
    fit: FusionFit | None = None,
) -> FusionVerdict:
    """Judge a fused filter by the record that it is for.

    Args:
        z: readings, shape (n, sensors); NaN where a sensor has none.
        estimate: of `estimate_fusion`, or the parameters.
        dt: nominal sample periods before each row, shape (n,), ≥ 0; None = 1 each.
        names: of the sensors; None = those of the estimate, or "sensor 1", "sensor 2", …
        unit: of the quantity, for the sentences.
        sample_period: nominal sample period in s; with it stretches are given as times.
        fit: finds parameters from readings and steps. With it the second half is predicted by parameters that have
            not seen it; without it by those of `estimate`.

    Raises:
        BadSetting: z does not fit the parameters, or the estimate has none.
    """
    params = estimate.params if isinstance(estimate, FusionEstimate) else estimate
    if params is None:
        raise BadSetting("estimate must hold a filter (got one without params: its message says why)")
    if names is None:
        names = estimate.names if isinstance(estimate, FusionEstimate) else _numbered(params.sensors)
    if len(names) != params.sensors:
        raise BadSetting(f"names must be {params.sensors}, one per sensor (got {', '.join(names)})")
    readings = checked_readings(samples_of(z), params)
    steps = None if dt is None else steps_of(dt, len(readings))
    words = Words(tuple(names), unit, sample_period)
    error = errors.predicted_error(readings, steps, params, errors.started(readings))
    with np.errstate(over="ignore", invalid="ignore"):  # squares of huge readings
        stuck = [faults.stuck(readings, steps, params, i) for i in range(params.sensors)]
        alive = _without(readings, stuck)
        sensors = _sensors(readings, alive, stuck, steps, params, words, error)
        found = params if fit is None else _of_first_half(readings, steps, fit)
        seen = errors.held_out(readings, steps, found, np.isfinite(alive))
        shared = estimate.shared if isinstance(estimate, FusionEstimate) else _shared(alive, steps, params)
    alone = [one.error for one in sensors]
    best = int(np.argmin(alone))
    headline = words.headline(error, alone, best, sensors, seen, shared)
    said = [headline, *([words.held_out(seen, unseen=fit is not None)] if seen and params.sensors > 1 else [])]
    said += [words.shares(params.shares.tolist())] if params.sensors > 1 else []
    said += [sentence for one in sensors for sentence in one.sentences[: len(one.faults)]]
    return FusionVerdict(error, best, seen, sensors, headline, tuple(dict.fromkeys(said)), shared)


def _numbered(sensors: int) -> list[str]:
    return [f"sensor {i + 1}" for i in range(sensors)]


def _shared(z: Array, dt: Array | None, params: FilterParams) -> Shared | None:
    """The noise that sensors share, by the readings that the gate lets through."""
    kept = z if params.gate is None else np.where(fuse(z, params, dt).k == 0.0, np.nan, z)
    return shared_by_params(kept, np.empty(0) if dt is None else dt, params)


def _of_first_half(z: Array, dt: Array | None, fit: FusionFit) -> FilterParams:
    half = len(z) // 2
    return fit(z[:half], None if dt is None else dt[:half])


def _sensors(
    z: Array,
    alive: Array,
    stuck: Sequence[faults.Stretch],
    dt: Array | None,
    params: FilterParams,
    words: Words,
    error: float,
) -> tuple[SensorVerdict, ...]:
    noise, readings = np.sqrt(params.scaled_r).tolist(), np.isfinite(z).sum(axis=0).tolist()
    drifts, changes = _beside_the_others(alive, dt, params)
    spikes = faults.spikes(alive, dt, params)
    found: list[SensorVerdict] = []
    for i in range(params.sensors):
        one = replace(
            _alone_and_missing(z, dt, params, words.names[i], i),
            drift=agreement.of_both(drifts, i, params.sensors) or 0.0,
            noise_ratio=agreement.of_both(changes, i, params.sensors) or 1.0,
            spikes=spikes[i],
            stuck=stuck[i],
            silent=faults.silent(np.isfinite(z[:, i])),
        )
        one = replace(one, faults=_faults(one, readings[i]))
        pairs: dict[Fault, tuple[int, ...]] = {
            "drift": agreement.undecided(drifts, i, params.sensors),
            "noise": agreement.undecided(changes, i, params.sensors),
        }
        reading = float(z[one.stuck[0], i]) if one.stuck[1] else math.nan
        value = words.size(reading) if params.gain[i] == 1.0 else number(reading)  # else its unit may be another
        said = [words.fault(one, fault, noise[i], value, pairs.get(fault, ())) for fault in one.faults]
        found.append(replace(one, sentences=(*said, words.dropped(one, error), words.sticks(one, params.gate))))
    return tuple(found)


def _without(z: Array, stretches: Sequence[faults.Stretch]) -> Array:
    """The readings without one stretch of each sensor: those of a stuck one must not make the others look wrong."""
    if not any(last for _, last in stretches):
        return z
    left = z.copy()
    for column, stretch in zip(left.T, stretches, strict=True):
        column[slice(*stretch)] = np.nan
    return left


def _beside_the_others(
    z: Array, dt: Array | None, params: FilterParams
) -> tuple[dict[int, float], dict[int, float]]:
    """The sensors whose difference from the others moves, and those whose noise changes; and by how much."""

    @lru_cache
    def difference(sensor: int, others: tuple[int, ...]) -> agreement.Difference:
        return agreement.difference(z, dt, params, sensor, others)

    least = agreement.MIN_DRIFT * np.sqrt(params.scaled_r)
    drifts = agreement.odd_ones(
        params.sensors,
        lambda i, others: agreement.drift(difference(i, others)),
        lambda i, size: size > least[i],
    )
    changes = agreement.odd_ones(
        params.sensors,
        lambda i, others: agreement.noise_change(difference(i, others)),
        lambda _, ratio: ratio > agreement.MIN_NOISE_RATIO,
    )
    return drifts, changes


def _alone_and_missing(z: Array, dt: Array | None, params: FilterParams, name: str, sensor: int) -> SensorVerdict:
    """What the filter would be with this sensor only, and without it; no faults yet."""
    others, first = [j for j in range(params.sensors) if j != sensor], errors.started(z)
    shares = np.zeros(params.sensors)
    if others:
        shares[others] = params.only(others).shares
    return SensorVerdict(
        name=name,
        share=float(params.shares[sensor]),
        answered=float(np.isfinite(z[:, sensor]).mean()) if len(z) else 0.0,
        error=errors.predicted_error(z[:, [sensor]], dt, params.only([sensor]), first),
        error_without=errors.predicted_error(z[:, others], dt, params.only(others), first) if others else np.inf,
        shares_without=shares,
        pull=errors.pull(params, sensor),
        drift=0.0,
        noise_ratio=1.0,
        spikes=0,
        stuck=(0, 0),
        silent=(0, 0),
        faults=(),
        sentences=(),
    )


def _faults(one: SensorVerdict, readings: int) -> tuple[Fault, ...]:
    """What is wrong, worst first."""
    wrong: dict[Fault, bool] = {
        "silent": one.silent != (0, 0),
        "stuck": one.stuck != (0, 0),
        "drift": one.drift > 0.0,
        "noise": one.noise_ratio > 1.0,
        "spikes": one.spikes >= max(MIN_SPIKES, MIN_SPIKE_SHARE * readings),
    }
    return tuple(fault for fault, is_so in wrong.items() if is_so)
