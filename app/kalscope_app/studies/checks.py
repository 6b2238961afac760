"""Idle-time computations on the filter on screen: checks, spectra, the fusion, the momentum, the board."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from kalscope.analysis.diagnostics import Diagnostics, diagnose_held_out, diagnose_run, without_residuals
from kalscope.analysis.findings import request_in, still_met
from kalscope.analysis.fused import judge_fusion
from kalscope.analysis.judge import Judgement, judge, needs_noise, with_momentum, with_notch, with_two_speeds
from kalscope.analysis.residuals import Run
from kalscope.analysis.spectrum import AllanDeviation, Spectrum, allan_deviation, magnitude_response, spectrum
from kalscope.common.numbers import Array
from kalscope.estimation.fit import estimate
from kalscope.estimation.hum import find_line
from kalscope.estimation.request import BEST_FIT
from kalscope.estimation.settings import momentum_gain
from kalscope.estimation.still import find_still_stretch
from kalscope.estimation.two_speeds import TwoSpeeds, clear_two_speeds
from kalscope.export.board import BoardCheck, check_board
from kalscope.filtering.params import FilterParams
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.session.opening import NOT_FITTED
from kalscope_app.session.state import Fusion, State

# The still stretch of the channel on screen, found once for each recording.


Stretch = tuple[int, int] | None
"""First sample and one past the last; None = there is none."""


def still_stretch(state: State, kept: Cache[Stretch]) -> Stretch:
    """The stretch of the channel on screen; none of a live record, which changes all the time."""
    if state.live is not None:
        return None
    scope = state.recording, state.channel, state.recording.gaps
    return kept.once(lambda: find_still_stretch(state.z, state.dt), *scope)


def two_speeds_in(state: State, kept: Cache[TwoSpeeds | None]) -> TwoSpeeds | None:
    """Two speeds of the channel on screen where they are clear; None otherwise, and of a live record."""
    if state.live is not None:
        return None
    steps, first = np.empty(0) if state.dt is None else state.dt, state.first.estimate
    return kept.once(lambda: clear_two_speeds(first, state.z, steps), state.recording, state.channel, first)


# Whether the live board computes what the screen shows: an idle-time computation.


def compare_with_board(state: State) -> BoardCheck | None:
    """The board's rows since it took the setting beside ours; None where there are none to compare."""
    sent = state.sent
    snapshot = state.live.snapshot if state.live is not None else None
    if sent is None or snapshot is None:
        return None
    if (sent.record, sent.channel) != (state.record_key, state.channel) or snapshot.first > sent.row:
        return None
    rows = slice(sent.row - snapshot.first, None)
    recording = snapshot.recording
    return check_board(recording.channel(sent.channel)[rows], recording.channel(sent.filtered)[rows], sent.params)


# What the fused value is worth, and which sensor disagrees: an idle-time computation.


@dataclass(frozen=True)
class Judged:
    """The judgement of the fused sensors on screen; plain text, with names from outside."""

    judgement: Judgement
    """What fusing brings, and the faults of the sensors."""
    notes: tuple[str, ...]
    """What was found on a held-out stretch, and what cannot be known."""


def judge_sensors(state: State, kept: Cache[Judgement]) -> Judged | None:
    """The verdict on the fused sensors on screen, in words; None where one channel is on screen.

    `kept` has the verdict while only the view changes.
    """
    fusion = state.fusion
    if fusion is None:
        return None
    kept.begin(state.recording, fusion.used.sensors, state.recording.gaps)
    judgement = kept.get(fusion.used.params, lambda: _verdict(state, fusion))
    notes, found = [judgement.second_half], fusion.estimate
    if found is not None:
        notes += ["" if found.verdict == "ok" or fusion.dropped else found.message, *found.notes]
    return Judged(judgement, tuple(filter(None, notes)))


def _verdict(state: State, fusion: Fusion) -> Judgement:
    found = None if fusion.dropped else fusion.estimate
    return judge_fusion(
        state.readings,
        fusion.used.params if found is None else replace(found, params=fusion.used.params),
        state.dt,
        names=fusion.used.sensors,
        unit=fusion.tuning.unit,
        sample_period=state.recording.sample_period,
    )


# Spectra and Allan deviations of raw and filtered signal, for their charts.


BINS = 240
"""Points that a density or a response is drawn with, at most about."""


MAX_BELOW = 30.0
"""How far below the lowest frequency of the record a cut-off may lie to be drawn, as a ratio."""


@dataclass(frozen=True)
class Spectra:
    """What the spectrum tab draws."""

    state: State
    """The choices it belongs to."""
    found: Spectrum
    """All of it."""
    frequency: Array
    """Frequencies of the density chart, log-spaced, shape (b,)."""
    densities: tuple[Array, Array, Array]
    """Raw, filtered, residual there, averaged over each bin."""
    fine: Array
    """Frequencies of the response chart, with the cut-off among them, shape (f,)."""
    response_db: Array
    """20·log10|H| there, dB."""


