"""The filter over a record, a piece of one, one row, or chosen rows; and what every filter can do."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.numbers import Array, Indices, Mask, ShortRepr
from kalscope.errors import BadSetting
from kalscope.filtering import kernels, two_speeds
from kalscope.filtering.params import (
    FilterParams,
    checked_readings,
    infinite,
    require_params,
    samples_of,
    step_of,
    steps_of,
)
from kalscope.filtering.steady import SteadyState, steady_state

# The filter over a record, a piece of one, or one row: `KalmanFilter` holds the state, the functions run it.
#
# The streaming filter agrees with that of a whole record bit for bit. The smoother uses later samples too, so a
# device cannot run it; in the chart it is the bound for any filter.


PIECE = 16384
"""Samples that are filtered at once where few are kept: their rows, 0.9 MB, stay in the processor's cache."""

FIRST_CAPACITY = 4096
"""Rows allocated at first for a record that grows; the capacity doubles."""

_ROWS = ("x", "p", "k", "innovation", "s", "velocity", "velocity_p", "moving")
Counts = NDArray[np.int64]
_NO_TIME = (1.0, 0.0, 0.0, 0.0, 0.0)
_PLAIN_STEP, _TRANSITION = kernels.step.py_func, kernels.transition.py_func
"""Without momentum one reading takes less time as plain Python, the same to the last bit, than a compiled call."""


@dataclass(frozen=True, repr=False)
class FilterResult(ShortRepr):
    """What the filter computed.

    Of one sensor all arrays have the shape of z, (n,) or (n, channels: independent filters). Of several sensors
    x, p and the velocity have shape (n,), and k, innovation and s (n, sensors).
    """

    x: Array
    """Filtered value (posterior mean), unit; NaN before the first finite reading of an automatic start."""
    p: Array
    """Posterior variance, unit²; inf before the first finite reading of a diffuse start."""
    k: Array
    """Kalman gain: by how much x moves for an innovation of 1; 0 where a reading was missing or rejected."""
    innovation: Array
    """z minus the predicted reading, unit of the sensor; NaN where z is missing or sets the start."""
    s: Array
    """Innovation variance, gain² p + r with the predicted p; inf where a diffuse start is set."""
    loglik: float | Array
    """Log-likelihood: sum over the m scored innovations of −½(ln 2π + ln s + v²/s); (channels,) for 2-D z."""
    m: int | Counts
    """Scored innovations: neither missing, nor rejected, nor the one that sets the start."""
    rejected: int | Counts
    """Readings that the outlier gate rejected; of each sensor, shape (sensors,), or of each channel."""
    velocity: Array | None = None
    """Filtered velocity, unit per nominal sample period; None without momentum."""
    velocity_p: Array | None = None
    """Its posterior variance."""
    moving: Array | None = None
    """With two speeds, the probability that the signal moves, 0 … 1; None with one."""
    params: FilterParams | None = field(default=None, kw_only=True)
    """The parameters of `kalman_filter`; None for another filter, or where not all samples were kept."""
    dt: Array | None = field(default=None, kw_only=True)
    """The periods before each sample that it was given; None = 1 each."""

    @property
    def rows(self) -> dict[str, Array]:
        """The arrays by name, without those that are None."""
        each: dict[str, Array | None] = {name: getattr(self, name) for name in _ROWS}
        return {name: row for name, row in each.items() if row is not None}

    def at(self, indices: Indices) -> FilterResult:
        """The rows of these indices; loglik, m and rejected stay those of all."""
        kept: dict[str, Any] = {name: row[indices] for name, row in self.rows.items()}
        return replace(self, **kept, params=None, dt=None)


@dataclass(frozen=True, repr=False)
class SmootherResult(ShortRepr):
    """What `smooth` computed; shapes as in `FilterResult`."""

    x: Array
    """Smoothed value, the mean given all samples, unit; NaN only where z holds no sample and x0 is None."""
    p: Array
    """Its variance, unit², at most the filter's; inf only where z holds no sample and p0 is None."""
    velocity: Array | None = None
    """Smoothed velocity, unit per nominal sample period; None without momentum."""
    velocity_p: Array | None = None
    """Its variance."""


