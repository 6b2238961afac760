"""What the user has chosen, as one frozen State. No viser here."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Protocol

from kalscope.errors import BadSetting
from kalscope.sources.lines.read_options import DEFAULTS, ReadOptions
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.session.linked_channels import ALONE, in_step

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import numpy as np
    from numpy.typing import NDArray

    from kalscope.estimation.result import Estimate
    from kalscope.export.float32 import Float32Params
    from kalscope.filtering.params import FilterParams
    from kalscope.papers.generalized_filter import GeneralizedParams
    from kalscope.recording import Recording
    from kalscope.sources.live.live_samples import Snapshot
    from kalscope.sources.live.live_status import LiveStatus
    from kalscope_app.session.variants import Variant

FIRST_SPAN = 10.0
"""Length that it begins with, s."""


class Feed(Protocol):
    """What a live source offers to the dashboard; `LiveSource` is one."""

    def snapshot(self) -> Snapshot | None:
        """What is kept, or None before the first sample."""
        ...

    def status(self) -> LiveStatus:
        """How the connection is."""
        ...


@dataclass(frozen=True)
class Live:
    """The live part of a State."""

    feed: Feed
    """Where the samples come from."""
    snapshot: Snapshot | None = None
    """The record as it was last looked at; None before the first samples."""
    span: float = FIRST_SPAN
    """Length of the window that follows the newest sample, s; inf = all that is kept."""
    following: bool = True
    """Whether the window follows; looking back ends that."""
    paused: bool = False
    """Whether the screen stands still while samples still come in."""
    settled: bool = False
    """Whether the starting values have been measured."""
    wanted: tuple[Callable[[State], State], ...] = ()
    """What the command line asked for, done once the channels and the starting values are known."""

    @property
    def key(self) -> tuple[int, int]:
        """What stays the same while the record only grows: the feed and its layout."""
        return id(self.feed), -1 if self.snapshot is None else self.snapshot.generation


@dataclass(frozen=True)
class Sent:
    """A setting that a board has taken."""

    record: tuple[int, int]
    """The live record that it belongs to."""
    channel: str
    """The channel that was tuned."""
    filtered: str
    """The channel in which the board sends what its filter makes of it."""
    asked: FilterParams
    """What was on screen when it was sent."""
    params: Float32Params
    """What the board says it uses, exact."""
    row: int
    """Number of the first sample after the board was asked to start anew, counted since it began to send."""


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


def slider_limits(state: State, name: str) -> tuple[int, int]:
    """Lowest and highest exponent of a slider: around the signal's own noise, wider if the value is outside."""
    start = state.starts[state.recording.index(state.channel)]
    centre = round(math.log10(start.r))
    low, high = (centre + reach for reach in DECADES[name])
    value = getattr(state.tuning, name)
    if value:
        low, high = min(low, math.floor(math.log10(value))), max(high, math.ceil(math.log10(value)))
    return max(low, -300), min(high, 300)