def compute_spectra(state: State) -> Spectra | None:
    """Densities and response of the channel on screen; None where its filter has no one response."""
    if not state.has_one_speed:
        return None
    period = state.recording.sample_period
    found = spectrum(state.z, state.params, state.dt, period)
    frequency, raw, filtered, residual = log_binned(
        found.frequency, [found.raw, found.filtered, found.residual], BINS
    )
    fine = np.empty(0)
    if found.samples:  # those of the record, and from half the cut-off on where that lies a little below them
        low, high = float(found.frequency[0]), float(found.frequency[-1])
        low = 0.5 * found.cutoff if low / MAX_BELOW < found.cutoff < 2.0 * low else low
        fine = np.geomspace(low, high, BINS)
        fine = np.union1d(fine, found.cutoff) if low < found.cutoff < high else fine
    response = magnitude_response(state.params, fine * (period or 1.0))
    decibel = 20.0 * np.log10(np.maximum(response, 1e-20))
    return Spectra(state, found, frequency, (raw, filtered, residual), fine, decibel)


def log_binned(x: Array, ys: list[Array], bins: int) -> tuple[Array, ...]:
    """Means of x > 0, ascending, and of each y over bins of equal ratio; bins without a point are left out."""
    if len(x) <= bins:
        return (x, *ys)
    edges: Array = np.geomspace(float(x[0]), float(x[-1]) * (1 + 1e-12), bins + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, bins - 1)
    counts = np.bincount(place, minlength=bins)
    full = counts > 0
    return tuple(np.bincount(place, weights=y, minlength=bins)[full] / counts[full] for y in (x, *ys))


def compute_allan(state: State) -> tuple[State, AllanDeviation | None]:
    """Allan deviation of the channel on screen, and its state; None where its filter has no one model."""
    known = state.has_one_speed
    return state, allan_deviation(state.z, state.params, state.recording.sample_period) if known else None


# State -> Checks: an idle-time computation, because it takes longer than a frame.


@dataclass(frozen=True)
class Checks:
    """How well the filter on screen describes the channel on screen."""

    state: State
    """The choices that were checked."""
    all_samples: Diagnostics
    """Of the whole recording."""
    held_out: Diagnostics
    """Of its second half."""
    fitted_on_first_half: bool
    """Whether q and r were estimated again on the first half for that, because they come from an estimate."""
    judgement: Judgement
    """Whether it fits, and what to do."""
    search: Judgement | None = None
    """What to do after a search that found no pair and changed nothing; None where the last one found one."""

    @property
    def urgent(self) -> Judgement:
        """What the control panel says: first that of a search that failed."""
        return self.search or self.judgement


def compute_checks(
    state: State,
    still: Callable[[State], Stretch] = lambda _state: None,
    speeds: Callable[[State], TwoSpeeds | None] = lambda _state: None,
) -> Checks | None:
    """Diagnose the channel on screen; None where its filter has no q and r to judge, or these are still to come.

    Args:
        state: what is on screen.
        still: finds a still stretch, which is asked for only where it would help.
        speeds: finds two speeds, as rarely.
    """
    if not state.is_standard or state.tuning.how == NOT_FITTED:
        return None
    z, dt = state.z, state.dt
    whole = diagnose_run(Run.of_samples(z, state.params, dt))
    # q and r that were fitted to the whole recording have seen the second half: estimate again, on the first.
    estimated = state.tuning.how == BEST_FIT

    def fit(first: Array, dt: Array | None) -> FilterParams:
        return estimate(first, dt=dt, momentum=state.tuning.momentum).params or state.params

    held_out = diagnose_held_out(z, fit if estimated else state.params, dt)
    judgement, search = _of_filter(state, whole, held_out, still), _of_search(state, still)
    if judgement.tone != "good" and state.has_one_speed and judgement.status != "as_chosen":
        judgement = with_two_speeds(judgement, speeds(state))
    if state.live is None:
        judgement = with_notch(judgement, find_line(z, dt), state.recording.sample_period)
    whole, held_out = without_residuals(whole), without_residuals(held_out)
    judgement = replace(judgement, residuals=whole, held_out=held_out)  # without the arrays of all samples
    return Checks(state, whole, held_out, estimated, judgement, search)


def _of_filter(
    state: State, whole: Diagnostics, held_out: Diagnostics, still: Callable[[State], Stretch]
) -> Judgement:
    """The one judgement of the filter on screen, with all that is known about it."""
    tuning, outcome = state.tuning, state.outcome
    outcome = outcome if outcome and outcome.after is not None else None
    estimate = outcome.estimate if outcome is not None and outcome.after == tuning else None
    asked = request_in(tuning.how, tuning.r) if outcome is None else outcome.request
    request = still_met(asked, state.params, state.recording.sample_period)
    one = judge(
        whole,
        held_out,
        estimate,
        request=request,
        still=still(state) if needs_noise(estimate) else None,
        unit=state.recording.units[state.index],
    )
    best = None if request is not None and request.goal else state.first.estimate
    if best is None:
        return one
    return with_momentum(one, float(best.momentum), momentum_gain(state.z, state.dt, state.params, best))


def _of_search(state: State, still: Callable[[State], Stretch]) -> Judgement | None:
    """What the last search says where it found no pair for what is on screen."""
    found = state.searched
    if found is None or found.after is not None or found.estimate is None:
        return None
    stretch = still(state) if needs_noise(found.estimate) else None
    return judge(None, estimate=found.estimate, still=stretch)