Rows = tuple[kernels.States, kernels.Readings]
"""Arrays that the loops fill: x, v, p, g and w, shape (rows,), of which v, g and w are empty without momentum (with
two speeds v is the probability of moving); k, innovation and s on the scale of x, shape (rows, sensors)."""


def empty_rows(params: FilterParams, rows: int) -> Rows:
    """Arrays for this many rows."""
    more, shape = rows if params.momentum else 0, (rows, params.sensors)
    x, v, p, g, w = (np.empty(size) for size in (rows, rows if params.fast else more, rows, more, more))
    return (x, v, p, g, w), (np.empty(shape), np.empty(shape), np.empty(shape))


class KalmanFilter:
    """The filter with its state: takes a row with `update`, or many with `run`, and continues where it was.

    Both give the same numbers, bit for bit. Before the first finite reading of a diffuse start x is NaN, p inf and
    k 0.
    """

    def __init__(self, params: FilterParams) -> None:
        """Args: params: the model; with an r per sensor, each row holds a reading of each."""
        self.params = require_params(params)
        self._tau = params.momentum or None
        self._gate = math.inf if params.gate is None else params.gate
        self._r = params.scaled_r
        self._scales = None if params.reads_x else (params.offset, params.gain)
        self._sensors = list(zip(params.offset.tolist(), params.gain.tolist(), self._r.tolist(), strict=True))
        x, p = (math.nan if params.x0 is None else params.x0), (math.inf if params.p0 is None else params.p0)
        v = 0.0 if params.fast is None else two_speeds.SHARE
        self._state: kernels.State = (x, v, p, 0.0, 0.0 if self._tau is None else 0.5 * params.q / self._tau)
        self._in_a_row, self._k = [0] * params.sensors, [0.0] * params.sensors
        self._step = _PLAIN_STEP if self._tau is None else kernels.step
        self._dt, self._over = 1.0, _TRANSITION(1.0, params.q, self._tau)

    @property
    def x(self) -> float:
        """Filtered value, unit."""
        return self._state[0]

    @property
    def p(self) -> float:
        """Posterior variance, unit²."""
        return self._state[2]

    @property
    def k(self) -> float | Array:
        """By how much the last row moved x for an innovation of 1; of each sensor, where r is given per sensor."""
        return np.array(self._k) if self.params.fuses else self._k[0]

    @property
    def velocity(self) -> float:
        """Filtered velocity, unit per nominal sample period; NaN without momentum."""
        return math.nan if self._tau is None else self._state[1]

    @property
    def moving(self) -> float:
        """Probability that the signal moves, 0 … 1; NaN with one speed."""
        return math.nan if self.params.fast is None else self._state[1]

    def update(self, z: ArrayLike, dt: float | None = None) -> float:
        """Take one row and return the filtered value.

        Args:
            z: the reading, or with an r per sensor one of each, shape (sensors,); NaN is a missing one (all
                missing: predict only).
            dt: nominal sample periods since the last row, ≥ 0; None = 1.

        Raises:
            BadSetting: a reading is infinite, or there is another number of them; dt is negative. The state stays.
        """
        elapsed = 1.0 if dt is None else step_of(dt)
        readings = (z,) if self._scales is None and isinstance(z, float) and not math.isinf(z) else self._row(z)
        if self.params.fast is not None:
            grown, lasting = elapsed * self.params.q, two_speeds.LASTING**elapsed
            model = self.params.fast, self._sensors[0][2], self.params.spikes
            self._state, self._k[0], *_ = two_speeds.step_two_speeds(
                readings[0], grown, lasting, *model, self._state
            )
            return self._state[0]
        if elapsed != self._dt:
            self._dt, self._over = elapsed, _TRANSITION(elapsed, self.params.q, self._tau)
        over, counts = self._over, self._in_a_row
        for j, y in enumerate(readings):
            offset, gain, r = self._sensors[j]
            if self._scales is not None:
                y = (y - offset) / gain  # noqa: PLW2901 - on the scale of x
            self._state, k, _, _, _, done = self._step(y, over, r, self._gate, self._state, counts[j], self._tau)
            self._k[j], over = k / gain, _NO_TIME
            if done != kernels.MISSING:
                counts[j] = counts[j] + 1 if done == kernels.REJECTED else 0
        return self._state[0]

    def run(self, z: ArrayLike, dt: ArrayLike | None = None) -> FilterResult:
        """Take the rows that follow.

        Args:
            z: readings, shape (n,), or with an r per sensor (n, sensors); NaN is a missing one.
            dt: nominal sample periods that elapse before each row, shape (n,), ≥ 0; None = 1 each. dt[0] = 0 puts
                the prior at the first row.

        Raises:
            BadSetting: z holds inf or has another shape; dt does not fit z. The state stays.
        """
        readings = checked_readings(samples_of(z), self.params)
        rows = empty_rows(self.params, len(readings))
        return self.take(readings, steps_of(dt, len(readings)), rows)

    def take(self, readings: Array, steps: Array, rows: Rows) -> FilterResult:
        """Take checked readings, shape (n, sensors), into the first n rows; `steps` empty for regular sampling."""
        refused, scored, loglik = self._run_loop(readings, steps, rows, keep=True)
        x, v, p, _, w = (row[: len(readings)] for row in rows[0])
        k, innovation, s = (row[: len(readings)] for row in rows[1])
        if self._scales is not None and np.any(
            (gain := self._scales[1]) != 1.0
        ):  # back on the scale of each sensor
            np.divide(k, gain, out=k)
            np.multiply(innovation, gain, out=innovation)
            np.multiply(s, gain * gain, out=s)
            loglik -= float(scored @ np.log(np.abs(gain)))
        if len(readings):
            self._k = k[-1].tolist()
        fuses = self.params.fuses
        k, innovation, s = (k, innovation, s) if fuses else (k[:, 0], innovation[:, 0], s[:, 0])
        velocity = (None, None) if self._tau is None else (v, w)
        moving = None if self.params.fast is None else v
        rejected = refused if fuses else int(refused[0])
        return FilterResult(x, p, k, innovation, s, loglik, int(scored.sum()), rejected, *velocity, moving)

    def _run_loop(self, readings: Array, steps: Array, rows: Rows, *, keep: bool) -> tuple[Counts, Counts, float]:
        """The readings rejected and scored of each sensor, and the log-likelihood on the scale of x."""
        in_a_row = np.array(self._in_a_row, dtype=np.int64)
        refused, scored, ells = np.zeros_like(in_a_row), np.zeros_like(in_a_row), np.zeros(len(in_a_row))
        if self.params.fast is not None:
            speeds = self.params.q, self.params.fast, float(self._r[0]), self.params.spikes
            self._state, scored[0], loglik = two_speeds.filter_two_speeds(
                readings, steps, *speeds, self._state, *rows, keep or None
            )
            return refused, scored, loglik
        model = self.params.q, self._tau, self._scales, self._r, self._gate
        tally = in_a_row, refused, scored
        self._state, loglik = kernels.filter_rows(
            readings, steps, *model, self._state, tally, *rows, ells, keep or None
        )
        self._in_a_row = in_a_row.tolist()
        return refused, scored, loglik

    def advance(self, x: float) -> None:
        """Set x, where a loop of its own has filtered what followed with a settled gain."""
        self._state = (x, *self._state[1:])

    def denoise(self, z: Array, steps: Array, out: Array) -> None:
        """X only of one sensor that reads x itself, from the start, into `out`; z is not checked yet."""
        if self.params.fast is not None:
            rows = empty_rows(self.params, 0)
            self._run_loop(checked_readings(z, self.params), steps, ((out, *rows[0][1:]), rows[1]), keep=False)
            return
        stopped = kernels.denoise_samples(
            z, steps, self.params.q, self._tau, float(self._r[0]), self._gate, self._state, out
        )
        if stopped >= 0:
            raise infinite(z[stopped], stopped)

    def smooth(self, z: Array, dt: ArrayLike | None = None) -> SmootherResult:
        """Smooth z, from the start."""
        readings = checked_readings(z, self.params)
        steps = steps_of(dt, len(readings))
        rows, start = empty_rows(self.params, len(readings)), self._state[0]
        self._run_loop(readings, steps, rows, keep=self._scales is not None or self.params.fast is not None)
        x, v, p, _, w = rows[0]
        if self.params.fast is not None:  # the process noise that the filter expected, sample by sample
            steps = (steps if len(steps) else 1.0) * (1.0 + (self.params.fast - 1.0) * v)
        if len(x) and math.isnan(start):
            start = float(x[0] if math.isfinite(x[0]) else x[np.isfinite(x).argmax()])
        if len(x) and not math.isnan(start):
            kernels.smooth_states(steps, self.params.q, self._tau, start, rows[0])
        return SmootherResult(x, p) if self._tau is None else SmootherResult(x, p, v, w)

    def _row(self, z: ArrayLike) -> list[float]:
        """The readings of one row, checked."""
        row = samples_of(z)
        if row.shape != ((self.params.sensors,) if self.params.fuses else ()):
            must = f"hold {self.params.sensors} readings" if self.params.fuses else "be one number"
            raise BadSetting(f"z must {must} (got shape {row.shape})")
        return checked_readings(row.reshape(1, -1) if self.params.fuses else row.reshape(1), self.params)[
            0
        ].tolist()


