"""What the person has chosen, as one frozen State; and the changes that can be asked for. No viser here.

Any thread may file a change; only the engine's thread applies it. A change is a function State -> State that
checks every value it was given, because a browser may send anything: it clamps, or raises BadSetting.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from kalscope.errors import BadSetting
from kalscope.model import FilterParams, starting_params
from kalscope.recording import Recording
from kalscope.tuning import ChannelTuning, Tuning

DECADES = {"q": (-8, 3), "r": (-5, 4), "p0": (-6, 6)}
"""Reach of each slider, in decades around the starting r of the channel."""


@dataclass(frozen=True)
class State:
    """All that decides what is on screen."""

    recording: Recording
    """What is open."""
    channel: str
    """The channel on screen, one of recording.names."""
    tunings: tuple[ChannelTuning, ...]
    """The parameters of every channel, in the order of recording.names."""
    starts: tuple[ChannelTuning, ...]
    """What they were when the recording was opened; Reset goes back there."""
    window: tuple[float, float] | None = None
    """First and last moment on screen, s; None = the whole recording."""
    dark: bool = False
    """Dark theme."""
    resets: int = 0
    """How often the view was reset: a new number tells the charts to forget their zoom."""
    note: str = ""
    """One sentence on what the last change did, where that needs saying."""

    @property
    def tuning(self) -> ChannelTuning:
        """Parameters of the channel on screen."""
        return self.tunings[self.recording.index(self.channel)]

    @property
    def params(self) -> FilterParams:
        """The same as the filter takes them."""
        return self.tuning.params

    def with_tuning(self, **values: object) -> State:
        """The state with other parameters for the channel on screen; refused as FilterParams refuses."""
        changed = replace(self.tuning, **values)  # pyright: ignore[reportArgumentType]
        at = self.recording.index(self.channel)
        tunings = (*self.tunings[:at], changed, *self.tunings[at + 1 :])
        return replace(self, tunings=tunings, note="")

    def as_tuning(self) -> Tuning:
        """What the tuning file holds."""
        rec = self.recording
        return Tuning(
            channels=self.tunings,
            source=rec.source,
            source_name=rec.title,
            sha256=rec.sha256,
            sample_period=rec.sample_period,
            selected=self.channel,
        )


Change = Callable[[State], State]


def opened(recording: Recording, before: State | None = None) -> State:
    """A state that looks at a newly opened recording, every channel at its starting values."""
    starts = tuple(starting_tuning(recording, name) for name in recording.names)
    resets = before.resets + 1 if before else 0
    dark = before.dark if before else False
    return State(recording, recording.names[0], starts, starts, dark=dark, resets=resets)


def starting_tuning(recording: Recording, name: str) -> ChannelTuning:
    """R = var(Δz)/2 and q = r/100 of one channel, automatic start."""
    start = starting_params(recording.channel(name))
    unit = recording.units[recording.index(name)]
    return ChannelTuning(name, unit, float(start.q), float(start.r), None, None, "starting values")


def opened_with(recording: Recording, tuning: Tuning, before: State | None = None) -> State:
    """A state at the values of a tuning file: q follows the sample period; channels it lacks start afresh.

    Raises:
        BadSetting: none of the recording's channels is in the file.
    """
    if recording.sample_period is None and tuning.sample_period is not None:
        recording = timed(recording, tuning.sample_period)
    state = opened(recording, before)
    notes: list[str] = []
    if tuning.sha256 and recording.sha256 and tuning.sha256 != recording.sha256:
        notes.append("This recording is not the one the tuning was made on.")
    old, new = tuning.sample_period, recording.sample_period
    if old and new and not math.isclose(old, new, rel_tol=1e-3):
        tuning = tuning.rescaled(new)
        notes.append(f"The sample period is {new:.4g} s, not {old:.4g} s: q was scaled by {new / old:.4g}.")
    given = {channel.name: channel for channel in tuning.channels}
    common = [name for name in recording.names if name in given]
    if not common:
        has, wants = ", ".join(recording.names), ", ".join(given)
        raise BadSetting(f"the recording must have a channel of the tuning, {wants} (got {has})")
    tunings = tuple(given.get(t.name, t) for t in state.tunings)
    channel = tuning.selected if tuning.selected in common else common[0]
    return replace(state, tunings=tunings, channel=channel, note=" ".join(notes))


def timed(recording: Recording, sample_period: float) -> Recording:
    """A recording without time, taken to be sampled every `sample_period` s, > 0; one with time stays as it is."""
    if recording.sample_period is not None:
        return recording
    if not (0.0 < sample_period < math.inf):
        raise BadSetting(f"sample period must be a finite number of seconds above 0 (got {sample_period:g})")
    time = np.arange(len(recording)) * sample_period
    return replace(recording, time=time, sample_period=sample_period)


def set_sample_period(text: str) -> Change:
    """The time between two samples was typed, s, for a recording that does not tell it."""

    def change(state: State) -> State:
        recording = timed(state.recording, parse_number("sample period", text))
        return replace(state, recording=recording, window=None, resets=state.resets + 1)

    return change


def slider_limits(state: State, name: str) -> tuple[int, int]:
    """Lowest and highest exponent of a slider: around the signal's own noise, wider if the value is outside."""
    start = state.starts[state.recording.index(state.channel)]
    centre = round(math.log10(start.r))
    low, high = (centre + reach for reach in DECADES[name])
    value = getattr(state.tuning, name)
    if value:
        low, high = min(low, math.floor(math.log10(value))), max(high, math.ceil(math.log10(value)))
    return max(low, -300), min(high, 300)


