"""The runs of the filters over the record on screen, kept between frames; those of a live record are continued."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.chosen import filter_at
from kalscope.filtering.classic.chain_filter import ChainFilter
from kalscope.filtering.filter import FilterResult, GrowingRun, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.protocol import Filter, StandardFilter
from kalscope.filtering.steady_state import SteadyState
from kalscope_app.engine.cache import Cache
from kalscope_app.engine.decimation import DrawnSamples
from kalscope_app.session.fusion import Fusion
from kalscope_app.session.state import State

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
    """All of the run; None where only the drawn samples were kept, or sensors are fused."""


@dataclass
class _LiveRun:
    """A run over a growing record."""

    running: GrowingRun
    first: int
    """Number of its first sample, counted since the board began to send."""


class FilterRuns:
    """Filters the record of a State, once for each filter."""

    def __init__(self) -> None:
        self._whole = Cache[FilterResult]()
        self._drawn = Cache[DrawnRun]()
        self._settled = Cache[SteadyState]()
        self._live = Cache[_LiveRun]()
        self._fused = Cache[FilterResult]()
        self._live_fused = Cache[_LiveRun]()

    def begin(self, state: State) -> None:
        """A new frame begins."""
        scope = (state.record_key, state.measured, state.recording.gaps)
        self._whole.begin(*scope)
        self._live.begin(*scope)
        self._live_fused.begin(*scope)

    def of(self, state: State, used: Filter) -> FilterResult:
        """The channel on screen, filtered."""
        if state.live is not None and isinstance(used, StandardFilter | ChainFilter):
            return self._continued(state, used)
        if state.live is not None or len(state.z) > MAX_KEPT:
            return used.run(state.z, state.dt)
        return self._whole.get(used, lambda: used.run(state.z, state.dt))

    def drawn(self, state: State, drawn: DrawnSamples) -> DrawnRun:
        """The filter of the State at the samples drawn; for a finished recording only these are kept."""
        used = state.filter
        if state.fusion is not None:
            return _as_drawn(self._fused_at(state, state.fusion, drawn), state.params)
        if state.live is None and state.board is None and isinstance(used, StandardFilter):
            self._drawn.begin(state.record_key, state.channel, state.recording.gaps, drawn)
            return self._drawn.get(used, lambda: _at_drawn(state, used, drawn))
        whole = self.of(state, used)
        return DrawnRun(whole.at(drawn.indices), lambda size: whole.k[:size], whole)

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

    def _continued(self, state: State, used: StandardFilter | ChainFilter) -> FilterResult:
        def start() -> GrowingRun:
            return GrowingRun(used.params if isinstance(used, StandardFilter) else used.start())

        run = self._live.get(used, lambda: _LiveRun(start(), _first_of(state)))
        return _grown(run, state, start, lambda first: state.z[first:]).result

    def _fused_at(self, state: State, fusion: Fusion, drawn: DrawnSamples) -> FilterResult:
        """The fused value at the samples drawn."""
        params, columns = fusion.params, fusion.columns(state.recording)
        if state.live is None:
            self._fused.begin(state.record_key, state.measured, state.recording.gaps, drawn)
            z = state.recording.values
            return self._fused.get(params, lambda: filter_at(z[:, columns], params, drawn.indices, state.dt))
        run = self._live_fused.get(params, lambda: _LiveRun(GrowingRun(params), _first_of(state)))
        values = state.recording.values
        grown = _grown(run, state, lambda: GrowingRun(params), lambda first: values[first:, columns])
        return grown.result.at(drawn.indices)


def _first_of(state: State) -> int:
    """Number of the first sample of a live record, counted since the board began to send."""
    snapshot = state.live.snapshot if state.live else None
    return 0 if snapshot is None else snapshot.first


def _grown(
    run: _LiveRun, state: State, start: Callable[[], GrowingRun], samples_from: Callable[[int], Array]
) -> GrowingRun:
    """The run over a live record as it is now: only the new samples go through the filter."""
    first, n = _first_of(state), len(state.recording)
    if not 0 <= first - run.first <= len(run.running) <= first - run.first + n:
        run.running, run.first = start(), first
    run.running.forget(first - run.first)
    run.first = first
    run.running.extend(samples_from(len(run.running)))
    return run.running


def _as_drawn(fused: FilterResult, params: FilterParams) -> DrawnRun:
    """Fused sensors as a run: no innovation is drawn for them, and their gain is that of the equivalent filter."""
    none = np.full(len(fused.x), np.nan)
    at = FilterResult(fused.x, fused.p, none, none, none, 0.0, 0, fused.rejected, fused.velocity, fused.velocity_p)
    return DrawnRun(at, lambda size: kalman_filter(np.zeros(size), params).k, None)


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
        return tuple(
            self._curves.get(one, lambda one=one: one.denoise(state.z, state.dt)[drawn.indices])
            for one in (variant.tuning.filter for variant in state.variants)
        )