def was_rejected(k: Array, p: Array, innovation: Array) -> Mask:
    """Which samples the outlier gate rejected: there is an innovation and p > 0, but K = 0."""
    return (k == 0.0) & (p > 0.0) & np.isfinite(innovation)


def like_series(z: Any, x: Array) -> Any:
    """The array x; where z is a Series, a Series with its index and name."""
    return type(z)(x, index=z.index, name=z.name) if hasattr(z, "iloc") and x.ndim == 1 else x


def _params_of(params: FilterParams | None, q: float | None, r: float | None) -> FilterParams:
    """The parameters, or those of q and r."""
    if q is None and r is None:
        return require_params(params)
    if params is not None or q is None or r is None:
        raise BadSetting(f"the filter needs params, or q and r (got params = {params}, q = {q}, r = {r})")
    return FilterParams(q, r)


def kalman_filter(
    z: ArrayLike,
    params: FilterParams | None = None,
    dt: ArrayLike | None = None,
    *,
    q: float | None = None,
    r: float | None = None,
) -> FilterResult:
    """Filter a record and keep the whole state at each sample.

    Args:
        z: measurements, shape (n,) or (n, channels: independent filters), or with an r per sensor (n, sensors);
            NaN is a missing one.
        params: the model; None = that of q and r.
        dt: nominal sample periods that elapse before each sample, shape (n,), ≥ 0; None = 1 each. dt[0] = 0
            puts the prior at the first sample.
        q: process-noise variance per sample, unit², in place of params.
        r: measurement-noise variance, unit², in place of params.

    Raises:
        BadSetting: z holds inf or has another shape; dt or params do not fit z; params and q, or neither.

    Source: Ma'arif et al. (2019), equations (11)–(15); Durbin & Koopman (2012), section 2.2.
    """
    params = _params_of(params, q, r)
    columns = _columns(z, params)
    given: dict[str, Any] = {"params": params, "dt": None if dt is None else steps_of(dt, len(samples_of(z)))}
    if columns is None:
        return replace(KalmanFilter(params).run(z, dt), **given)
    each = [KalmanFilter(params).run(column, dt) for column in columns]
    sums = {name: np.array([getattr(one, name) for one in each]) for name in ("loglik", "m", "rejected")}
    return _side_by_side(each, _ROWS, **sums, **given)