def set_exponent(name: str, exponent: float) -> Change:
    """A slider was moved: q, r or p0 becomes 10^exponent; moving p0 means a start by value."""

    def change(state: State) -> State:
        if not math.isfinite(exponent):
            return state
        low, high = slider_limits(state, name)
        value = 10.0 ** min(max(exponent, low), high)
        return state.with_tuning(**{name: float(f"{value:.2e}")}, how="by hand")  # three digits suit a slider

    return change


def set_text(name: str, text: str) -> Change:
    """An exact value was typed for q, r, p0 or x0; an empty or "first" x0 is the first sample."""

    def change(state: State) -> State:
        if name == "x0" and text.strip().lower() in ("", "first"):
            return state.with_tuning(x0=None)
        value = parse_number(name, text)
        if getattr(state.tuning, name) == value:
            return state
        if name == "x0" and state.tuning.p0 is None:
            return state.with_tuning(x0=value, p0=state.tuning.r, how="by hand")
        return state.with_tuning(**{name: value}, how="by hand")

    return change


def set_automatic_start(automatic: bool) -> Change:
    """Automatic (diffuse) start at the first sample, or p0 and x0 by value, beginning with p0 = r."""

    def change(state: State) -> State:
        if automatic == (state.tuning.p0 is None):
            return state
        return state.with_tuning(p0=None if automatic else max(state.tuning.r, 1e-300), x0=None)

    return change


def reset_parameters(state: State) -> State:
    """Back to the starting values of the channel."""
    start = state.starts[state.recording.index(state.channel)]
    return state.with_tuning(q=start.q, r=start.r, p0=start.p0, x0=start.x0, how=start.how)


def select_channel(name: str) -> Change:
    """Look at another channel, with its own parameters."""

    def change(state: State) -> State:
        state.recording.index(name)
        return state if name == state.channel else replace(state, channel=name, resets=state.resets + 1, note="")

    return change


def set_window(first: float, last: float) -> Change:
    """Show the recording from `first` to `last`, s; at least ten samples; the whole of it is None."""

    def change(state: State) -> State:
        t = state.recording.time
        begin, end = float(t.min()), float(t.max())
        if not (math.isfinite(first) and math.isfinite(last)):
            return state
        low, high = sorted((min(max(first, begin), end), min(max(last, begin), end)))
        least = 10.0 * (state.recording.sample_period or 1.0)
        if high - low < least:
            low, high = max(begin, min(low, end - least)), min(end, max(high, low + least))
        window = None if low <= begin and high >= end else (low, high)
        return state if window == state.window else replace(state, window=window)

    return change


def reset_view(state: State) -> State:
    """Show the whole recording and forget the zoom."""
    return replace(state, window=None, resets=state.resets + 1)


def follow_end(state: State) -> State:
    """Move the window, at its present length (a tenth of the recording if it shows all), to the end."""
    t = state.recording.time
    begin, end = float(t.min()), float(t.max())
    length = state.window[1] - state.window[0] if state.window else (end - begin) / 10.0
    return replace(set_window(end - length, end)(state), resets=state.resets + 1)


def set_dark(dark: bool) -> Change:
    """Dark or light theme."""
    return lambda state: replace(state, dark=bool(dark))


def parse_number(name: str, text: str) -> float:
    """The number in a text box; decimal comma allowed.

    Raises:
        BadSetting: it is no number.
    """
    try:
        value = float(text.strip().replace(",", "."))
    except ValueError:
        raise BadSetting(f"{name} must be a number such as 0.01 or 1e-9 (got {text[:40]!r})") from None
    if not math.isfinite(value):
        raise BadSetting(f"{name} must be a finite number (got {text[:40]!r})")
    return value


@dataclass(frozen=True)
class _Request:
    serial: int
    due: float
    key: str
    change: Change


class Session:
    """The State and the changes that wait for the engine. `bell` rings when there is something to do."""

    def __init__(self, state: State) -> None:
        self._state = state
        self._lock = threading.Lock()
        self._waiting: list[_Request] = []
        self._serial = 0
        self.bell = threading.Event()

    def request(self, change: Change, *, key: str = "", delay: float = 0.0) -> int:
        """File a change and return its serial number; frames tell up to which serial all is in them.

        Args:
            change: applied later by the engine.
            key: a later request with the same key replaces one that still waits.
            delay: seconds to wait first, so that typing may go on.
        """
        with self._lock:
            self._serial += 1
            if key:
                self._waiting = [waiting for waiting in self._waiting if waiting.key != key]
            self._waiting.append(_Request(self._serial, time.monotonic() + delay, key, change))
            serial = self._serial
        self.bell.set()
        return serial

    def seconds_to_next(self) -> float | None:
        """Seconds until the next waiting change is due; None if none waits."""
        with self._lock:
            if not self._waiting:
                return None
            return max(0.0, min(waiting.due for waiting in self._waiting) - time.monotonic())

    def settle(self) -> tuple[State, int, list[Exception]]:
        """Apply what is due, in order; a change that fails leaves the state as it was.

        Returns the state, the serial up to which every request was seen, and what failed.
        """
        now = time.monotonic()
        with self._lock:
            due = [waiting for waiting in self._waiting if waiting.due <= now]
            self._waiting = [waiting for waiting in self._waiting if waiting.due > now]
            serial = min((waiting.serial for waiting in self._waiting), default=self._serial + 1) - 1
        failures: list[Exception] = []
        for waiting in due:
            try:
                self._state = waiting.change(self._state)
            except Exception as error:  # whatever it was, the dashboard goes on and says so
                failures.append(error)
        return self._state, serial, failures
