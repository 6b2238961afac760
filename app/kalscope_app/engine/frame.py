"""Session state -> Frame: every array to draw and every number to show, computed once. Pure; no viser here."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope.common.numbers import Array
from kalscope.filtering.filter import FilterResult, smooth, was_rejected
from kalscope.filtering.steady import SteadyState
from kalscope.sources.live.source import LiveStatus
from kalscope_app.engine.filter_runs import DrawnSamples, FilterRuns
from kalscope_app.session.state import NO_CONNECTION, ConnectionState, Fusion, State

GAIN_POINTS = 500
"""Most points drawn of the gain; its start-up is smooth."""

SMOOTHED_BEFORE = 5000
"""How many samples before a live window its smoother starts."""


@dataclass(frozen=True)
class SensorCurve:
    """One of the sensors that are fused, at the samples drawn."""

    name: str
    """Its channel."""
    colour: int
    """Its index among all sensors, dropped or not: a sensor keeps its colour."""
    raw: Array
    """Its readings, or where sensors have gains the quantity they imply, unit; NaN = missing, shape (m,)."""
    difference: Array
    """The quantity they imply minus the fused value, unit; NaN where missing, shape (m,)."""


@dataclass(frozen=True)
class Frame:
    """What every view draws; arrays have shape (m,), one value per sample drawn, unless stated otherwise."""

    state: State
    """The choices that this frame shows."""
    serial: int
    """Every request up to this number is in it."""
    drawn: DrawnSamples
    """Which samples are drawn, with what does not depend on the parameters: time, raw, truth."""
    steady: SteadyState
    """The filter in steady state: gain, lag, noise reduction, bandwidth."""
    filtered: Array
    """Filtered signal, unit; NaN before the first sample."""
    spread: Array
    """2·√p, unit: the band around the filtered signal; inf before a diffuse start."""
    smoothed: Array | None
    """The best possible offline estimate, unit; None unless asked for."""
    rejected: int
    """Samples that the outlier gate rejected, in the whole recording."""
    innovation: Array
    """Measurement minus prediction, unit; NaN where there is none."""
    innovation_spread: Array
    """2·√s, unit."""
    start_up: int
    """Samples until the gain is within 1 % of where it settles, from the first measurement on."""
    gain: Array
    """Gain of the first samples, shape (g,), at most 500 of them."""
    gain_samples: Array
    """Sample numbers of `gain`, shape (g,)."""
    board: Array | None = None
    """What the board's own filter sent, unit; None without such a channel."""
    board_difference: float = math.nan
    """Largest |board's − ours| in the window, unit; NaN where there is none."""
    connection: ConnectionState = NO_CONNECTION
    """The state of the connection to the live board."""
    velocity: Array | None = None
    """Filtered velocity, unit per s, or per sample without a sample period; None where not wanted or not known."""
    moving: Array | None = None
    """With two speeds, the probability that the signal moves; None with one."""
    velocity_spread: Array | None = None
    """2·√ of its variance, in the same unit."""
    set_aside: Array | None = None
    """The measurements that the last search set aside as spikes, unit, NaN at all others; None where none were."""
    refused: Array | None = None
    """The measurements that the gate rejected, unit, NaN at all others; None without one, or of fused sensors."""
    sensors: tuple[SensorCurve, ...] = ()
    """The readings of the sensors that are fused, the noisiest first; empty where one channel is filtered."""
    variants: tuple[Array, ...] = ()
    """The filtered signal of each pinned setting, in the order of `state.variants`, unit."""

    @property
    def status(self) -> LiveStatus | None:
        """The status of the board on screen; None for a finished recording."""
        return None if self.state.live is None else self.connection.status