def fuse(z: ArrayLike, params: FilterParams, dt: ArrayLike | None = None) -> FilterResult:
    """Fuse the readings of several sensors of one quantity: `kalman_filter` with an r per sensor.

    A row predicts once, then the sensors that have a reading update one after the other, in column order. The first
    finite reading of a diffuse start sets x = (z − offset)/gain with the variance r/gain², and is not scored; other
    readings of its row are updates.

    Args:
        z: readings, shape (n, sensors); NaN where a sensor has none: that covers gaps and different rates.
        params: the model, with an r per sensor.
        dt: nominal sample periods that elapse before each row, shape (n,), ≥ 0; None = 1 each.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z; params hold one r.

    Source: Durbin & Koopman (2012), section 6.4, the univariate treatment of multivariate series.
    """
    if not require_params(params).fuses:
        raise BadSetting(f"r must be one variance per sensor, shape (sensors,) (got {params.r})")
    return KalmanFilter(params).run(z, dt)


def denoise(
    z: Any,
    params: FilterParams | None = None,
    dt: ArrayLike | None = None,
    out: Array | None = None,
    *,
    q: float | None = None,
    r: float | None = None,
) -> Array:
    """The filtered signal only, as fast as memory allows; within 1e-12 · max|z| of `kalman_filter`.

    Args:
        z: measurements, shape (n,) or (n, channels), or with an r per sensor (n, sensors); NaN is a missing one.
        params: the model; None = that of q and r.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        out: float64 array of the result's shape to write into (may be z itself); None = a new one.
        q: process-noise variance per sample, unit², in place of params.
        r: measurement-noise variance, unit², in place of params.

    Returns:
        x, float64, shape of z, or (n,) of several sensors; of a Series a Series with its index.

    Raises:
        BadSetting: z holds inf or has another shape; dt, params or out do not fit z; params and q, or neither.
    """
    params = _params_of(params, q, r)
    columns = _columns(z, params)
    samples = samples_of(z)
    shape = samples.shape if params.reads_x else samples.shape[:1]
    if out is not None:
        _check_out(out, shape)
    direct = out is not None and out.ndim == 1 and out.flags.c_contiguous and not np.may_share_memory(out, z)
    target = out if out is not None and direct else np.empty(shape)
    if columns is not None:
        for i, column in enumerate(columns):
            target[:, i] = denoise(column, params, dt)
    elif params.reads_x:
        if samples.ndim != 1:
            raise BadSetting(f"z must have shape (n,) or (n, channels) (got {samples.shape})")
        KalmanFilter(params).denoise(np.ascontiguousarray(samples), steps_of(dt, len(samples)), target)
    else:
        target[:] = KalmanFilter(params).run(samples, dt).x
    if out is None:
        return like_series(z, target)
    if not direct:
        out[...] = target
    return out


