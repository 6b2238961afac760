"""Judge fused sensors by their record: what fusing brings, which sensor disagrees, and what follows if one fails.

A sensor disagrees where its difference from the others moves, or where its noise changes. In a row in which several
sensors answer, the quantity cancels out of the difference of one from the mean of the others, weighted by their
information: only white noise of known variance remains. Where sensors answer in different rows, the others are
smoothed, and take part in the difference with their error. The sensor that is furthest beyond chance is set
aside before the others are compared, because it is in their mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from kalscope.analysis.actions import SetGate
from kalscope.analysis.findings import STATUSES, Finding, Tone
from kalscope.analysis.judge import CLOSE, Judgement, Prediction, Stretch
from kalscope.analysis.residuals import SPIKE
from kalscope.common.numbers import Array, Mask
from kalscope.common.text import count, lag_text, number, percent, plural
from kalscope.errors import BadSetting
from kalscope.estimation.fusion import common_part, listed, shared_by_params
from kalscope.estimation.result import Estimate, Shared
from kalscope.filtering.filter import FilterResult, SmootherResult, fuse, smooth
from kalscope.filtering.params import FilterParams, checked_readings, samples_of, steps_of
from kalscope.filtering.steady import steady_state

FusionFit = Callable[[Array, Array | None], FilterParams]

WORDS: dict[str, tuple[str, Tone, str]] = {**STATUSES, "spikes": ("has spikes", "note", "")}
"""The word, and its tone, of each status of fused sensors; the fused value can be right beside one with spikes."""

MAX_NAME = 20
"""Characters of a sensor's name in the word of a judgement."""

MIN_SHARE = 1e-9
"""A smaller share counts as none, as that beside a sensor without noise."""

MIN_SPIKES, MIN_SPIKE_SHARE = 3, 5e-4
"""Spikes that are worth reporting: at least this many, and at least this share of the readings of the sensor."""

MAD = 1.4826
"""Standard deviation of normal numbers over the median of their size."""

FAR_OFF, CONFIRMED = 6.0, 3.0
"""Size of a residual, in its own standard deviations, from which it is far off; and from which that of another
sensor in the same row confirms it: then the quantity has moved."""

MIN_STRETCH, MUCH_LONGER = 30, 20.0
"""Least length in readings, and in multiples of the usual length, of a suspicious stretch of equal or missing
ones."""

USUALLY_NEW = 2.0
"""Readings per value up to which a sensor usually gives new values."""

CERTAIN, BLOCKS = 2.0, 16
"""Standard errors of a mean beyond which it is not chance, and the blocks from whose scatter they come."""

SETTLED_AFTER = 0.1
"""Share of the rows that the start may take."""

BEYOND_CHANCE = 5.0
"""Standard errors above which a difference is not chance: many blocks of many sensors are compared."""

MIN_DRIFT = 0.5
"""Smallest drift that is worth reporting, in standard deviations of the sensor's noise."""

MIN_NOISE_RATIO = 2.0
"""Smallest change of a noise variance that is worth reporting."""

MAX_BLOCKS, MIN_BLOCK, MIN_NOISE_BLOCK = 16, 30, 100
"""Blocks of a record, and the readings that the mean and the variance of one need."""

MIN_VARIANCE = 1e-300
"""Smallest variance used as a divisor."""

MAX_SIZE = 4.0
"""Differences are clipped at this many standard deviations: spikes are not drift."""

MAX_FAINTER = 4.0
"""A row far from readings of the others, where their error variance is over this many times the least, is not
compared."""

SMALLER, MEAN_OF_SMALLER = 0.9, 0.6573
"""Share of the steps whose size is averaged, and that average for a standard normal distribution."""