def compute_frame(
    state: State, serial: int = 0, runs: FilterRuns | None = None, connection: ConnectionState = NO_CONNECTION
) -> Frame:
    """Filter the channel on screen over the whole recording and pick what is drawn.

    Args:
        state: what to show.
        serial: the requests that are in it.
        runs: the runs of earlier frames; None = filter again.
        connection: the state of the connection to the live board.
    """
    recording = state.recording
    runs = runs or FilterRuns()
    runs.begin(state)
    drawn = runs.choose(state)
    (result, gain, whole), at = runs.drawn(state, drawn), drawn.indices
    steady = runs.settled(state, whole or result)
    start_up = samples_to_settle(gain, len(recording), steady.gain) if state.has_gain else 0
    gain_samples = gain_axis(start_up, len(recording))
    board = None if state.board is None else recording.channel(state.board)
    velocity, velocity_spread = _velocity(state, result)
    aside, gated = state.set_aside, state.uses_parameters and state.tuning.gate is not None and not state.fusion
    return Frame(
        state=state,
        serial=serial,
        drawn=drawn,
        steady=steady,
        filtered=result.x,
        spread=2.0 * np.sqrt(result.p),
        smoothed=_smoothed(state, drawn) if state.view.smoother and state.filter.is_standard else None,
        sensors=() if state.fusion is None else _sensors(state, state.fusion, drawn, result.x),
        rejected=int(np.sum(result.rejected)),
        innovation=result.innovation,
        innovation_spread=2.0 * np.sqrt(result.s),
        start_up=start_up,
        gain=gain(int(gain_samples[-1]) + 1)[gain_samples],
        gain_samples=gain_samples.astype(np.float64),
        board=None if board is None else board[at],
        board_difference=_largest_difference(board, whole, drawn),
        connection=connection,
        velocity=velocity,
        moving=result.moving,
        velocity_spread=velocity_spread,
        set_aside=None if aside is None else np.where(aside[at], drawn.raw, np.nan),
        refused=np.where(was_rejected(result.k, result.p, result.innovation), drawn.raw, np.nan) if gated else None,
        variants=runs.variants(state, drawn),
    )


def _smoothed(state: State, drawn: DrawnSamples) -> Array:
    """The best possible offline estimate at the drawn samples; of a live record from a little before the window."""
    first = 0 if state.live is None else max(0, drawn.first - SMOOTHED_BEFORE)
    last = len(state.recording) if state.live is None else drawn.last
    dt = None if state.dt is None else state.dt[first:last]
    return smooth(state.readings[first:last], state.running.params, dt).x[drawn.indices - first]


def _sensors(state: State, fusion: Fusion, drawn: DrawnSamples, fused: Array) -> tuple[SensorCurve, ...]:
    """What the sensors in use read at the drawn samples, and how far from the fused value that is.

    The noisiest comes first, to be drawn below the others; by the noise that was found, so no slider reorders them.
    """
    params = fusion.used.params
    columns = [state.recording.index(name) for name in fusion.used.sensors]
    raw = state.recording.values[drawn.indices][:, columns]
    values = (raw - params.offset) / params.gain
    difference = values - fused[:, None]
    if np.any(params.gain != 1.0):
        raw = values  # sensors of several scales or units have no common axis
    noise = dict(zip(fusion.start.sensors, fusion.start.params.scaled_r, strict=True))
    curves = [
        SensorCurve(name, fusion.tuning.sensors.index(name), raw[:, i], difference[:, i])
        for i, name in enumerate(fusion.used.sensors)
    ]
    return tuple(sorted(curves, key=lambda one: -noise[one.name]))


def _velocity(state: State, result: FilterResult) -> tuple[Array | None, Array | None]:
    """The velocity and its 2·√variance at the drawn samples, where they are wanted and the filter has them."""
    if not state.view.velocity or result.velocity is None or result.velocity_p is None:
        return None, None
    rate = 1.0 / (state.recording.sample_period or 1.0)
    return rate * result.velocity, 2.0 * rate * np.sqrt(result.velocity_p)


def _largest_difference(board: Array | None, run: FilterResult | None, drawn: DrawnSamples) -> float:
    """Largest |board − x| in the window; NaN where the board has sent nothing there."""
    if board is None or run is None:
        return math.nan
    window = slice(drawn.first, drawn.last)
    return float(np.fmax.reduce(np.abs(board[window] - run.x[window]), initial=np.nan))


def samples_to_settle(gain: Callable[[int], Array], n: int, settled_gain: float) -> int:
    """Samples until the gain first comes within 1 % of the settled gain; the whole record if it never does.

    Args:
        gain: returns the gain of the first n samples.
        n: samples of the record.
        settled_gain: the gain in steady state.
    """
    size = 1024
    while True:  # look at a short beginning first: a million samples settle as early as a thousand do
        close = np.abs(gain(size) - settled_gain) <= 0.01 * settled_gain
        if close.any():
            return int(np.argmax(close))
        if size >= n:
            return n
        size *= 8


def gain_axis(start_up: int, n: int) -> NDArray[np.intp]:
    """Sample numbers for the gain chart: twice the start-up, rounded to 1, 2, 5 × 10^k for a steady axis."""
    wanted = max(20, 2 * start_up)
    decade = 10 ** math.floor(math.log10(wanted))
    count = min(n, next(step * decade for step in (1, 2, 5, 10) if step * decade >= wanted))
    return np.unique(np.asarray(np.linspace(0, count - 1, min(count, GAIN_POINTS)), dtype=np.intp))
