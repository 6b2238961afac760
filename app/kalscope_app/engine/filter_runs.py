"""The runs of the filter over the record on screen, kept between frames: a live record is only gone on with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kalscope.filtering.batch import FilterResult
from kalscope.filtering.running import RunningFilter
from kalscope.papers.experiments import run_filter

if TYPE_CHECKING:
    from kalscope.filtering.params import FilterParams
    from kalscope_app.session.state import State

LARGEST_KEPT = 1_000_000
"""Samples of a finished recording up to which a run is kept: it takes 40 bytes a sample."""


@dataclass
class _LiveRun:
    """A run over a growing record."""

    running: RunningFilter
    first: int
    """Number of its first sample, counted since the board began to send."""


class FilterRuns:
    """Filters the record of a State, once for each set of parameters; what a frame no longer asks for is let go."""

    def __init__(self) -> None:
        self._key: object = None
        self._runs: dict[FilterParams, FilterResult | _LiveRun] = {}
        self._asked: set[FilterParams] = set()

    def begin(self, state: State) -> None:
        """A new frame begins: let go what the last one did not ask for, or everything of another record."""
        key = (state.record_key, state.channel, state.recording.gaps)
        if key != self._key:
            self._key, self._runs = key, {}
        self._runs = {params: run for params, run in self._runs.items() if params in self._asked}
        self._asked = set()

    def of(self, state: State, params: FilterParams | None = None) -> FilterResult:
        """The channel on screen, filtered with `params`, or with the State's own filter."""
        if params is None and state.paper_filter is not None:
            return run_filter(state.recording.channel(state.channel), state.paper_filter, state.dt)
        params = state.params if params is None else params
        self._asked.add(params)
        return self._whole(state, params) if state.live is None else self._grown(state, params)

    def _whole(self, state: State, params: FilterParams) -> FilterResult:
        kept = self._runs.get(params)
        if isinstance(kept, FilterResult):
            return kept
        result = run_filter(state.recording.channel(state.channel), params, state.dt)
        if len(result.x) <= LARGEST_KEPT:
            self._runs[params] = result
        return result

    def _grown(self, state: State, params: FilterParams) -> FilterResult:
        z, n = state.recording.channel(state.channel), len(state.recording)
        snapshot = state.live.snapshot if state.live else None
        first = 0 if snapshot is None else snapshot.first
        run = self._runs.get(params)
        if not isinstance(run, _LiveRun) or not 0 <= first - run.first <= len(run.running) <= first - run.first + n:
            run = self._runs[params] = _LiveRun(RunningFilter(params), first)
        run.running.forget(first - run.first)
        run.first = first
        run.running.extend(z[len(run.running) :])
        return run.running.result