def judge_fusion(
    z: ArrayLike,
    estimate: Estimate | FilterParams,
    dt: ArrayLike | None = None,
    *,
    names: Sequence[str] | None = None,
    unit: str = "",
    sample_period: float | None = None,
    fit: FusionFit | None = None,
) -> Judgement:
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
    fit_result = None if isinstance(estimate, FilterParams) else estimate
    params = estimate if isinstance(estimate, FilterParams) else estimate.params
    if params is None:
        raise BadSetting("estimate must hold a filter (got one without params: its message says why)")
    if names is None:
        names = [f"sensor {i + 1}" for i in range(params.sensors)] if fit_result is None else fit_result.names
    if len(names) != params.sensors:
        raise BadSetting(f"names must be {params.sensors}, one per sensor (got {', '.join(names)})")
    readings = checked_readings(samples_of(z), params)
    steps = None if dt is None else steps_of(dt, len(readings))
    record = _Record(readings, steps, params, tuple(names), unit, sample_period)
    with np.errstate(over="ignore", invalid="ignore"):  # squares of huge readings
        return _judged(record, fit_result, fit)


def _judged(record: _Record, fit_result: Estimate | None, fit: FusionFit | None) -> Judgement:
    params, half = record.params, len(record.z) // 2
    stuck = [_stuck_stretch(record, i) for i in range(params.sensors)]
    alive = record.without(stuck)
    sensors = _sensors(record, alive, stuck)
    tested = params if fit is None else fit(record.z[:half], None if record.dt is None else record.dt[:half])
    seen = _predict_second_half(replace(record, params=tested), np.isfinite(alive.z))
    shared = _shared_noise(alive) if fit_result is None else fit_result.shared
    error, several = record.predicted_error(range(params.sensors)), len(sensors) > 1
    odd = [one for one in sensors if one.findings]
    status = odd[0].status if odd else "shared_noise" if shared else "fused"
    word, tone, _ = WORDS[status]
    if odd:
        word = f"check {len(odd)} sensors" if len(odd) > 1 else f"{odd[0].name[:MAX_NAME]} {word}"
        tone = "bad" if "bad" in (WORDS[fault][1] for one in odd for fault in one.faults) else "note"
    return Judgement(
        status=status if odd or shared else "fits",
        headline=_headline(record, error, sensors, seen, shared),
        word=word,
        tone=tone,
        findings=tuple(dict.fromkeys(fault for one in sensors for fault in one.findings)),
        second_half=_second_half(record, seen, unseen=fit is not None) if seen and several else "",
        error=error,
        best=int(np.argmin([one.error for one in sensors])),
        prediction=seen,
        shares=f"While all answer, the fused value is {record.parts(params.shares)}." if several else "",
        sensors=sensors,
        shared=shared,
    )


@dataclass(frozen=True)
class _Record:
    """Readings with their filter, and the names and units for sentences on them."""

    z: Array
    """Readings, shape (n, sensors)."""
    dt: Array | None
    """Steps before the rows; None = 1 each."""
    params: FilterParams
    """The filter."""
    names: tuple[str, ...]
    """The sensors."""
    unit: str
    """The unit of the quantity; "" where unknown."""
    period: float | None
    """Sample period, s; None where unknown."""

    def run(self, sensors: Sequence[int]) -> FilterResult:
        """The fusion of these sensors only, with the parameters of all of them."""
        return fuse(self.z[:, list(sensors)], self.params.only(sensors), self.dt)

    def smoothed(self, sensors: Sequence[int]) -> SmootherResult:
        """The same from both sides."""
        return smooth(self.z[:, list(sensors)], self.params.only(sensors), self.dt)

    def others(self, sensor: int) -> list[int]:
        """All sensors but one."""
        return [i for i in range(self.params.sensors) if i != sensor]

    def without(self, stretches: Sequence[Stretch]) -> _Record:
        """The record without one stretch of each sensor: a stuck one must not make the others look wrong."""
        z = self.z.copy()
        for column, stretch in zip(z.T, stretches, strict=True):
            column[slice(*stretch)] = np.nan
        return replace(self, z=z)

    def predicted_error(self, sensors: Sequence[int]) -> float:
        """√ of the mean variance that the model gives to x by these sensors; inf without a reading.

        It starts where the start of the filter is over, and every sensor that ever answers has begun.
        """
        if not len(sensors):
            return math.inf
        begins = int(np.isfinite(self.z).argmax(axis=0).max()) if len(self.z) else 0
        p = self.run(sensors).p[max(int(SETTLED_AFTER * len(self.z)), begins) :]
        p = p[np.isfinite(p)]
        return math.sqrt(float(p.mean())) if len(p) else math.inf

    def size(self, value: float) -> str:
        """A size with its unit."""
        return f"{number(value)} {self.unit}".rstrip()

    def parts(self, shares: Array) -> str:
        """Shares as a list: 60 % a, 30 % b and 10 % c."""
        pairs = zip(self.names, shares.tolist(), strict=True)
        return listed([f"{percent(one, 3 if one > 0.985 else 2)} {name}" for name, one in pairs if one > MIN_SHARE])

    def when(self, stretch: Stretch) -> str:
        """How long a stretch is, and which rows."""
        first, last = stretch
        long = lag_text(last - first, self.period) if self.period else f"{count(last - first)} rows"
        return f" for {long} (rows {count(first)} to {count(last - 1)})"


