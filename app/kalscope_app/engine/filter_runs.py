"""The runs of the filters over the record on screen, kept between frames; those of a live record are continued."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from kalscope.common.array import Array
from kalscope.filtering.batch import FilterResult, denoise, kalman_filter
from kalscope.filtering.pieces.chosen import filter_at, picked
from kalscope.filtering.pieces.running import RunningFilter
from kalscope.filtering.protocol import Filter, StandardFilter
from kalscope_app.engine.cache import Cache
from kalscope_app.engine.decimation import DrawnSamples
from kalscope_app.session.state import State

MAX_KEPT = 1_000_000
"""Samples of a finished recording up to which a whole run is kept: it takes 40 bytes a sample."""


@dataclass(frozen=True)
class DrawnRun:
    """What a chart needs of a run."""

    at: FilterResult
    """The run at the samples drawn; its sums are of all samples."""
    gain: Callable[[int], Array]
    """The gain of so many first samples."""
    whole: FilterResult | None
    """All of the run; None where only the drawn samples were kept."""


@dataclass
class _LiveRun:
    """A run over a growing record."""

    running: RunningFilter
    first: int
    """Number of its first sample, counted since the board began to send."""


class FilterRuns:
    """Filters the record of a State, once for each filter."""

    def __init__(self) -> None:
        self._whole = Cache[FilterResult]()
        self._drawn = Cache[DrawnRun]()
        self._live = Cache[_LiveRun]()

    def begin(self, state: State) -> None:
        """A new frame begins."""
        scope = (state.record_key, state.channel, state.recording.gaps)
        self._whole.begin(*scope)
        self._live.begin(*scope)

    def of(self, state: State, used: Filter) -> FilterResult:
        """The channel on screen, filtered."""
        if state.live is not None and isinstance(used, StandardFilter):
            return self._continued(state, used)
        if state.live is not None or len(state.z) > MAX_KEPT:
            return used.run(state.z, state.dt)
        return self._whole.get(used, lambda: used.run(state.z, state.dt))

    def drawn(self, state: State, drawn: DrawnSamples) -> DrawnRun:
        """The filter of the State at the samples drawn; of a finished recording no others are kept."""
        used = state.filter
        if state.live is None and state.board is None and isinstance(used, StandardFilter):
            self._drawn.begin(state.record_key, state.channel, state.recording.gaps, drawn)
            return self._drawn.get(used, lambda: _at_drawn(state, used, drawn))
        whole = self.of(state, used)
        return DrawnRun(picked(whole, drawn.indices), lambda size: whole.k[:size], whole)

    def _continued(self, state: State, used: StandardFilter) -> FilterResult:
        z, n = state.z, len(state.recording)
        snapshot = state.live.snapshot if state.live else None
        first = 0 if snapshot is None else snapshot.first
        run = self._live.get(used, lambda: _LiveRun(RunningFilter(used.params), first))
        if not 0 <= first - run.first <= len(run.running) <= first - run.first + n:
            run.running, run.first = RunningFilter(used.params), first
        run.running.forget(first - run.first)
        run.first = first
        run.running.extend(z[len(run.running) :])
        return run.running.result


def _at_drawn(state: State, used: StandardFilter, drawn: DrawnSamples) -> DrawnRun:
    z, dt, params = state.z, state.dt, used.params

    def gain(size: int) -> Array:
        return kalman_filter(z[:size], params, None if dt is None else dt[:size]).k

    return DrawnRun(filter_at(z, params, drawn.indices, dt), gain, None)


class VariantCurves:
    """The filtered signals of the pinned settings at the drawn samples: no slider changes them."""

    def __init__(self) -> None:
        self._curves = Cache[Array]()

    def of(self, state: State, drawn: DrawnSamples) -> tuple[Array, ...]:
        """One curve for each variant of the channel on screen, in their order, unit, shape (m,)."""
        self._curves.begin(drawn, state.recording, state.channel)
        settings = [variant.tuning.params for variant in state.variants]
        return tuple(
            self._curves.get(params, lambda params=params: denoise(state.z, params, state.dt)[drawn.indices])
            for params in settings
        )
