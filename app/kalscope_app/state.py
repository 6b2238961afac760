"""What the person has chosen, as one frozen State, and how a newly opened recording begins. No viser here."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from kalscope.errors import BadSetting
from kalscope.estimation import Estimate
from kalscope.experiments import GeneralizedParams, open_experiment
from kalscope.filter_choice import adapt_tuning
from kalscope.model import FilterParams, starting_params
from kalscope.recording import Recording
from kalscope.sources.read_options import DEFAULTS, ReadOptions
from kalscope.tuning import ChannelTuning, Tuning
from kalscope_app.together import ALONE, in_step
from kalscope_app.variants import Variant

if TYPE_CHECKING:
    from kalscope_app.board import Sent
    from kalscope_app.live import Live

DECADES = {"q": (-8, 3), "r": (-5, 4), "p0": (-6, 6)}
"""Reach of each slider, in decades around the starting r of the channel."""

MAP_COLOURS: tuple[str, ...] = ("likelihood", "RMSE", "lag")
"""What the tuning map may be coloured by; RMSE where the truth is known."""

VIEW = ("dark", "map_shown", "map_colour", "smoother", "match", "rival", "way", "preset")
"""Fields of State that say how it is looked at; they outlive the recording, and Undo leaves them alone."""


@dataclass(frozen=True)
class Outcome:
    """What the last search for q and r gave on one channel."""

    how: str
    """How it was searched, in a few words."""
    message: str
    """What was found and what it means."""
    before: ChannelTuning
    """The parameters before."""
    after: ChannelTuning | None
    """The parameters now; None where nothing usable was found and nothing changed."""


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
    rules: tuple[GeneralizedParams | None, ...] = ()
    """The second paper's filter in place of the five lines, by channel; None or absent = the five lines."""
    window: tuple[float, float] | None = None
    """First and last moment on screen, s; None = the whole recording."""
    outcome: Outcome | None = None
    """The last search on this channel."""
    opinions: tuple[Estimate, ...] = ()
    """What the five methods say of this channel, once asked."""
    way: str = "maximum likelihood"
    """How q and r are searched, one of the ways of the dashboard."""
    match: Literal["lag", "noise"] = "lag"
    """What simpler filters are made equal in."""
    rival: str = "Moving average"
    """The simpler filter that is drawn beside the present one; any other word draws all."""
    smoother: bool = False
    """Whether the best possible offline curve is drawn."""
    dark: bool = False
    """Dark theme."""
    map_shown: bool = True
    """Whether the tuning map is shown where the window has room for it."""
    map_colour: str = "likelihood"
    """What the tuning map is coloured by, one of MAP_COLOURS."""
    resets: int = 0
    """How often the view was reset: a new number tells the charts to forget their zoom."""
    pins: tuple[Variant, ...] = ()
    """Settings that were pinned, of every channel; `variants` are those of the channel on screen."""
    together: str = ALONE
    """Whether the other channels follow the one on screen, one of `together.WAYS`."""
    preset: str = ""
    """Title of the preset that is looked at; "" = the first."""
    options: ReadOptions = DEFAULTS
    """What the person decided about reading the file."""
    typed_period: float | None = None
    """The sample period that the person gave, s; None = as the recording tells."""
    note: str = ""
    """One sentence on what the last change did, where that needs saying."""
    board_choice: str | None = ""
    """The channel said to be the board's own filtered curve; "" = by its name, None = there is none."""
    sent: Sent | None = None
    """What was last sent to the live board; None = nothing yet."""
    live: Live | None = None
    """The live board that the recording grows from; None for a finished recording."""

    def seen_as(self, other: State) -> State:
        """The state in the view of another: theme, map, what is drawn beside the signal, what is asked for."""
        return replace(self, **{name: getattr(other, name) for name in VIEW})

    @property
    def tuning(self) -> ChannelTuning:
        """Parameters of the channel on screen."""
        return self.tunings[self.recording.index(self.channel)]

    @property
    def params(self) -> FilterParams:
        """The same as the filter takes them."""
        return self.tuning.params

    @property
    def variants(self) -> tuple[Variant, ...]:
        """The pinned settings of the channel on screen, in the order in which they were pinned."""
        return tuple(variant for variant in self.pins if variant.tuning.name == self.channel)

    @property
    def rule(self) -> GeneralizedParams | None:
        """The second paper's filter, where the channel on screen runs it."""
        return self.rules[self.recording.index(self.channel)] if self.rules else None

    @property
    def dt(self) -> NDArray[np.float64] | None:
        """Nominal periods before each sample, where gaps in time were asked to count; else None."""
        return self.recording.steps() if self.recording.gaps == "dt" else None

    @property
    def board(self) -> str | None:
        """The channel with the board's own filtered curve, drawn beside ours; None = there is none."""
        names = self.recording.names
        if self.board_choice != "":
            return self.board_choice if self.board_choice in names else None
        own = "filtered" if self.channel == "raw" else f"{self.channel}_filtered"  # as the exported sketch says
        return own if own in names else None

    @property
    def record_key(self) -> tuple[int, int]:
        """What identifies the record while it is open; a live one stays the same while it grows."""
        return (id(self.recording), 0) if self.live is None else self.live.key

    def continues(self, recording: Recording) -> bool:
        """Whether what is open is this recording, or a live one that has grown from it."""
        if self.live is None:
            return self.recording is recording
        ours = self.recording
        return (ours.source, ours.title, ours.names) == (recording.source, recording.title, recording.names)

    def with_rule(self, rule: GeneralizedParams | None) -> State:
        """The state with another filter for the channel on screen."""
        rules = list(self.rules or (None,) * len(self.tunings))
        rules[self.recording.index(self.channel)] = rule
        return replace(self, rules=tuple(rules), outcome=None, note="")

    def with_tuning(self, **values: object) -> State:
        """The state with other parameters for the channel on screen; refused as FilterParams refuses."""
        changed = replace(self.tuning, **values)  # pyright: ignore[reportArgumentType]
        at = self.recording.index(self.channel)
        tunings = (*self.tunings[:at], changed, *self.tunings[at + 1 :])
        tunings = in_step(tunings, self.starts, at, self.together)
        same = (changed.q, changed.r) == (self.tuning.q, self.tuning.r)
        return replace(self, tunings=tunings, outcome=self.outcome if same else None, note="")

    def check_five_lines(self, names: Iterable[str]) -> None:
        """BadSetting where one of these channels runs the second paper's filter, which leaves only as a picture."""
        other = [name for name in names if self.rules and self.rules[self.recording.index(name)] is not None]
        if other:
            raise BadSetting(
                "what is exported must be the filter with q and r: choose it under Tune first (got the second"
                f" paper's filter on {', '.join(other)[:100]})"
            )

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


