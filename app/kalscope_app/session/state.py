"""What the user has chosen, as one frozen State of a few small values."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalscope.errors import BadSetting
from kalscope.estimation.finding import Request
from kalscope.estimation.result import Estimate
from kalscope.filtering.params import FilterParams
from kalscope.filtering.protocol import Filter
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.tuning.paper_tuning import PaperTuning, with_kalman_filter
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.session.fleet import OpenFleet
from kalscope_app.session.fusion import Fusion
from kalscope_app.session.linked_channels import UNLINKED, apply_to_linked
from kalscope_app.session.live_state import BoardCalibration, Live, Sent
from kalscope_app.session.variants import Variant
from kalscope_app.session.view import AS_OPENED, View


@dataclass(frozen=True)
class OpenRecording:
    """What is open, how it was read, and which channel is on screen."""

    recording: Recording
    """The samples."""
    channel: str
    """The channel on screen, one of recording.names."""
    options: ReadOptions = DEFAULTS
    """What the user decided about reading the file."""
    typed_period: float | None = None
    """The sample period that the user typed, s; None = as the recording says."""
    as_read: Recording | None = None
    """The recording before its sample period was typed; None where it was not."""
    board_choice: str | None = ""
    """The channel said to be the board's own filtered curve; "" = by its name, None = there is none."""
    fused: bool = False
    """Whether the fused value is on screen in place of the channel, where sensors are fused."""


@dataclass(frozen=True)
class ChannelSettings:
    """The filters of all channels: with the open recording and its channel, what Undo restores."""

    tunings: tuple[ChannelTuning, ...]
    """The parameters of every channel, in the order of recording.names."""
    starts: tuple[ChannelTuning, ...]
    """What they were when the recording was opened; Reset goes back there."""
    pins: tuple[Variant, ...] = ()
    """Pinned settings of every channel, open or not; `State.variants` are those of the channel on screen."""
    elsewhere: tuple[ChannelTuning, ...] = ()
    """What was tuned for channels of other recordings; it comes back with a channel of that name and unit."""
    link: str = UNLINKED
    """Whether the other channels follow the one on screen, one of `linked_channels.LINKS`."""
    fusion: Fusion | None = None
    """The filter of several channels that measure one quantity; None = none are fused."""


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
    estimate: Estimate | None = None
    """The estimate behind it; None where the parameters were chosen."""
    request: Request | None = None
    """What was asked for; the goal holds as long as the outcome, which a change of q, r or momentum drops."""


@dataclass(frozen=True)
class Answers:
    """What was computed or done on request, for the channel on screen."""

    outcome: Outcome | None = None
    """The last search."""
    method_comparison: tuple[Estimate, ...] = ()
    """The estimates of the five methods, once they were run."""
    note: str = ""
    """One sentence on what the last change did, where that needs saying."""