def _headline(
    record: _Record, error: float, sensors: Sequence[Judgement], seen: Prediction | None, shared: Shared | None
) -> str:
    """What fusing brings; no comparison by predicted errors where the record contradicts them."""
    if math.isinf(error):
        return "No sensor has a reading after the start, so nothing can be said."
    if len(sensors) == 1:
        return f"The filtered value of {record.names[0]} has an error of {record.size(error)} (1 σ, predicted)."
    drift = max(one.drift for one in sensors)
    against = [f"{one.name} is stuck, so it can be larger" for one in sensors if "stuck" in one.faults]
    if seen is not None and seen.saved < 0.0:
        alone = f"{record.names[seen.best]} alone"
        against.insert(
            0, f"The next reading is predicted {percent(-seen.saved)} worse than by {alone}, so it is larger"
        )
    if shared is not None:
        who = common_part([record.names[i] for i in shared.sensors], shared.correlation)
        against.insert(0, f"{who}, so it can be larger")
    if drift > error:
        against.insert(0, f"The sensors drift apart by up to {record.size(drift)}, so it may be as large")
    fused = f"The fused value has an error of {record.size(error)} (1 σ, predicted)"
    if against:
        return f"{fused}. {against[0]}."
    best = min(sensors, key=lambda one: one.error)
    saved = 1.0 - error / best.error if best.error > 0.0 else 0.0
    than = "the same as" if saved < CLOSE else f"{percent(saved)} less than"
    return f"{fused}, {than} the best single sensor, {best.name} ({record.size(best.error)})."


def _second_half(record: _Record, seen: Prediction, *, unseen: bool) -> str:
    """How well the second half is predicted; `unseen`: by parameters that the first half alone gave."""
    best, less = f"{record.names[seen.best]} alone", seen.saved
    half = (
        f"In the second half{', unseen by the fit,' if unseen else ''} the next reading is predicted to "
        f"{record.size(seen.fused)}, its own noise included"
    )
    if not less:
        return f"{half}: as well as by {best}, within chance."
    return f"{half}: {percent(abs(less))} {'better' if less > 0.0 else 'worse'} than by {best}."