def smooth(z: ArrayLike, params: FilterParams, dt: ArrayLike | None = None) -> SmootherResult:
    """Smooth a record over its whole length (fixed interval, Rauch–Tung–Striebel).

    The filter runs forward, then each estimate is corrected by the one after it, with j = p / (p + q dt):
    x_s = x + j (x_s' − x), p_s = j q dt + j² p_s'. Samples before a diffuse start, and all missing ones, get
    the value and the variance that follow from their neighbours. A reading that the gate rejects in the
    forward pass counts as missing.

    Args:
        z: measurements, shape (n,) or (n, channels: independent records), or with an r per sensor (n, sensors);
            NaN is a missing one.
        params: the model.
        dt: nominal sample periods that elapse before each sample, shape (n,), ≥ 0; None = 1 each. dt[0] = 0
            puts the prior at the first sample.

    Raises:
        BadSetting: z holds inf or has another shape; dt or params do not fit z.

    Source: Rauch, Tung & Striebel (1965), AIAA J. 3(8); Durbin & Koopman (2012), section 2.4, same values.
    """
    columns = _columns(z, params)
    if columns is None:
        return KalmanFilter(params).smooth(samples_of(z), dt)
    return _side_by_side(
        [KalmanFilter(params).smooth(one, dt) for one in columns], ("x", "p", "velocity", "velocity_p")
    )


def filter_pieces(
    z: ArrayLike, params: FilterParams, dt: ArrayLike | None = None
) -> Iterator[tuple[int, FilterResult]]:
    """What `kalman_filter` gives, piece by piece: the first row of each, and its result.

    For what needs all rows, but none for long: the arrays of a result are overwritten by the next one. Its sums are
    those of the piece.

    Args:
        z: measurements, shape (n,), or with an r per sensor (n, sensors); NaN is a missing one.
        params: the model.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.

    Raises:
        BadSetting: z holds inf or has another shape; dt or params do not fit z.
    """
    one = KalmanFilter(params)
    readings = checked_readings(samples_of(z), params)
    steps = steps_of(dt, len(readings))
    rows = empty_rows(params, min(PIECE, len(readings)))
    for first in range(0, len(readings), PIECE):
        piece = readings[first : first + PIECE]
        yield first, one.take(piece, steps[first : first + PIECE], rows)


class Continued(Protocol):
    """A filter with its state, which takes the rows that follow with `run`."""

    def run(self, z: ArrayLike, dt: ArrayLike | None = None) -> FilterResult: ...  # noqa: D102


