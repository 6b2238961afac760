"""What the user has chosen, as one frozen State of a few small values."""

from __future__ import annotations

import math
import string
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from typing import TYPE_CHECKING, Any, Concatenate, Literal, ParamSpec

import numpy as np
from numpy.typing import NDArray

from kalscope.common.numbers import Array, Indices
from kalscope.common.text import trimmed
from kalscope.errors import BadSetting
from kalscope.estimation.request import FitResult
from kalscope.estimation.result import Estimate
from kalscope.export.board import Calibrated, Measurement
from kalscope.export.float32 import Float32Params
from kalscope.filtering.classic import OneEuro
from kalscope.filtering.filter import Filter
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.live.samples import Snapshot
from kalscope.sources.live.source import LiveSource, LiveStatus
from kalscope.tuning.tuning import ChannelTuning, Tuning

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet


# How the open recording is shown.


@dataclass(frozen=True)
class View:
    """How it is shown. It outlives the recording, and Undo does not change it."""

    dark: bool = False
    """Dark theme."""
    map_shown: bool = False
    """Whether the tuning map is shown where the window is wide enough."""
    smoother: bool = False
    """Whether the best possible offline curve is drawn."""
    velocity: bool = False
    """Whether the velocity is drawn in place of the gain, where the filter has momentum."""
    gain_shown: bool = False
    """Whether the gain chart is drawn."""
    why_shown: bool = False
    """Whether the reasons for the verdict are shown."""
    match_by: Literal["lag", "noise"] = "lag"
    """What simpler filters are made equal in."""
    drawn_alternative: str = "Moving average"
    """The simpler filter that is drawn beside the present one; any other word draws all."""
    search_method: str = "maximum lag"
    """How q and r are searched, one of the search methods of the dashboard."""
    window: tuple[float, float] | None = None
    """First and last time on screen, s; None = the whole recording."""
    resets: int = 0
    """How often the view was reset: a new number makes the charts forget their zoom."""


# Settings kept beside the current one: pinned as A, B, C … with a colour, at most eight a channel.


MAX_VARIANTS = 8
"""Variants of one channel: more lines cannot be told apart."""


LIGHT = ("#332288", "#41a392", "#aa4499", "#8c8c28", "#1e9be2", "#117733", "#882255", "#7a5c00")
"""Colours on a light background: the muted scheme of P. Tol, which colour-blind people can distinguish, four of
them darkened."""

DARK = ("#9687f0", "#5fd0bc", "#e07fd0", "#cccc55", "#88ccee", "#4fb76a", "#d4608f", "#c9a24a")
"""The same hues on a dark background."""


@dataclass(frozen=True)
class Variant:
    """A setting of one channel that was pinned."""

    number: int
    """Of its letter and its colour, 0 … 7; distinct among those of its channel."""
    tuning: ChannelTuning
    """The setting; `tuning.name` is the channel it belongs to."""

    @property
    def name(self) -> str:
        """What it is called: A … H."""
        return string.ascii_uppercase[self.number]

    def css(self, *, dark: bool = False) -> str:
        """Its colour in a theme, #rrggbb."""
        return (DARK if dark else LIGHT)[self.number]


# What the State knows about a live board: the record as of the last refresh, what it shows, what was sent.


FIRST_SPAN = 10.0
"""Length of the live window at first, s."""


@dataclass(frozen=True)
class ConnectionState:
    """The state of the connection to the board."""

    connected: bool = False
    """Whether a board is connected, or is being waited for."""
    recording: bool = False
    """Whether that board is being recorded."""
    status: LiveStatus | None = None
    """Of the board on screen, or of one that is recorded in the background; None where there is none."""


NO_CONNECTION = ConnectionState()
"""No board has been connected yet."""


@dataclass(frozen=True)
class Live:
    """The live part of a State."""

    board: LiveSource
    """Where the samples come from; compared by identity."""
    snapshot: Snapshot | None = None
    """The record as of the last refresh; None before the first samples."""
    span: float = FIRST_SPAN
    """Length of the window that follows the newest sample, s; inf = all that is kept."""
    following: bool = True
    """Whether the window follows; looking back ends that."""
    paused: bool = False
    """Whether the screen is frozen while samples still arrive."""
    settled: bool = False
    """Whether the starting values have been measured."""
    deferred: tuple[Change, ...] = ()
    """What the command line asked for: it waits for them."""

    @property
    def waits(self) -> bool:
        """Whether the board has not sent enough to show: the record is a placeholder."""
        return self.snapshot is None

    @property
    def key(self) -> tuple[int, int]:
        """What stays the same while the record only grows: the board and its layout."""
        return id(self.board), -1 if self.snapshot is None else self.snapshot.generation


