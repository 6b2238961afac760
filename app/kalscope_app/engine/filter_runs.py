"""The runs of the filters over the record on screen, the samples that are drawn, and what is kept."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from tsdownsample import MinMaxLTTBDownsampler

from kalscope.common.numbers import Array
from kalscope.filtering.classic import ChainFilter
from kalscope.filtering.filter import (
    Filter,
    FilterResult,
    GrowingRun,
    StandardFilter,
    filter_at,
    kalman_filter,
)
from kalscope.filtering.steady import SteadyState
from kalscope.recording import Recording
from kalscope_app.session.state import State

# Results that are kept while nothing they depend on has changed.


T = TypeVar("T")

PLAIN = (bool, int, float, str, tuple, type(None))
"""Types that are compared by value; anything else, such as a recording, by identity."""


class Cache(Generic[T]):
    """The results of one round of questions, reused in the next one. One thread at a time."""

    def __init__(self) -> None:
        self._scope: tuple[object, ...] = ()
        self._last: dict[Hashable, T] = {}
        self._kept: dict[Hashable, T] = {}

    def begin(self, *scope: object) -> None:
        """Begin a round: drop what the last one did not ask for, and everything if the scope differs."""
        same = len(scope) == len(self._scope) and all(map(_same, scope, self._scope))
        self._scope, self._last, self._kept = scope, self._kept if same else {}, {}

    def get(self, key: Hashable, compute: Callable[[], T]) -> T:
        """The result for a key, computed if neither this round nor the last one asked for it."""
        if key not in self._kept:
            self._kept[key] = self._last[key] if key in self._last else compute()
        return self._kept[key]

    def once(self, compute: Callable[[], T], *scope: object) -> T:
        """The only result of a scope."""
        self.begin(*scope)
        return self.get(None, compute)


def _same(one: object, other: object) -> bool:
    return one is other or (isinstance(one, PLAIN) and one == other)


# Facts about all samples of a record.


@dataclass(frozen=True)
class Facts:
    """What holds for a whole recording and one of its channels."""

    ascends: bool = True
    """Whether its time never steps back."""
    missing: int = 0
    """Missing samples of the channel."""

    def clock(self, recording: Recording) -> NDArray[np.float64]:
        """Times to draw at, s, never descending, shape (n,): where time steps back, the last value is held."""
        return recording.time if self.ascends else np.maximum.accumulate(recording.time)


# Which samples of a long record are drawn.


MAX_POINTS = 4000
"""Points that a line is drawn with, at most."""


DENSE = 2000
"""Samples in the window from which a raw line is drawn as a band: about two to each pixel of a wide chart."""

REACH = 2
"""Drawn points to each side whose lowest and highest value the band holds: about one pixel."""


@dataclass(frozen=True)
class DrawnSamples:
    """Which samples of a recording are drawn; chosen on the raw signal, so that tuning changes only y."""

    first: int
    """Index of the first sample in the window."""
    last: int
    """One past the last sample in the window."""
    indices: NDArray[np.intp]
    """Samples drawn, ascending, shape (m,)."""
    time: Array
    """Their times, s, never descending, shape (m,)."""
    raw: Array
    """Their measurements, unit; NaN where missing, shape (m,)."""
    truth: Array | None
    """The noise-free signal there, where it is known, shape (m,)."""
    missing: int
    """Missing samples of the channel, drawn or not."""
    time_range: tuple[float, float]
    """First and last time of the recording, s."""
    band: tuple[Array, Array] | None = None
    """Lowest and highest measurement about each time, unit, two of shape (m,); None where a line is readable."""

    @property
    def decimated(self) -> bool:
        """Whether some samples of the window are not drawn."""
        return len(self.indices) < self.last - self.first


def facts_of(recording: Recording, channel: str) -> Facts:
    """The facts of a recording and a channel."""
    time, gaps = recording.time, np.isnan(recording.channel(channel))
    return Facts(not np.any(time[1:] < time[:-1]), int(np.count_nonzero(gaps)))


def choose_samples(
    recording: Recording,
    channel: str,
    window: tuple[float, float] | None,
    limit: int = MAX_POINTS,
    facts: Facts | None = None,
    others: tuple[str, ...] = (),
) -> DrawnSamples:
    """The samples to draw of one channel in a window (s, both ends inside); at least two if there are two.

    Args:
        recording: what is open.
        channel: the channel to draw.
        window: first and last time, s; None = all of it.
        limit: most points a line may have.
        facts: what is already known about the recording and the channel; None = read all samples.
        others: channels that are drawn at the same samples, as lines: then nothing is drawn as a band.
    """
    n = len(recording)
    facts = facts or facts_of(recording, channel)
    clock = facts.clock(recording)
    first, last = 0, n
    if window is not None:
        first = max(0, min(int(np.searchsorted(clock, window[0], side="left")), n - 2))
        last = min(n, max(int(np.searchsorted(clock, window[1], side="right")), first + 2))
    column = recording.index(channel)
    z = recording.values[:, column]
    truth = None if recording.truth is None else recording.truth[:, column]
    if others:
        at = first + choose_together(
            recording.values[first:last, list(map(recording.index, (channel, *others)))], limit
        )
    else:
        at = first + choose_indices(z[first:last], None if truth is None else truth[first:last], limit)
    dense = last - first > DENSE and not facts.missing and not others
    return DrawnSamples(
        first=first,
        last=last,
        indices=at,
        time=clock[at],
        raw=z[at],
        truth=None if truth is None else truth[at],
        missing=0 if others else facts.missing,
        time_range=(float(clock[0]), float(clock[-1])),
        band=band_around(z[first:last], at - first) if dense else None,
    )


def band_around(z: Array, at: NDArray[np.intp]) -> tuple[Array, Array]:
    """Lowest and highest value of z, shape (n,), about each of the samples `at`, ascending, shape (m,); no NaN."""
    ends = np.zeros(REACH, dtype=np.intp), np.full(REACH, len(at) - 1)
    near = np.concatenate((ends[0], np.arange(len(at)), ends[1]))
    starts = np.concatenate(([0], at[1:]))  # each sample belongs to the last drawn one, leading ones to the first
    low, high = (
        np.lib.stride_tricks.sliding_window_view(extreme.reduceat(z, starts)[near], 2 * REACH + 1)
        for extreme in (np.minimum, np.maximum)
    )
    return low.min(axis=1), high.max(axis=1)


def choose_indices(z: Array, truth: Array | None = None, limit: int = MAX_POINTS) -> NDArray[np.intp]:
    """Ascending indices of at most `limit` samples that preserve the shape of z, (n,), and of the truth."""
    n = len(z)
    if n <= limit:
        return np.arange(n, dtype=np.intp)
    if truth is None:
        return _downsample(z, limit)
    share = limit // 4
    return np.union1d(_downsample(z, limit - share), _downsample(truth, share)).astype(np.intp)


def choose_together(values: Array, limit: int) -> NDArray[np.intp]:
    """Ascending indices of at most `limit` rows that keep the shape of each column of `values`, (n, channels)."""
    n, channels = values.shape
    if n <= limit:
        return np.arange(n, dtype=np.intp)
    chosen = [_downsample(column, limit // channels) for column in values.T]
    return np.unique(np.concatenate(chosen)).astype(np.intp)


def _downsample(y: Array, points: int) -> NDArray[np.intp]:
    """MinMaxLTTB; missing samples are held at their last value for the choice."""
    if np.isnan(y).any():
        known = np.where(np.isnan(y), 0, np.arange(len(y)))
        y = np.nan_to_num(y[np.maximum.accumulate(known)])
    downsampler = cast("Any", MinMaxLTTBDownsampler())  # its stubs leave the types of the arguments open
    chosen: NDArray[np.uint64] = downsampler.downsample(np.ascontiguousarray(y), n_out=points)
    return np.unique(chosen).astype(np.intp)


# The runs of the filters over the record on screen, kept between frames; those of a live record are continued.


MAX_KEPT = 1_000_000
"""Samples of a finished recording up to which a whole run is kept: it takes 40 bytes per sample."""


@dataclass(frozen=True)
class DrawnRun:
    """What a chart needs of a run."""

    at: FilterResult
    """The run at the samples drawn; its sums are over all samples."""
    gain: Callable[[int], Array]
    """The gain of the first n samples."""
    whole: FilterResult | None
    """All of the run; None where only the drawn samples were kept."""


@dataclass
class _LiveRun:
    """A run over a growing record."""

    running: GrowingRun
    first: int
    """Number of its first sample, counted since the board began to send."""


class FilterRuns:
    """Filters what is on screen, one channel or several sensors, once for each filter."""

    def __init__(self) -> None:
        self._whole, self._live = Cache[FilterResult](), Cache[_LiveRun]()
        self._drawn, self._variants = Cache[FilterResult](), Cache[Array]()
        self._settled = Cache[SteadyState]()

    def begin(self, state: State) -> None:
        """A new frame begins."""
        scope = (state.record_key, state.measured, state.recording.gaps)
        self._whole.begin(*scope)
        self._live.begin(*scope)

    def of(self, state: State, used: Filter) -> FilterResult:
        """What is on screen, filtered by another filter or its own."""
        z = state.readings
        if state.live is not None and isinstance(used, StandardFilter | ChainFilter):
            return self._continued(state, used, z)
        if state.live is not None or len(z) > MAX_KEPT:
            return used.run(z, state.dt)
        return self._whole.get(used, lambda: used.run(z, state.dt))

    def drawn(self, state: State, drawn: DrawnSamples) -> DrawnRun:
        """The filter of the State at the samples drawn; for a finished recording only these are kept."""
        used, dt, whole = state.running_filter, state.dt, None
        if state.live is None and state.board is None and isinstance(used, StandardFilter):
            self._drawn.begin(state.record_key, state.measured, state.recording.gaps, drawn)
            at = self._drawn.get(used, lambda: filter_at(state.readings, used.params, drawn.indices, dt))
        else:
            whole = self.of(state, used)
            at = whole.at(drawn.indices)
        if state.running.sensors:  # no innovation is drawn, and the gain is that of the equivalent filter
            none = np.full(len(at.x), np.nan)
            at = replace(at, k=none, innovation=none, s=none)
            return DrawnRun(at, lambda size: kalman_filter(np.zeros(size), state.params).k, None)
        if whole is not None:
            return DrawnRun(at, lambda size: whole.k[:size], whole)

        def gain(size: int) -> Array:
            return kalman_filter(state.z[:size], state.params, None if dt is None else dt[:size]).k

        return DrawnRun(at, gain, None)

    def variants(self, state: State, drawn: DrawnSamples) -> tuple[Array, ...]:
        """The pinned settings of the channel on screen at the samples drawn: no slider changes them."""
        filters = [one.tuning.filter for one in state.variants]
        if state.live is not None:
            return tuple(self.of(state, one).x[drawn.indices] for one in filters)
        self._variants.begin(drawn, state.recording, state.channel)
        z, dt, at = state.z, state.dt, drawn.indices
        return tuple(self._variants.get(one, lambda one=one: one.denoise(z, dt)[at]) for one in filters)

    def settled(self, state: State, run: FilterResult) -> SteadyState:
        """The steady state of the State's filter, from its run; that of a chain is measured, which takes longer.

        For a growing record it is measured again only once the record has doubled in length.
        """
        used, period = state.filter, state.recording.sample_period
        if not isinstance(used, ChainFilter):
            return used.settled(run, period)
        size = 0 if state.live is None else len(state.recording).bit_length()
        self._settled.begin(state.record_key, state.measured, state.recording.gaps, size)
        return self._settled.get(used, lambda: used.settled(run, period))

    def _continued(self, state: State, used: StandardFilter | ChainFilter, z: Array) -> FilterResult:
        """The run over a live record as it is now: only the new samples go through the filter."""
        snapshot = state.live.snapshot if state.live else None
        first = 0 if snapshot is None else snapshot.first
        run = self._live.get(used, lambda: _LiveRun(GrowingRun(used.stream()), first))
        if not 0 <= first - run.first <= len(run.running) <= first - run.first + len(z):
            run.running, run.first = GrowingRun(used.stream()), first
        run.running.forget(first - run.first)
        run.first = first
        run.running.extend(z[len(run.running) :])
        return run.running.result