class GrowingRun:
    """The result of a filter for a record that arrives in pieces; equal to that of the whole bit for bit.

    Earlier results do not change: they are views of rows that are written only once.
    """

    def __init__(self, one: Continued) -> None:
        """Args: the filter at its start."""
        self._filter, self._first, self._last = one, 0, 0
        self._rows: dict[str, Array] = {}
        self._sums: FilterResult | None = None

    def __len__(self) -> int:
        return self._last - self._first

    def extend(self, z: ArrayLike, dt: ArrayLike | None = None) -> None:
        """Filter the rows that follow; arguments and errors as `KalmanFilter.run`."""
        new = self._filter.run(z, dt)
        if self._sums is None:
            self._sums, self._rows = new, {name: row[:0] for name, row in new.rows.items()}
        else:
            self._sums = _added(self._sums, new.loglik, new.m, new.rejected)
        if self._last + len(new.x) > len(self._rows["x"]):
            self._make_room(len(new.x))
        end = self._last + len(new.x)
        for name, row in self._rows.items():
            row[self._last : end] = getattr(new, name)
        self._last = end

    def forget(self, count: int) -> None:
        """Drop the oldest `count` rows, at most all of them; later results do not change."""
        self._first = min(self._first + max(count, 0), self._last)

    @property
    def result(self) -> FilterResult:
        """The rows kept, len(self) of them, once there are any; loglik, m and rejected cover all rows."""
        if self._sums is None:
            raise BadSetting("the result must be read after the first rows (got none)")
        return replace(self._sums, **{name: self._view(row) for name, row in self._rows.items()})

    def _view(self, row: Array) -> Array:
        view = row[self._first : self._last]
        view.flags.writeable = False
        return view

    def _make_room(self, count: int) -> None:
        """Copy the kept rows into larger arrays: old views must not change."""
        kept = len(self)
        more = max(FIRST_CAPACITY, 2 * (kept + count)) - kept
        for name, row in self._rows.items():
            room = np.empty((more, *row.shape[1:]))
            self._rows[name] = np.concatenate([row[self._first : self._last], room])
        self._first, self._last = 0, kept


Result = TypeVar("Result", FilterResult, SmootherResult)


def _columns(z: ArrayLike, params: FilterParams) -> list[Array] | None:
    """The channels of a 2-D z that one sensor's parameters filter each; None for anything else."""
    fuses, samples = require_params(params).fuses, samples_of(z)
    if samples.ndim != 2 or fuses:
        return None
    if samples.shape[1] == 0:
        raise BadSetting(f"z must have shape (n,) or (n, channels) (got {samples.shape})")
    return [np.ascontiguousarray(column) for column in samples.T]


def _side_by_side(each: list[Result], names: tuple[str, ...], **sums: Any) -> Result:
    rows = {name: [getattr(one, name) for one in each] for name in names}
    stacked = {name: None if column[0] is None else np.stack(column, axis=1) for name, column in rows.items()}
    return replace(each[0], **stacked, **sums)


def _check_out(out: Any, shape: tuple[int, ...]) -> None:
    kind, size = getattr(out, "dtype", None), getattr(out, "shape", None)
    if kind != np.float64 or size != shape or not isinstance(out, np.ndarray) or not out.flags.writeable:
        raise BadSetting(f"out must be a writeable float64 array of z's shape {shape} (got {kind} {size})")


# The filter over a whole record, of which only chosen rows are kept: those that a chart draws.
#
# A run that keeps everything writes 40 bytes per sample, and for a million samples it spends most of its time on
# memory that is not in the processor's cache. Here the rows of one piece are overwritten again and again; and once
# the gain has settled, whole chunks are filtered at once, as in `denoise`.


