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
from kalscope.filtering.filter import Filter, FilterResult, GrowingRun, StandardFilter, filter_at, kalman_filter
from kalscope.filtering.steady import SteadyState
from kalscope.recording import Recording
from kalscope_app.session.changes import live_window
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


Facts = tuple[Array, int]
"""Times to draw at, s, never descending, shape (n,): where time steps back, the last value is held; how many
samples of the channel are missing."""


def facts_of(recording: Recording, channel: str) -> Facts:
    """The facts of a recording and a channel, whatever the window."""
    time, missing = recording.time, np.isnan(recording.channel(channel))
    clock = np.maximum.accumulate(time) if np.any(time[1:] < time[:-1]) else time
    return clock, int(np.count_nonzero(missing))


# Which samples of a long record are drawn.


MAX_POINTS = 4000
"""Points that a line is drawn with, at most."""

MAX_LIVE_POINTS = 2000
"""The same while a board sends: every frame draws all of them again."""

DENSE = 2000
"""Samples in the window from which a raw line is drawn as a band: about two to each pixel of a wide chart."""

GAP = 0.01
"""Share of the window from which a gap in time can be seen."""

REACH = 2
"""Drawn points to each side whose lowest and highest value the band holds: about one pixel."""


@dataclass(frozen=True, eq=False)
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
    clock, missing = facts or facts_of(recording, channel)
    first, last = 0, n
    if window is not None:
        first = max(0, min(int(np.searchsorted(clock, window[0], side="left")), n - 2))
        last = min(n, max(int(np.searchsorted(clock, window[1], side="right")), first + 2))
    column, *columns = map(recording.index, (channel, *others))
    z = recording.values[:, column]
    truth = None if recording.truth is None else recording.truth[:, column]
    values = recording.values[first:last, [column, *columns]] if others else z[first:last]
    at = first + choose_indices(values, None if truth is None or others else truth[first:last], limit)
    dense, inside = last - first > DENSE and not (missing or others), clock[first:last]
    # Across a gap in time that can be seen a band would show readings where there are none.
    dense = dense and bool(np.diff(inside).max() <= GAP * (inside[-1] - inside[0]))
    return DrawnSamples(
        first=first,
        last=last,
        indices=at,
        time=clock[at],
        raw=z[at],
        truth=None if truth is None else truth[at],
        missing=0 if others else missing,
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
    """Ascending indices of at most `limit` samples that keep the shape of each column of z, and of the truth.

    Args:
        z: shape (n,) or (n, channels).
        truth: shape (n,), or None; a quarter of the samples is chosen for it.
        limit: most samples.
    """
    n = len(z)
    if n <= limit:
        return np.arange(n, dtype=np.intp)
    columns, share = z.reshape(n, -1).T, 0 if truth is None else limit // 4
    chosen = [_downsample(column, (limit - share) // len(columns)) for column in columns]
    chosen += [] if truth is None else [_downsample(truth, share)]
    return np.unique(np.concatenate(chosen)).astype(np.intp)


def _downsample(y: Array, points: int) -> NDArray[np.uint64]:
    """MinMaxLTTB; missing samples are held at their last value for the choice."""
    if np.isnan(y).any():
        known = np.where(np.isnan(y), 0, np.arange(len(y)))
        y = np.nan_to_num(y[np.maximum.accumulate(known)])
    downsampler = cast("Any", MinMaxLTTBDownsampler())  # its stubs leave the types of the arguments open
    return downsampler.downsample(np.ascontiguousarray(y), n_out=points)


# The runs of the filters over the record on screen, kept between frames; those of a live record are continued.


MAX_KEPT = 1_000_000
"""Samples of a finished recording up to which a whole run is kept: it takes 40 bytes per sample."""


DrawnRun = tuple[FilterResult, Callable[[int], Array], FilterResult | None]
"""What a chart needs of a run: the run at the samples drawn, its sums over all samples; the gain of the first n
samples; all of the run, or None where only the drawn samples were kept."""


@dataclass
class _LiveRun:
    """A run over a growing record."""

    running: GrowingRun
    first: int
    """Number of its first sample, counted since the board began to send."""


class FilterRuns:
    """Filters what is on screen, one channel or several sensors, once for each filter."""

    def __init__(self) -> None:
        self._live, self._kept = Cache[_LiveRun](), Cache[Any]()
        self._facts, self._samples = Cache[Facts](), Cache[DrawnSamples]()

    def begin(self, state: State) -> None:
        """A new frame begins."""
        scope = (state.record_key, state.measured, state.recording.gaps)
        self._live.begin(*scope)
        self._kept.begin(*scope)

    def choose(self, state: State) -> DrawnSamples:
        """The samples to draw of what is on screen."""
        recording, (channel, *others), window = state.recording, state.measured, live_window(state)
        limit = MAX_POINTS if state.live is None else MAX_LIVE_POINTS
        facts = self._facts.once(lambda: facts_of(recording, channel), recording, channel)
        return self._samples.once(
            lambda: choose_samples(recording, channel, window, limit, facts, others=tuple(others)),
            *(recording, state.measured, window, limit),
        )

    def of(self, state: State, used: Filter) -> FilterResult:
        """What is on screen, filtered by another filter or its own."""
        z = state.readings
        if state.live is not None and isinstance(used, StandardFilter | ChainFilter):
            return self._continued(state, used, z)
        if state.live is not None or len(z) > MAX_KEPT:
            return used.run(z, state.dt)
        return self._kept.get(used, lambda: used.run(z, state.dt))

    def drawn(self, state: State, drawn: DrawnSamples) -> DrawnRun:
        """The filter of the State at the samples drawn; for a finished recording only these are kept."""
        used, dt, whole = state.running.filter, state.dt, None
        if state.live is None and state.board is None and isinstance(used, StandardFilter):
            at = self._kept.get((used, drawn), lambda: filter_at(state.readings, used.params, drawn.indices, dt))
        else:
            whole = self.of(state, used)
            at = whole.at(drawn.indices)
        if state.running.sensors:  # no innovation is drawn, and the gain is that of the equivalent filter
            none = np.full(len(at.x), np.nan)
            at = replace(at, k=none, innovation=none, s=none)
            return at, lambda size: kalman_filter(np.zeros(size), state.params).k, None

        def gain(size: int) -> Array:
            if whole is not None:
                return whole.k[:size]
            return kalman_filter(state.z[:size], state.params, None if dt is None else dt[:size]).k

        return at, gain, whole

    def variants(self, state: State, drawn: DrawnSamples) -> tuple[Array, ...]:
        """The pinned settings of the channel on screen at the samples drawn: no slider changes them."""
        filters, z, dt, at = [one.tuning.filter for one in state.variants], state.z, state.dt, drawn.indices
        if state.live is not None:
            return tuple(self.of(state, one).x[at] for one in filters)
        return tuple(
            self._kept.get(("pinned", one, drawn), lambda one=one: one.denoise(z, dt)[at]) for one in filters
        )

    def settled(self, state: State, run: FilterResult) -> SteadyState:
        """The steady state of the State's filter, from its run; that of a chain is measured, which takes longer.

        For a growing record it is measured again only once the record has doubled in length.
        """
        used, period = state.filter, state.recording.sample_period
        if not isinstance(used, ChainFilter):
            return used.settled(run, period)
        size = 0 if state.live is None else len(state.recording).bit_length()
        return self._kept.get((used, size), lambda: used.settled(run, period))

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