def _predict_second_half(record: _Record, counted: Mask) -> Prediction | None:
    """Predict every reading of the second half from the rows before it, by all sensors and by each alone.

    Args:
        record: the readings and the filter.
        counted: the readings that count, which those of a stuck sensor do not, shape (n, sensors).
    """
    first, params = max(len(record.z) // 2, 1), record.params

    def squared_errors(sensors: Sequence[int]) -> Array:
        run = record.run(sensors)
        ahead = run.x[first - 1 : -1]
        if run.velocity is not None:
            steps = 1.0 if record.dt is None else record.dt[first:]
            ahead = ahead - params.momentum * np.expm1(-steps / params.momentum) * run.velocity[first - 1 : -1]
        return ((record.z[first:] - params.offset) / params.gain - ahead[:, None]) ** 2

    every = range(params.sensors)
    squared = [squared_errors(sensors) for sensors in (every, *([i] for i in every))]
    scored = np.isfinite(sum(squared)) & counted[len(record.z) - len(squared[0]) :]
    if np.count_nonzero(scored.sum(axis=1)) < 2 * BLOCKS:
        return None
    weights = np.where(scored, params.shares, 0.0)
    fused, *single = (np.where(scored, one, 0.0) for one in squared)
    means = np.array([float((weights * one).sum() / weights.sum()) for one in (fused, *single)])
    best = int(np.argmin(means[1:]))
    gain = weights * (single[best] - fused)
    blocks = np.array([block.sum(axis=1).mean() for block in np.array_split(gain, BLOCKS)])
    errors = np.sqrt(means)
    saved = 1.0 - float(errors[0] / errors[1 + best]) if errors[1 + best] > 0.0 else 0.0
    is_certain = abs(float(blocks.mean())) > CERTAIN * float(blocks.std(ddof=1)) / math.sqrt(BLOCKS)
    return Prediction(float(errors[0]), errors[1:], best, saved if is_certain and abs(saved) >= CLOSE else 0.0)


def _shared_noise(alive: _Record) -> Shared | None:
    """The noise that sensors share, by the readings that the gate lets through."""
    z, dt, params = alive.z, alive.dt, alive.params
    kept = z if params.gate is None else np.where(fuse(z, params, dt).k == 0.0, np.nan, z)
    return shared_by_params(kept, np.empty(0) if dt is None else dt, params)


# --- each sensor ----------------------------------------------------------------------------------------------


def _sensors(record: _Record, alive: _Record, stuck: Sequence[Stretch]) -> tuple[Judgement, ...]:
    """Each sensor: its part in the fusion, its faults, and what follows if it fails."""
    params, z = record.params, record.z

    @lru_cache
    def apart(sensor: int, others: tuple[int, ...]) -> _Difference:
        return _difference(alive, sensor, others)

    drifts = _odd_ones(lambda i, others: _drift(apart(i, others)), MIN_DRIFT * np.sqrt(params.scaled_r))
    least = np.full(params.sensors, MIN_NOISE_RATIO)
    changes = _odd_ones(lambda i, others: _noise_change(apart(i, others)), least)
    spikes, error = _spikes(alive), record.predicted_error(range(params.sensors))

    def judged(i: int) -> Judgement:
        others, shares = record.others(i), np.zeros(params.sensors)
        if others:
            shares[others] = params.only(others).shares
        one = Judgement(
            status="fits",
            headline=f"No fault of {record.names[i]} shows.",
            word="fits",
            tone="good",
            name=record.names[i],
            share=float(params.shares[i]),
            answered=float(np.isfinite(z[:, i]).mean()) if len(z) else 0.0,
            error=record.predicted_error([i]),
            error_without=record.predicted_error(others),
            shares_without=shares,
            drift=drifts.get(i, (0.0, ()))[0],
            noise_ratio=changes.get(i, (1.0, ()))[0],
            spikes=spikes[i],
            stuck=stuck[i],
            silent=_silent_stretch(np.isfinite(z[:, i])),
        )
        pairs = [" and ".join(record.names[j] for j in odd.get(i, (0.0, ()))[1]) for odd in (drifts, changes)]
        compared = tuple(_faults(record, i, one, *pairs))
        one = replace(one, findings=compared, if_it_fails=_failing(record, one, error))
        if not compared:
            return one
        status, text = compared[0].status, compared[0].text
        return replace(one, status=status, headline=text, word=WORDS[status][0], tone=WORDS[status][1])

    return tuple(map(judged, range(params.sensors)))


def _faults(record: _Record, sensor: int, one: Judgement, drifting: str, changing: str) -> Iterator[Finding]:
    """What is wrong with a sensor, worst first; `drifting`, `changing`: two that no third tells apart, or ""."""
    name, params = one.name, record.params
    if one.silent != (0, 0):
        yield Finding("silent", f"{name} has no reading{record.when(one.silent)}.")
    if one.stuck != (0, 0):
        reading = float(record.z[one.stuck[0], sensor])
        at = record.size(reading) if params.gain[sensor] == 1.0 else number(reading)  # its unit may be another
        yield Finding("stuck", f"{name} is stuck at {at}{record.when(one.stuck)}: leave it out there.")
    by = f"{record.size(one.drift)} within the record"
    if drifting:
        yield Finding("drift", f"{drifting} drift apart by {by}; two sensors cannot show which of them drifts.")
    elif one.drift:
        noise = record.size(math.sqrt(params.scaled_r[sensor]))
        yield Finding("drift", f"{name} drifts against the others by {by} (σ of its noise: {noise}).")
    if one.noise_ratio > 1.0:
        why = "; two sensors cannot show which of them it is" if changing else ": one r cannot fit all of it"
        times = f"{number(one.noise_ratio, 2)} × within the record"
        yield Finding("noise", f"The noise variance of {changing or name} changes {times}{why}.")
    if one.spikes >= max(MIN_SPIKES, MIN_SPIKE_SHARE * np.isfinite(record.z[:, sensor]).sum()):
        seen = f"{name} has {plural(one.spikes, 'spike')} that no other sensor confirms"
        if params.gate is not None and params.gate <= FAR_OFF**2:
            yield Finding("spikes", f"{seen}: the outlier gate rejects them.")
        else:
            yield Finding("spikes", f"{seen}: set an outlier gate.", SetGate(SPIKE))


def _failing(record: _Record, one: Judgement, error: float) -> tuple[str, str]:
    """What happens when a sensor drops out, and when it sticks, which no filter can see in a single reading."""
    name, without, share = one.name, one.error_without, one.share
    if math.isinf(without):
        return f"Without {name} no reading is left.", f"If {name} sticks at one value, the filter follows it."
    more = without / error - 1.0 if error > 0.0 else 0.0
    change = "as large as with it" if more < CLOSE else f"{percent(more)} more than with it"
    far = "" if record.params.gate is None else "up to "
    far += percent(share if share > MIN_SHARE else 0.0)
    return (
        f"If {name} drops out, the error is {record.size(without)}, {change}; "
        f"the fused value is then {record.parts(one.shares_without)}.",
        f"If {name} sticks at one value, the fused value goes {far} of the way to it; leave it out then.",
    )


# --- a sensor by itself ---------------------------------------------------------------------------------------


def _spikes(record: _Record) -> list[int]:
    """Readings of each sensor that are far off by its single filter, and that no other sensor confirms."""
    sizes = np.zeros(record.z.shape)
    for i in range(record.params.sensors):
        run = record.run([i])
        with np.errstate(invalid="ignore"):
            size = np.abs(run.innovation[:, 0]) / np.sqrt(run.s[:, 0])
        scored = np.isfinite(size)
        usual = MAD * float(np.median(size[scored])) if scored.any() else 0.0
        sizes[:, i] = np.where(scored, size, 0.0) / max(usual, 1.0)
    far, confirming = sizes > FAR_OFF, sizes > CONFIRMED
    alone = far & (confirming.sum(axis=1, keepdims=True) == 1)
    alone[1:] &= ~far[:-1]  # the reading after a spike is far from where the filter went
    return alone.sum(axis=0).tolist()


def _stuck_stretch(record: _Record, sensor: int) -> Stretch:
    """The longest stretch of equal readings, where it is far longer than the others of this sensor.

    A sensor that repeats its readings anyway, because it rounds, is stuck only if the others moved at that time.
    """
    rows = np.flatnonzero(np.isfinite(record.z[:, sensor]))
    if not len(rows):
        return 0, 0
    values = record.z[rows, sensor]
    starts = np.append(0, np.flatnonzero(np.diff(values)) + 1)
    first, length = _longest(starts, len(values))
    if not length:
        return 0, 0
    stretch = int(rows[first]), int(rows[first + length - 1]) + 1
    repeats = len(values) > USUALLY_NEW * len(starts)
    return (0, 0) if repeats and not _others_moved(record, sensor, stretch) else stretch


def _others_moved(record: _Record, sensor: int, stretch: Stretch) -> bool:
    """Whether the others show movement of the quantity in this stretch far beyond the noise of this sensor."""
    others = record.others(sensor)
    if not others:
        return False
    smoothed = record.smoothed(others).x[slice(*stretch)]
    spread = np.nanmax(smoothed) - np.nanmin(smoothed) if np.isfinite(smoothed).any() else 0.0
    return bool(spread > FAR_OFF * np.sqrt(record.params.scaled_r[sensor]))


def _silent_stretch(answered: Mask) -> Stretch:
    """The longest stretch of rows without a reading where it is far longer than the others of this sensor."""
    rows = np.flatnonzero(answered)
    if not len(rows):
        return 0, len(answered)
    first, length = _longest(np.append(0, rows), len(answered))  # a reading and the silence after it
    start = first + int(answered[first])
    return (start, first + length) if length else (0, 0)


def _longest(starts: Array, end: int) -> Stretch:
    """First place and length of the longest stretch, length 0 where it is as long as the others."""
    lengths = np.diff(np.append(starts, end))
    worst = int(lengths.argmax())
    length, others = int(lengths[worst]), np.delete(lengths, worst)
    usual = float(others.mean()) if len(others) else 1.0
    return (int(starts[worst]), length) if length >= max(MIN_STRETCH, MUCH_LONGER * usual) else (0, 0)


# --- a sensor beside the others -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Difference:
    """One sensor less the others, on the scale of x, where both answer."""

    d: Array
    """Its values, shape (m,)."""
    variance: Array
    """Variance of what is new in each value."""
    others: float
    """Variance of the error of the others that lasts for some values, 0 where it is new in each row too."""
    lasting: float
    """For how many values that error lasts."""

    @property
    def scaled(self) -> Array:
        """The values divided by the standard deviations that the model gives to what is new in them."""
        return self.d / np.sqrt(np.maximum(self.variance, MIN_VARIANCE))


def _difference(record: _Record, sensor: int, others: Sequence[int]) -> _Difference:
    """Sensor less others."""
    params = record.params
    y = (record.z - params.offset) / params.gain
    one, rest = y[:, sensor], y[:, list(others)]
    information = np.where(np.isfinite(rest), params.information[list(others)], 0.0)
    total, r = information.sum(axis=1), float(params.scaled_r[sensor])
    answered = np.isfinite(one)
    both = answered & (total > 0.0)
    if 2 * both.sum() >= answered.sum():
        mean = (information * np.where(np.isfinite(rest), rest, 0.0)).sum(axis=1)[both] / total[both]
        return _Difference(one[both] - mean, r + 1.0 / total[both], 0.0, 1.0)
    smoothed = record.smoothed(others)
    error = np.where(answered & np.isfinite(smoothed.p), smoothed.p, math.inf)
    known = np.isfinite(error) & (error <= MAX_FAINTER * error.min(initial=math.inf))
    per_row = known.sum() / max(len(y), 1)
    lasting = 1.0 + 2.0 * steady_state(params.only(others).as_single).lag_samples * per_row
    others_p = float(smoothed.p[known].mean()) if known.any() else 0.0
    return _Difference((one - smoothed.x)[known], np.full(int(known.sum()), r), others_p, lasting)


def _drift(one: _Difference) -> tuple[float, float]:
    """By how much the difference moves, and how far beyond chance its blocks scatter, in standard deviations."""
    blocks = min(MAX_BLOCKS, len(one.d) // MIN_BLOCK)
    if blocks < 2:
        return 0.0, 0.0
    variance = one.variance * max(1.0, _noise(one.scaled))  # observed noise, where it exceeds that of the model
    low, high = np.quantile(one.d, (0.1, 0.9))  # a drift is not clipped
    reach = MAX_SIZE * np.sqrt(variance + one.others) + float(high - low)
    d = np.clip(one.d - np.median(one.d), -reach, reach)
    means = np.array([block.mean() for block in np.array_split(d, blocks)])
    size = len(d) / blocks
    noise = np.array([block.mean() for block in np.array_split(variance, blocks)]) / size
    of_mean = np.maximum(noise + one.others * min(1.0, one.lasting / size), MIN_VARIANCE)
    centre = float((means / of_mean).sum() / (1.0 / of_mean).sum())
    chi2, degrees = float(((means - centre) ** 2 / of_mean).sum()), blocks - 1
    width = 2.0 / (9.0 * degrees)  # χ² as a standard normal variate (Wilson & Hilferty 1931)
    return float(np.ptp(means)), (math.cbrt(chi2 / degrees) - 1.0 + width) / math.sqrt(width)


def _noise_change(one: _Difference) -> tuple[float, float]:
    """The largest over the smallest variance of the noise of blocks, and the standard errors of its logarithm."""
    blocks = min(MAX_BLOCKS // 2, len(one.d) // MIN_NOISE_BLOCK)
    if blocks < 2:
        return 1.0, 0.0
    variances = [_noise(block) for block in np.array_split(one.scaled, blocks)]
    if min(variances) <= 0.0:  # as coarse as its steps
        return 1.0, 0.0
    ratio = max(variances) / min(variances)
    return ratio, math.log(ratio) / (
        3.0 * math.sqrt(2.0 * blocks / len(one.d))
    )  # 3/√m: more than normal steps have


def _odd_ones(
    compare: Callable[[int, tuple[int, ...]], tuple[float, float]], least: Array
) -> dict[int, tuple[float, tuple[int, ...]]]:
    """The sensors that differ from the others by more than chance, worst first.

    Args:
        compare: size and standard errors of the difference of a sensor from others.
        least: the size of each sensor that is worth reporting.

    Returns:
        How much each differs; and the two sensors of a pair that no third one tells apart, else ().
    """
    odd: dict[int, tuple[float, tuple[int, ...]]] = {}
    remaining = list(range(len(least)))
    while len(remaining) > 1:
        compared = {i: compare(i, tuple(j for j in remaining if j != i)) for i in remaining}
        beyond = {i: one for i, one in compared.items() if one[1] > BEYOND_CHANCE and one[0] > least[i]}
        if not beyond:
            break
        if len(remaining) == 2:  # which of the two is odd cannot be known
            size = max(compared[i][0] for i in remaining)
            return odd | dict.fromkeys(remaining, (size, tuple(remaining)))
        worst = max(beyond, key=lambda i: beyond[i][1])
        odd[worst] = beyond[worst][0], ()
        remaining.remove(worst)
    return odd


def _noise(d: Array) -> float:
    """Variance of white noise in d, by the mean size of its smaller steps: neither drift nor spikes count.

    A median would not do: of a sensor that rounds it is a whole number of steps.
    """
    if len(d) < 2:
        return 0.0
    steps = np.sort(np.abs(np.diff(d)))
    kept = steps[: max(1, int(SMALLER * len(steps)))]
    sigma = float(kept.mean()) / MEAN_OF_SMALLER
    return 0.5 * sigma * sigma  # inf rather than an error where readings are huge