def opened(recording: Recording, before: State | None = None) -> State:
    """A state that looks at a newly opened recording, every channel at its starting values."""
    starts = tuple(starting_tuning(recording, name) for name in recording.names)
    resets = before.resets + 1 if before else 0
    fresh = State(recording, recording.names[0], starts, starts, resets=resets)
    if before is None:
        return fresh
    return fresh.seen_as(before)


def starting_tuning(recording: Recording, name: str) -> ChannelTuning:
    """R = var(Δz)/2 and q = r/100 of one channel, automatic start."""
    start = starting_params(recording.channel(name))
    unit = recording.units[recording.index(name)]
    return ChannelTuning(name, unit, float(start.q), float(start.r), None, None, "starting values")


def reopened(recording: Recording, before: State) -> State:
    """A state that looks at a recording read again: what was tuned by name stays.

    Of another recording pinned settings stay where name and unit of the channel agree: the next log of one sensor.
    """
    state = opened(recording, before)
    old = before.recording
    if (recording.source, recording.title) != (old.source, old.title):
        units = dict(zip(recording.names, recording.units, strict=True))
        pins = tuple(one for one in before.pins if units.get(one.tuning.name) == one.tuning.unit)
        said = "Pinned settings stay on channels of the same name and unit." if pins else ""
        return replace(state, pins=pins, note=said)
    known = {now.name: now for now, start in zip(before.tunings, before.starts, strict=True) if now != start}
    tunings = tuple(known.get(tuning.name, tuning) for tuning in state.tunings)
    channel = before.channel if before.channel in recording.names else state.channel
    pins = tuple(variant for variant in before.pins if variant.tuning.name in recording.names)
    return replace(state, tunings=tunings, channel=channel, pins=pins, together=before.together)


def opened_with(recording: Recording, tuning: Tuning, before: State | None = None) -> State:
    """A state at the values of a tuning file; what had to be adapted is said in its note.

    Raises:
        BadSetting: none of the recording's channels is in the file.
    """
    typed_period = None
    if recording.sample_period is None and tuning.sample_period is not None:
        typed_period = tuning.sample_period
        recording = timed(recording, typed_period)
    adapted, notes = adapt_tuning(recording, tuning)
    state = opened(recording, before)
    units = dict(zip(recording.names, recording.units, strict=True))
    tunings = tuple(
        replace(adapted[t.name], name=t.name, unit=units[t.name]) if t.name in adapted else t for t in state.tunings
    )
    channel = tuning.selected if tuning.selected in adapted else next(iter(adapted))
    note = " ".join(f"{note[:1].upper()}{note[1:]}." for note in notes)
    return replace(state, tunings=tunings, channel=channel, typed_period=typed_period, note=note)


def opened_experiment(name: str, before: State | None = None) -> State:
    """A state that looks at a figure of a source document, at that figure's settings.

    Raises:
        BadSetting: no such experiment.
    """
    recording, settings = open_experiment(name)
    state = opened(recording, before)
    chosen = [settings[channel] for channel in recording.names]
    tunings = tuple(map(_tuning_of, state.tunings, chosen))
    rules = tuple(s if isinstance(s, GeneralizedParams) else None for s in chosen)
    return replace(state, tunings=tunings, starts=tunings, rules=rules)


def _tuning_of(start: ChannelTuning, settings: FilterParams | GeneralizedParams) -> ChannelTuning:
    """Five-line parameters of a figure; the starting values where the figure has another filter."""
    if isinstance(settings, GeneralizedParams):
        return start
    p0, x0 = (None if value is None else float(value) for value in (settings.p0, settings.x0))
    return ChannelTuning(start.name, start.unit, float(settings.q), float(settings.r), p0, x0, "source document")


def timed(recording: Recording, sample_period: float) -> Recording:
    """A recording without time, taken to be sampled every `sample_period` s, > 0; one with time stays as it is."""
    if recording.sample_period is not None:
        return recording
    if not (0.0 < sample_period < math.inf):
        raise BadSetting(f"sample period must be a finite number of seconds above 0 (got {sample_period:g})")
    time = np.arange(len(recording)) * sample_period
    return replace(recording, time=time, sample_period=sample_period)


def slider_limits(state: State, name: str) -> tuple[int, int]:
    """Lowest and highest exponent of a slider: around the signal's own noise, wider if the value is outside."""
    start = state.starts[state.recording.index(state.channel)]
    centre = round(math.log10(start.r))
    low, high = (centre + reach for reach in DECADES[name])
    value = getattr(state.tuning, name)
    if value:
        low, high = min(low, math.floor(math.log10(value))), max(high, math.ceil(math.log10(value)))
    return max(low, -300), min(high, 300)