@dataclass(frozen=True)
class Sent:
    """A setting that a board has taken."""

    record: tuple[int, int]
    """The live record that it belongs to."""
    channel: str
    """The channel that was tuned."""
    filtered: str
    """The channel in which the board sends the output of its filter."""
    asked: FilterParams
    """What was on screen when it was sent."""
    params: Float32Params
    """What the board says it uses, exact."""
    row: int
    """Number of the first sample after the board restarted its filter, counted since it began to send."""


@dataclass(frozen=True)
class BoardCalibration:
    """The result of letting a board measure its own noise."""

    record: tuple[int, int]
    """The live record that it belongs to."""
    channel: str
    """The channel that was measured."""
    found: Measurement | None = None
    """What the board says, and the figure here; None where there was no answer."""
    failed: str = ""
    """Why there was none."""
    kept: bool = False
    """Whether the board keeps its values for its next start."""

    @property
    def values(self) -> Calibrated | None:
        """What the board measured; None where it could not."""
        answer = None if self.found is None else self.found.answer
        return answer if isinstance(answer, Calibrated) else None


# Tuning several channels at once: what the others become when one changes. Pure.


UNLINKED, SAME_NUMBERS, SAME_LAG = "this channel alone", "all: same q and r", "all: same lag, own noise"

LINKS: tuple[str, ...] = (UNLINKED, SAME_NUMBERS, SAME_LAG)
"""How channels are linked, in the words on screen. Axes of one sensor share their numbers; a pressure and a
temperature share at most the lag: then q, r and p0 are scaled by each channel's own noise. Momentum, a number of
samples, is the same for all."""


def scaled_copy(leader: ChannelTuning, own: ChannelTuning, factor: float) -> ChannelTuning:
    """Another channel's setting, its variances `factor` times as large.

    The start value x0 is taken over as it is, or, where the scale of the channels differs, left to the channel.
    """
    x0 = leader.x0 if factor == 1.0 or leader.p0 is None else own.x0
    chain = leader.chain
    if chain is not None and isinstance(chain.then, OneEuro):  # only it has a setting with a unit
        chain = replace(chain, then=replace(chain.then, beta=chain.then.beta / math.sqrt(factor)))
    variances = {name: _scaled(getattr(leader, name), factor) for name in ("q", "r", "p0")}
    return replace(leader, name=own.name, unit=own.unit, paper=None, x0=x0, chain=chain, **variances)


def _scaled(variance: float | None, factor: float) -> float | None:
    """The product; 0 stays 0 and nothing else becomes 0; None stays None."""
    if not variance or factor == 1.0:
        return variance
    return min(max(variance * factor, 1e-300), MAX_VARIANCE)


# The open fleet: its arrays, how its devices are sorted and coloured.


MAX_ROWS = 20
"""Devices in the table; the file has them all."""
MAX_DECADES = 12.0
"""Decades of q or r up to which the map covers all devices; in a wider fleet 1 % lie on each of its edges."""


def _descending(values: Array) -> Indices:
    """The indices of the numbers, the largest first; NaN left out."""
    known = np.flatnonzero(~np.isnan(values))
    return known[np.argsort(-values[known], kind="stable")]


ORDERS: Mapping[str, Callable[[Fleet], Indices]] = {
    "most unlike the others": lambda fleet: _descending(fleet.distance),
    "largest loss": lambda fleet: _descending(fleet.growth),
    "largest r": lambda fleet: _descending(fleet.devices.r),
    "smallest r": lambda fleet: _descending(-fleet.devices.r),
    "largest q": lambda fleet: _descending(fleet.devices.q),
    "smallest q": lambda fleet: _descending(-fleet.devices.q),
    "without q and r": lambda fleet: np.flatnonzero([bool(reason) for reason in fleet.devices.reasons]),
}
"""How the devices may be sorted."""


def loss_text(growth: float) -> str:
    """By which share the prediction error grows, to 0.1 %: smaller differences are chance."""
    return f"{trimmed(round(100.0 * growth, 1) + 0.0)} %"