def filter_at(z: ArrayLike, params: FilterParams, indices: Indices, dt: ArrayLike | None = None) -> FilterResult:
    """What `kalman_filter` gives at some rows, x and innovation within 1e-12 · max|z|.

    Args:
        z: measurements, shape (n,), or with an r per sensor (n, sensors); NaN is a missing one.
        params: the model.
        indices: the rows to keep, ascending, shape (m,).
        dt: nominal sample periods before each row, shape (n,), ≥ 0; None = 1 each.

    Returns:
        Arrays of m rows; the log-likelihood (to the rounding of its sum), m and rejected are of all rows.

    Raises:
        BadSetting: z holds inf or has another shape; dt or params do not fit; indices outside of z.
    """
    samples = samples_of(z)
    checked_readings(samples[:0], require_params(params))
    at = np.ascontiguousarray(indices, dtype=np.intp)
    if len(at) and not 0 <= at[0] <= at[-1] < len(samples):
        raise BadSetting(f"indices must be of z, 0 to {len(samples) - 1} (got {at[0]} to {at[-1]})")
    steps, one = steps_of(dt, len(samples)), KalmanFilter(params)
    rows, result = empty_rows(params, min(PIECE, len(samples))), one.run(samples[:0])
    kept = {name: np.empty((len(at), *row.shape[1:])) for name, row in result.rows.items()}
    is_plain = params.reads_x and not params.momentum and params.gate is None and not params.fast and not len(steps)
    first = picked = 0
    while first < len(samples):
        readings = checked_readings(samples[first : first + PIECE], params, first)
        piece = one.take(readings, steps[first : first + PIECE], rows)
        first += len(piece.x)
        end = int(np.searchsorted(at, first))
        for name, row in piece.rows.items():
            kept[name][picked:end] = row[at[picked:end] - first + len(piece.x)]
        result, picked = _added(result, piece.loglik, piece.m, piece.rejected), end
        if first == len(samples):  # a short record needs no compiled loop
            break
        p, k, s = piece.p[-1], piece.k[-1], piece.s[-1]
        if is_plain and k > 0.0 and abs(p - piece.p[-2:][0]) <= kernels.SETTLED_WITHIN * p:
            out = kept["x"][picked:], kept["innovation"][picked:]
            done, x, squares = kernels.filter_settled(samples[first:], k, one.x, at[picked:], first, out)
            first += done
            end = int(np.searchsorted(at, first))
            for name, value in (("p", p), ("k", k), ("s", s)):
                kept[name][picked:end] = value
            one.advance(x)
            loglik = -0.5 * (done * math.log(2.0 * math.pi * s) + squares / s)
            result, picked = _added(result, loglik, done, 0), end
    return replace(result, **kept, params=None, dt=None)


def _added(result: FilterResult, loglik: Any, m: Any, rejected: Any) -> FilterResult:
    sums = {"loglik": result.loglik + loglik, "m": result.m + m, "rejected": result.rejected + rejected}
    return replace(result, **sums)


# What every filter can do: the standard one, of q and r, and others beside it.


class Streaming(Protocol):
    """A filter with its state, which takes one sample with each `update`."""

    def update(self, z: ArrayLike, dt: float | None = None) -> float: ...  # noqa: D102


class Filter(Protocol):
    """A filter with its parameters, a frozen, hashable value: filters that are equal give equal results."""

    is_standard: ClassVar[bool] = False
    """Whether it is the Kalman filter of q and r alone: only that can be searched for, judged and mapped."""

    def run(self, z: ArrayLike, dt: ArrayLike | None = None) -> FilterResult:
        """Filter a record; arguments and errors as `kalman_filter`."""
        ...

    def denoise(self, z: ArrayLike, dt: ArrayLike | None = None) -> Array:
        """The filtered signal only; arguments and errors as `denoise`."""
        return self.run(z, dt).x

    def stream(self) -> Streaming:
        """The same filter, sample by sample."""
        ...

    def settled(self, result: FilterResult, sample_period: float | None = None) -> SteadyState:
        """Gain, lag and noise reduction once the start is forgotten.

        Args:
            result: a run of this filter over one channel, for filters whose gain depends on the signal.
            sample_period: nominal sample period in s, > 0.
        """
        ...


@dataclass(frozen=True)
class StandardFilter(Filter):
    """The scalar Kalman filter of q and r as a `Filter`."""

    params: FilterParams
    is_standard: ClassVar[bool] = True

    def run(self, z: ArrayLike, dt: ArrayLike | None = None) -> FilterResult:
        """`kalman_filter`."""
        return kalman_filter(z, self.params, dt)

    def denoise(self, z: ArrayLike, dt: ArrayLike | None = None) -> Array:
        """`denoise`: faster than `run`, and within 1e-12 · max|z| of it."""
        return denoise(z, self.params, dt)

    def stream(self) -> KalmanFilter:
        """A `KalmanFilter`."""
        return KalmanFilter(self.params)

    def settled(self, result: FilterResult, sample_period: float | None = None) -> SteadyState:  # noqa: ARG002
        """`steady_state`: q and r alone decide it."""
        return steady_state(self.params, sample_period)