@dataclass(frozen=True)
class State:
    """All that decides what is on screen."""

    open: OpenRecording
    settings: ChannelSettings
    view: View = AS_OPENED
    answers: Answers = Answers()
    sent: Sent | None = None
    """What was last sent to the live board; None = nothing yet."""
    calibration: BoardCalibration | None = None
    """What the live board measured of its own noise; None = nothing yet."""
    live: Live | None = None
    """The live board that the recording grows from; None for a finished recording."""
    fleet: OpenFleet | None = None
    """The fleet that is open beside the recording; like the view, it outlives the recording."""

    def with_open(self, **values: Any) -> State:
        """The state with other fields of `open`."""
        return replace(self, open=replace(self.open, **values))

    def with_settings(self, **values: Any) -> State:
        """The state with other fields of `settings`."""
        return replace(self, settings=replace(self.settings, **values))

    def with_view(self, **values: Any) -> State:
        """The state with other fields of `view`."""
        return replace(self, view=replace(self.view, **values))

    def with_answers(self, **values: Any) -> State:
        """The state with other fields of `answers`."""
        return replace(self, answers=replace(self.answers, **values))

    def with_reset_view(self, **values: Any) -> State:
        """The state with the zoom of the charts forgotten, and other fields of `view`."""
        return self.with_view(resets=self.view.resets + 1, **values)

    @property
    def recording(self) -> Recording:
        """What is open."""
        return self.open.recording

    @property
    def channel(self) -> str:
        """The channel on screen."""
        return self.open.channel

    @property
    def index(self) -> int:
        """Its index among recording.names."""
        return self.recording.index(self.channel)

    @property
    def z(self) -> NDArray[np.float64]:
        """Its measurements, unit; NaN where missing, shape (n,)."""
        return self.recording.channel(self.channel)

    @property
    def fusion(self) -> Fusion | None:
        """The fused filter that is on screen in place of the channel's own; None = the channel's is."""
        return self.settings.fusion if self.open.fused else None

    @property
    def measured(self) -> tuple[str, ...]:
        """The channels whose readings are on screen: one, or the sensors that are fused."""
        return (self.channel,) if self.fusion is None else self.fusion.used.sensors

    @property
    def tuning(self) -> ChannelTuning:
        """Its parameters; those of the fused filter as of one channel."""
        return self.settings.tunings[self.index] if self.fusion is None else self.fusion.as_channel

    @property
    def start(self) -> ChannelTuning:
        """Its starting values."""
        return self.settings.starts[self.index] if self.fusion is None else self.fusion.start_as_channel

    @cached_property
    def params(self) -> FilterParams:
        """Its parameters as the standard filter takes them."""
        return self.tuning.params

    @property
    def variants(self) -> tuple[Variant, ...]:
        """Its pinned settings, in the order in which they were pinned."""
        own = self.tuning
        return tuple(
            pin for pin in self.settings.pins if (pin.tuning.name, pin.tuning.unit) == (own.name, own.unit)
        )

    @cached_property
    def filter(self) -> Filter:
        """Its filter; where sensors are fused, the one that equals theirs while all answer."""
        return self.tuning.filter

    @property
    def is_standard(self) -> bool:
        """Whether the Kalman filter of q and r alone runs on one channel: only that is searched for and judged."""
        return self.fusion is None and self.filter.is_standard

    @property
    def has_gain(self) -> bool:
        """Whether what is on screen has a Kalman gain: not a chain that ends with another filter."""
        return self.tuning.chain is None or self.tuning.chain.then is None

    @property
    def uses_parameters(self) -> bool:
        """Whether q and r act on what is on screen."""
        return self.has_gain and not isinstance(self.tuning, PaperTuning)

    @property
    def dt(self) -> NDArray[np.float64] | None:
        """Nominal periods before each sample, where the user chose that gaps in time count; else None."""
        return self.recording.steps() if self.recording.gaps == "dt" else None

    @property
    def board(self) -> str | None:
        """The channel with the board's own filtered curve, drawn beside ours; None = there is none."""
        if self.fusion is not None:
            return None
        names, choice = self.recording.names, self.open.board_choice
        if choice == "":
            choice = "filtered" if self.channel == "raw" else f"{self.channel}_filtered"  # as the sketch names it
        return choice if choice in names else None

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
        found = None if self.answers.outcome is None or self.fusion else self.answers.outcome.estimate
        aside = None if found is None else found.outliers
        return aside if aside is not None and len(aside) == len(self.recording) and aside.any() else None

    def with_standard_filter(self) -> State:
        """The state with the Kalman filter alone for the channel on screen, at the q and r that it has."""
        if self.filter.is_standard:
            return self
        return self.with_tuning_of(self.index, with_kalman_filter(self.tuning)).with_answers(outcome=None, note="")

    def with_tuning(self, **values: Any) -> State:
        """The state with other parameters for what is on screen; raises what FilterParams raises."""
        if self.fusion is not None:
            return self.with_fusion(self.fusion.with_values(**values))
        changed = replace(self.tuning, **values)
        same = all(getattr(changed, name) == getattr(self.tuning, name) for name in ("q", "r", "momentum", "chain"))
        state = self.with_tuning_of(self.index, changed)
        return state.with_answers(outcome=self.answers.outcome if same else None, note="")

    def with_fusion(self, fusion: Fusion | None) -> State:
        """The state with this fused filter on screen; None = the channel's own filter."""
        state = self.with_settings(fusion=fusion).with_open(fused=fusion is not None)
        return state.with_answers(outcome=None, note="")

    def with_tuning_of(self, at: int, tuning: ChannelTuning) -> State:
        """The state with other parameters for one channel, by its index; linked channels follow."""
        settings = self.settings
        tunings = (*settings.tunings[:at], tuning, *settings.tunings[at + 1 :])
        return self.with_settings(tunings=apply_to_linked(tunings, settings.starts, at, settings.link))

    def require_one_channel(self) -> None:
        """BadSetting where fused sensors are on screen: what is asked for is done on one channel."""
        if self.fusion is not None:
            raise BadSetting("this is done on one channel: choose one above the tabs first (got fused sensors)")

    def require_exportable(self, names: Iterable[str]) -> None:
        """BadSetting where one of these channels runs the Khan et al. filter, which cannot be exported."""
        tunings = [self.settings.tunings[self.recording.index(name)] for name in names]
        other = [one.name for one in tunings if isinstance(one, PaperTuning)]
        if other:
            raise BadSetting(
                f"the Khan et al. filter on {', '.join(other)[:100]} cannot be exported:"
                " choose the Kalman filter in the Tune tab first"
            )

    def as_tuning(self) -> Tuning:
        """What the tuning file holds."""
        fusion = None if self.settings.fusion is None else self.settings.fusion.used
        return Tuning.of(self.recording, self.settings.tunings, selected=self.channel, fusion=fusion)


Change = Callable[[State], State]
"""What is asked of the session; the engine's thread applies it."""