@dataclass(frozen=True, eq=False)
class OpenFleet:
    """A fleet and how it is shown; compared by identity."""

    fleet: Fleet
    """Its arrays."""
    order: str = next(iter(ORDERS))
    """How its devices are sorted, one of ORDERS."""
    find: str = ""
    """What the names of the devices in the table contain, in any letter case; "" = all."""

    @cached_property
    def ranked(self) -> Indices:
        """All rows: first those that its order ranks, then the others."""
        order = ORDERS[self.order](self.fleet)
        return np.concatenate([order, np.setdiff1d(np.arange(len(self.fleet)), order)])

    @cached_property
    def rows(self) -> list[int]:
        """The rows of the table: those whose names contain `find`, or all that its order ranks."""
        if not self.find:
            return ORDERS[self.order](self.fleet)[:MAX_ROWS].tolist()
        name, wanted = self.fleet.devices.name, self.find.casefold()
        return list(islice((i for i in self.ranked.tolist() if wanted in name(i).casefold()), MAX_ROWS))

    @cached_property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Pairs of q and r, unit², between which the devices lie; none where no device has both above 0."""
        devices, shared = self.fleet.devices, self.fleet.shared
        logs = [np.log10(values[devices.usable]) for values in (devices.q, devices.r)]
        if not len(logs[0]):
            return ()
        wide = any(float(np.ptp(one)) > MAX_DECADES for one in logs)
        ends = [np.quantile(one, (0.01, 0.99) if wide else (0.0, 1.0)) for one in logs]
        pairs = [(10.0 ** float(q), 10.0 ** float(r)) for q, r in zip(*ends, strict=True)]
        if shared is not None:
            pairs.append((shared.params.q, float(shared.params.r)))
        return tuple(pairs)


# The fused filter of a State: several sensors of one quantity, some of which may be dropped.


MIN_SENSORS = 2
"""One sensor needs no fusion."""

MAX_SENSORS = 8
"""Sensors that the dashboard fuses, at most; the command line takes more."""


@dataclass(frozen=True)
class Fusion:
    """The filter that was found for several sensors, and which of them take part."""

    tuning: ChannelTuning
    """Of all sensors."""
    start: ChannelTuning
    """What it was when the sensors were fused; Reset goes back there."""
    dropped: frozenset[str] = frozenset()
    """Sensors that take no part."""
    estimate: Estimate | None = None
    """What the search found about them; None where the filter comes from a file."""

    @cached_property
    def used(self) -> ChannelTuning:
        """The filter of the sensors that take part."""
        return self.of_used(self.tuning)

    @cached_property
    def shares(self) -> Mapping[str, float]:
        """What each sensor contributes to the fused value while all answer; 0 for a dropped one."""
        shares = dict.fromkeys(self.tuning.sensors, 0.0)
        return {**shares, **dict(zip(self.used.sensors, self.used.params.shares.tolist(), strict=True))}

    def of_used(self, tuning: ChannelTuning) -> ChannelTuning:
        """The part of a tuning for the sensors that take part."""
        return tuning.of_sensors(name for name in tuning.sensors if name not in self.dropped)


# What the user has chosen, as one frozen State.


@dataclass(frozen=True, kw_only=True)
class Outcome(FitResult):
    """What a search for q and r gave on one channel, and what became of it.

    Its goal holds as long as the outcome, which a change of q, r or momentum drops.
    """

    before: ChannelTuning
    """The parameters before."""
    after: ChannelTuning | None
    """The parameters now; None where nothing usable was found and nothing changed."""


@dataclass(frozen=True)
class State:
    """All that decides what is on screen."""

    # What is open, how it was read, and which channel is on screen.
    recording: Recording
    """The samples."""
    channel: str
    """The channel on screen, one of recording.names."""

    # The filters of all channels: with the recording and its channel, what Undo restores.
    tunings: tuple[ChannelTuning, ...]
    """The parameters of every channel, in the order of recording.names."""
    firsts: tuple[Outcome, ...] = field(compare=False)
    """How every channel began, in the same order; Reset goes back there."""
    pins: tuple[Variant, ...] = ()
    """Pinned settings of every channel, open or not; `variants` are those of the channel on screen."""
    elsewhere: tuple[ChannelTuning, ...] = ()
    """What was tuned for channels of other recordings; it comes back with a channel of that name and unit."""
    link: str = UNLINKED
    """Whether the other channels follow the one on screen, one of LINKS."""
    fused: Fusion | None = None
    """The filter of several channels that measure one quantity; None = none are fused."""
    shows_fused: bool = False
    """Whether the fused value is on screen in place of the channel."""

    options: ReadOptions = DEFAULTS
    """What the user decided about reading the file."""
    typed_period: float | None = None
    """The sample period that the user typed, s; None = as the recording says."""
    as_read: Recording | None = None
    """The recording before its sample period was typed; None where it was not."""
    board_choice: str | None = ""
    """The channel said to be the board's own filtered curve; "" = by its name, None = there is none."""

    view: View = View()
    """How it is shown."""
    searched: Outcome | None = None
    """The last search on the channel on screen, until a change of q, r, momentum or filter."""
    note: str = ""
    """One sentence on what the last change did, where that needs saying."""
    sent: Sent | None = None
    """What was last sent to the live board; None = nothing yet."""
    calibration: BoardCalibration | None = None
    """What the live board measured of its own noise; None = nothing yet."""
    live: Live | None = None
    """The live board that the recording grows from; None for a finished recording."""
    fleet: OpenFleet | None = None
    """The fleet that is open beside the recording; like the view, it outlives the recording."""

    def with_view(self, **values: Any) -> State:
        """The state with other fields of `view`."""
        return replace(self, view=replace(self.view, **values))

    def with_reset_view(self, **values: Any) -> State:
        """The state with the zoom of the charts forgotten, and other fields of `view`."""
        return self.with_view(resets=self.view.resets + 1, **values)

    def with_live(self, **values: Any) -> State:
        """The state with other fields of `live`; itself without a board."""
        return self if self.live is None else replace(self, live=replace(self.live, **values))

    @property
    def index(self) -> int:
        """The index of the channel on screen among recording.names."""
        return self.recording.index(self.channel)

    @property
    def z(self) -> NDArray[np.float64]:
        """Its measurements, unit; NaN where missing, shape (n,)."""
        return self.recording.channel(self.channel)

    @property
    def starts(self) -> tuple[ChannelTuning, ...]:
        """The starting values of every channel."""
        return tuple(one.before for one in self.firsts)

    @property
    def settings(self) -> tuple[object, ...]:
        """The filters of all channels, which Undo restores with the recording and the channel."""
        return self.tunings, self.starts, self.pins, self.elsewhere, self.link, self.fused

    @property
    def fusion(self) -> Fusion | None:
        """The fused filter that is on screen in place of the channel's own; None = the channel's is."""
        return self.fused if self.shows_fused else None

    @property
    def measured(self) -> tuple[str, ...]:
        """The channels whose readings are on screen: one, or the sensors that are fused."""
        return (self.channel,) if self.fusion is None else self.fusion.used.sensors

    @cached_property
    def tuning(self) -> ChannelTuning:
        """Its parameters; those of the fused filter as of one channel."""
        return self.running.as_channel

    @cached_property
    def running(self) -> ChannelTuning:
        """The filter that runs: the channel's, or that of the sensors."""
        return self.tunings[self.index] if self.fusion is None else self.fusion.used

    @property
    def readings(self) -> NDArray[np.float64]:
        """What it filters, NaN where missing: shape (n,), or (n, sensors)."""
        return self.running.readings(self.recording)

    @property
    def start(self) -> ChannelTuning:
        """Its starting values."""
        fusion = self.fusion
        return self.firsts[self.index].before if fusion is None else fusion.of_used(fusion.start).as_channel

    @cached_property
    def params(self) -> FilterParams:
        """Its parameters as the standard filter takes them."""
        return self.tuning.params

    @property
    def variants(self) -> tuple[Variant, ...]:
        """Its pinned settings, in the order in which they were pinned."""
        own = self.tuning
        return tuple(pin for pin in self.pins if (pin.tuning.name, pin.tuning.unit) == (own.name, own.unit))

    @cached_property
    def filter(self) -> Filter:
        """Its filter; where sensors are fused, the one that equals theirs while all answer."""
        return self.tuning.filter

    @property
    def is_standard(self) -> bool:
        """Whether the Kalman filter of q and r alone runs on one channel: only that is searched for and judged."""
        return self.fusion is None and self.filter.is_standard

    @property
    def has_one_speed(self) -> bool:
        """Whether the filter on screen is the same all the time, once it has settled."""
        return self.is_standard and self.tuning.fast is None

    @property
    def has_gain(self) -> bool:
        """Whether what is on screen has a Kalman gain: not a chain that ends with another filter."""
        return self.tuning.chain is None or self.tuning.chain.then is None

    @property
    def uses_parameters(self) -> bool:
        """Whether q and r act on what is on screen."""
        return self.has_gain and self.tuning.paper is None

    @property
    def dt(self) -> NDArray[np.float64] | None:
        """Nominal periods before each sample, where the user chose that gaps in time count; else None."""
        return self.recording.steps() if self.recording.gaps == "dt" else None

    @property
    def board(self) -> str | None:
        """The channel with the board's own filtered curve, drawn beside ours; None = there is none."""
        choice = self.board_choice
        if choice == "":
            choice = "filtered" if self.channel == "raw" else f"{self.channel}_filtered"  # as the sketch names it
        return choice if choice in self.recording.names and self.fusion is None else None

    @property
    def first(self) -> Outcome:
        """The first answer of the channel on screen."""
        return self.firsts[self.index]

    @property
    def outcome(self) -> Outcome | None:
        """The search that gave the filter of the channel: the last one, else the first answer while it stays."""
        return self.searched or next((one for one in self.firsts if one.after == self.tuning), None)

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

    @property
    def set_aside(self) -> NDArray[np.bool_] | None:
        """Samples of the channel on screen that the last search set aside as spikes, shape (n,); None = none."""
        found = None if self.outcome is None or self.fusion else self.outcome.estimate
        aside = None if found is None else found.outliers
        return aside if aside is not None and len(aside) == len(self.recording) and aside.any() else None

    def with_standard_filter(self) -> State:
        """The state with the Kalman filter alone for the channel on screen, at the q and r that it has."""
        return self if self.filter.is_standard else self.with_tuning(chain=None, paper=None)

    def with_tuning(self, **values: Any) -> State:
        """The state with other parameters for what is on screen; raises what FilterParams raises.

        Another r of fused sensors scales the noise of each of them.
        """
        fusion, r = self.fusion, values.get("r", self.tuning.r)
        if fusion is None:
            return self.with_tuning_of(self.index, replace(self.tuning, **values))
        factor = r / self.tuning.r if self.tuning.r > 0.0 and r != self.tuning.r else 1.0
        values["r"] = tuple(min(one * factor, MAX_VARIANCE) for one in fusion.tuning.r)
        return self.with_fusion(replace(fusion, tuning=replace(fusion.tuning, **values)))

    def with_fusion(self, fusion: Fusion | None) -> State:
        """The state with this fused filter on screen; None = the channel's own filter."""
        return replace(self, fused=fusion, shows_fused=fusion is not None, searched=None, note="")

    def with_tuning_of(self, at: int, tuning: ChannelTuning) -> State:
        """The state with other parameters for one channel, by its index; linked channels follow."""
        before, names = self.tunings[at], ("q", "r", "momentum", "fast", "spikes", "chain", "paper")
        same = all(getattr(before, name) == getattr(tuning, name) for name in names)
        tunings = list(self.tunings)
        if self.link != UNLINKED:
            noise = self.starts[at].r if self.link == SAME_LAG else 0.0
            factors = (start.r / noise if noise > 0.0 else 1.0 for start in self.starts)
            tunings = [scaled_copy(tuning, own, factor) for own, factor in zip(tunings, factors, strict=True)]
        tunings[at] = tuning
        return replace(self, tunings=tuple(tunings), searched=self.searched if same else None, note="")

    def require_one_channel(self) -> None:
        """BadSetting where fused sensors are on screen: what is asked for is done on one channel."""
        if self.fusion is not None:
            raise BadSetting("this is done on one channel: choose one above the tabs first (got fused sensors)")

    def require_exportable(self, names: Iterable[str]) -> None:
        """BadSetting where one of these channels runs the Khan et al. filter, which cannot be exported."""
        tunings = [self.tunings[self.recording.index(name)] for name in names]
        other = [one.name for one in tunings if one.paper is not None]
        if other:
            raise BadSetting(
                f"the Khan et al. filter on {', '.join(other)[:100]} cannot be exported:"
                " choose the Kalman filter in the Tune tab first"
            )

    def as_tuning(self) -> Tuning:
        """What the tuning file holds."""
        fusion = None if self.fused is None else self.fused.used
        return Tuning.of(self.recording, self.tunings, selected=self.channel, fusion=fusion)


Change = Callable[[State], State]
"""What is asked of the session; the engine's thread applies it."""

P = ParamSpec("P")


def requested(function: Callable[Concatenate[State, P], State]) -> Callable[P, Change]:
    """The function of a State and some values, to be called with the values alone: it then returns a Change."""
    return lambda *values, **named: lambda state: function(state, *values, **named)
