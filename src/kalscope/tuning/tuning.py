"""The tuning: the filters of the channels of a recording, and the one that fuses sensors."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, field, fields, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from kalscope.common.numbers import Array, above_zero
from kalscope.common.text import duration, program, typed_number
from kalscope.errors import BadSetting
from kalscope.filtering.classic import Chain, ChainFilter, Median, Notch, Stage, rescaled_chain
from kalscope.filtering.filter import Filter, StandardFilter
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.papers.generalized import GeneralizedParams
from kalscope.tuning.toml_text import KALMAN, STAGES, shown

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from kalscope.recording import Recording


# A chain of filters as a line that a user types: "median 5, one-euro 0.02 0.7 0.1"; "kalman" is the Kalman filter.
#
# The name of a filter is followed by its numbers, in the order of its fields. The names are those of the tuning
# file.


EXAMPLE = "median 5, one-euro 0.02 0.7 0.1"
"""A chain of two."""
FIRST: dict[str, type[Median | Notch]] = {"median": Median, "notch": Notch}
"""What may run before another filter, in this order."""


def typed_chain(text: str) -> Chain | None:
    """The chain in a line that a user typed; None for the Kalman filter alone.

    Raises:
        BadSetting: it is not such a line, or the filter cannot have these numbers.
    """
    parts = [part.split() for part in text.lower().split(",")]
    before = [part[0] for part in parts[:-1] if part]
    if not all(parts) or before != [name for name in FIRST if name in before]:
        must = "a chain must be a filter, after a median, a notch or both"
        raise BadSetting(f'{must}: "{EXAMPLE}" or "notch 0.2 0.01, kalman" (got {text[:60]!r})')
    then = None if parts[-1] == [KALMAN] else _stage(parts[-1], STAGES)
    first: dict[str, Any] = {part[0]: _stage(part, FIRST) for part in parts[:-1]}
    median, notch = first.get("median", Median(1)).window, first.get("notch")
    return None if median == 1 and notch is None and then is None else Chain(median, then, notch)


def chain_text(chain: Chain | None) -> str:
    """The line for a chain; `typed_chain` returns the same chain for it, to the last bit."""
    if chain is None:
        return KALMAN
    texts = list(map(_text, chain.stages))
    return ", ".join(texts if chain.then else (*texts, KALMAN))


def _stage(words: list[str], kinds: Mapping[str, type[Stage | Notch]]) -> Any:
    name, *numbers = words
    if name not in kinds:
        raise BadSetting(f"a filter of a chain must be one of {', '.join(kinds)}, {KALMAN} (got {name[:40]!r})")
    wanted = [one.name for one in fields(kinds[name])]
    if len(numbers) != len(wanted):
        raise BadSetting(f"{name} must have {len(wanted)} numbers, {', '.join(wanted)} (got {len(numbers)})")
    values: list[Any] = [typed_number(f"{key} of {name}", text) for key, text in zip(wanted, numbers, strict=True)]
    return kinds[name](*values)


def _text(stage: Stage | Notch) -> str:
    name = next(name for name, kind in (FIRST | STAGES).items() if isinstance(stage, kind))
    return " ".join((name, *map(repr, astuple(stage))))


# The tuning: the filters of the channels of a recording, and the one that fuses several of them.


SAME_PERIOD = 1e-3
"""Sample periods with a smaller relative difference are equal: a median of time stamps is no more accurate."""


_OF_PARAMS = ("q", "r", "p0", "x0", "gate", "momentum", "fast", "spikes")
"""What a channel has of `FilterParams`."""


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


@dataclass(frozen=True)
class ChannelTuning:
    """The filter of one channel, or the one that fuses several sensors of one quantity.

    Sensor i reads offset_i + gain_i·x + noise of variance r_i.

    Raises:
        BadSetting: The numbers are not valid parameters (see `FilterParams`), there is not one r per sensor, two
            sensors have the same name, or sensors have a chain.
    """

    name: str
    """Name of the channel, as in the recording, or of the fused value."""
    unit: str
    """Unit of the signal, "" where unknown."""
    q: float
    """Process-noise variance added per nominal sample period, unit², 0 … 1e300."""
    r: Any
    """Measurement-noise variance, unit², 0 … 1e300: a float; of sensors a tuple of one each, in the square of what
    it reads. q and r are not both 0."""
    p0: float | None = None
    """Variance of the estimate before the first predict, unit², ≥ 0; None = exact diffuse start."""
    x0: float | None = None
    """Estimate before the first predict, unit; None = the first finite reading. Needs p0."""
    how: str = "by hand"
    """How q and r were found, for the user: "by hand", "maximum likelihood", …"""
    gate: float | None = None
    """Outlier gate on v²/s of each reading, > 0; None = off."""
    momentum: float = 0.0
    """Momentum τ: how long the signal keeps its direction, in nominal sample periods, 0 … 1e5; 0 = it does not."""
    chain: Chain | None = None
    """What filters in place of the Kalman filter, or before it; None = the Kalman filter alone."""
    sensors: tuple[str, ...] = ()
    """Names of the sensors that are fused, distinct channels of the recording; () = the channel `name` alone."""
    offset: tuple[float, ...] = ()
    """What each sensor reads where the fused value is 0; () = 0 for all."""
    gain: tuple[float, ...] = ()
    """By how much each sensor's reading grows with the fused value, not 0; () = 1 for all."""
    paper: GeneralizedParams | None = None
    """The filter of Khan et al. that runs in place of the Kalman one: shown, and in no tuning file."""
    fast: float | None = None
    """Two speeds: q grows to fast q while the signal moves, 1 … 1e12; None = one speed."""
    spikes: float = 0.0
    """With two speeds, the probability that a reading is a spike, 0 … 0.5."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        if len(set(self.sensors)) < len(self.sensors):
            raise BadSetting(f"sensors of a fusion must have distinct names (got {shown(list(self.sensors))})")
        params = self.params
        if params.fuses and not self.sensors:
            raise BadSetting(f"r of a channel must be one number (got {self.r})")
        if self.sensors and params.sensors != len(self.sensors):
            raise BadSetting(
                f"r of a fusion must have one value per sensor "
                f"(got {params.sensors} for {len(self.sensors)} sensors)"
            )
        if self.sensors and self.chain is not None:
            raise BadSetting(f"a chain filters one channel (got it for the sensors {shown(list(self.sensors))})")
        if self.fast is not None and self.chain is not None:
            raise BadSetting(f"two speeds run without a chain (got {self.chain.words})")
        for name in _OF_PARAMS:
            object.__setattr__(self, name, getattr(params, name))
        for name in ("r", "offset", "gain") if self.sensors else ():
            object.__setattr__(self, name, tuple(getattr(params, name).tolist()))

    @property
    def params(self) -> FilterParams:
        """The parameters as the filter takes them."""
        r = np.array(self.r) if self.sensors else self.r
        each: dict[str, Any] = {name: of for name in ("offset", "gain") if len(of := getattr(self, name))}
        each |= {"fast": self.fast, "spikes": self.spikes}
        return FilterParams(self.q, r, self.p0, self.x0, self.gate, self.momentum, **each)

    @property
    def filter(self) -> Filter:
        """The filter that runs: that of a paper, the chain, or the Kalman filter of `params`."""
        if self.paper is not None:
            return self.paper
        return StandardFilter(self.params) if self.chain is None else ChainFilter(self.chain, self.params)

    @property
    def has_gains(self) -> bool:
        """Whether a sensor has a gain other than 1."""
        return any(gain != 1.0 for gain in self.gain)

    @property
    def as_channel(self) -> ChannelTuning:
        """The filter of one channel that equals that of the sensors while all answer; itself for a channel."""
        if not self.sensors:
            return self
        r = min(float(self.params.as_single.r), MAX_VARIANCE)
        return replace(self, r=r, sensors=(), offset=(), gain=())

    def of_sensors(self, sensors: Iterable[str]) -> ChannelTuning:
        """The fusion of some of its sensors, in this order."""
        names = tuple(sensors)
        at = [self.sensors.index(name) for name in names]
        each: dict[str, Any] = {name: tuple(getattr(self, name)[i] for i in at) for name in ("r", "offset", "gain")}
        return replace(self, sensors=names, **each)

    def readings(self, recording: Recording) -> Array:
        """What it filters: the channel, shape (n,), or the sensors, shape (n, sensors).

        Raises:
            BadSetting: The recording has no such channel.
        """
        if not self.sensors:
            return recording.channel(self.name)
        return recording.values[:, [recording.index(name) for name in self.sensors]]

    @classmethod
    def of_params(
        cls, name: str, unit: str, params: FilterParams, how: str, sensors: tuple[str, ...] = ()
    ) -> ChannelTuning:
        """The tuning with these parameters."""
        names = (*_OF_PARAMS, *(("offset", "gain") if sensors else ()))
        values: dict[str, Any] = {one: getattr(params, one) for one in names}
        return cls(name, unit, **values, how=how, sensors=sensors)


@dataclass(frozen=True)
class Tuning:
    """What the tuning file holds.

    Raises:
        BadSetting: No channel, two of one name, `selected` is none of them, or the period is not positive.
    """

    channels: tuple[ChannelTuning, ...]
    """At least one, names distinct."""
    source: str = ""
    """What reopens the recording: a path, "sample:NAME", "synthetic:SHAPE?…"; "" where unknown."""
    source_name: str = ""
    """Name of the recording for the user."""
    sha256: str = ""
    """SHA-256 of the recording's bytes; "" where unknown."""
    sample_period: float | None = None
    """Nominal sample period that q belongs to, s, > 0; None where unknown."""
    selected: str = ""
    """Channel on the screen; "" = the first."""
    tool: str = field(default_factory=program)
    """Program and version that made the tuning."""
    date: str = field(default_factory=_now)
    """When it was made, UTC, ISO 8601."""
    fusion: ChannelTuning | None = None
    """The filter that fuses several sensors of one quantity; None = none."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(self.channels))
        names = [channel.name for channel in self.channels]
        if not names:
            raise BadSetting("tuning must hold at least one channel (got none)")
        if len(set(names)) < len(names):
            raise BadSetting(f"channels must have distinct names (got {shown(names)})")
        if self.selected and self.selected not in names:
            raise BadSetting(f"selected must be one of {shown(names)} (got {self.selected!r})")
        if self.sample_period is not None:
            object.__setattr__(self, "sample_period", above_zero("sample_period", self.sample_period))

    @classmethod
    def of(
        cls,
        recording: Recording,
        channels: Iterable[ChannelTuning],
        *,
        selected: str,
        fusion: ChannelTuning | None = None,
    ) -> Tuning:
        """The tuning of these channels of the recording, with what reopens it and its sample period."""
        return cls(
            tuple(channels),
            source=recording.source,
            source_name=recording.title,
            sha256=recording.sha256,
            sample_period=recording.sample_period,
            selected=selected,
            fusion=fusion,
        )

    def channel(self, name: str) -> ChannelTuning:
        """The tuning of the channel `name`; BadSetting names the choices."""
        named = {channel.name: channel for channel in self.channels}
        if name not in named:
            raise BadSetting(f"channel must be one of {', '.join(named)} (got {name!r})")
        return named[name]

    def only(self, name: str | None) -> Tuning:
        """With the channel `name` alone, so that nothing else is rescaled or refused; itself for None."""
        return self if name is None else replace(self, channels=(self.channel(name),), selected="", fusion=None)

    @property
    def has_chain(self) -> bool:
        """Whether any channel has a chain."""
        return any(channel.chain is not None for channel in self.channels)

    @property
    def has_momentum(self) -> bool:
        """Whether any channel has momentum."""
        return any(channel.momentum > 0.0 for channel in self.channels)

    @property
    def has_two_speeds(self) -> bool:
        """Whether any channel has two speeds."""
        return any(channel.fast is not None for channel in self.channels)

    def rescaled(self, sample_period: float) -> Tuning:
        """The same filter in continuous time, for another sample period in s.

        A random walk gains variance in proportion to time, so q per sample becomes q·T_new/T_old; momentum lasts
        as long in s, so it becomes τ·T_old/T_new; r and p0 are properties of one sample and of the start, and stay.
        A chain keeps its cut-offs in hertz and its windows in seconds.

        Raises:
            BadSetting: Either period is unknown or not positive, or q, the momentum or a chain leaves its range.
        """
        period = above_zero("sample_period", sample_period)
        if self.sample_period is None:
            raise BadSetting("sample_period of the tuning must be known to rescale q (got none)")
        ratio = period / self.sample_period  # first, so that an equal period changes no bit of q
        return replace(self.with_each(lambda one: _rescaled(one, ratio, period)), sample_period=period)

    def with_each(self, change: Callable[[ChannelTuning], ChannelTuning]) -> Tuning:
        """The tuning with every filter changed, that of the fusion too."""
        fusion = None if self.fusion is None else change(self.fusion)
        return replace(self, channels=tuple(map(change, self.channels)), fusion=fusion)


def _rescaled(one: ChannelTuning, ratio: float, period: float) -> ChannelTuning:
    """The filter at a period of `ratio` times as long, `period` in s."""
    chain = one.chain
    try:
        moved = replace(one, q=one.q * ratio, momentum=one.momentum / ratio)
        return moved if chain is None else replace(moved, chain=rescaled_chain(chain, ratio))
    except BadSetting as error:
        raise BadSetting(
            f"{one.name} cannot be filtered alike every {duration(period)}: {error}. Choose another sample"
            " period or filter"
        ) from None


def same_period(a: float, b: float) -> bool:
    """Whether two sample periods in s are equal within the resolution of time stamps."""
    return math.isclose(a, b, rel_tol=SAME_PERIOD)


# The tuning for a device that samples at another rate than the recording.


def rescaled_to_period(tuning: Tuning, sample_period: float) -> Tuning:
    """The tuning for a device that samples every `sample_period` s; where q changes, `how` says from what.

    The filters stay those of the same movement: q grows with the period, so the lag in s changes too.
    """
    old, moved = tuning.sample_period, tuning.rescaled(sample_period)
    if old is None or same_period(old, sample_period):
        return moved
    return moved.with_each(lambda one: _with_origin(one, old, sample_period))


def _with_origin(new: ChannelTuning, old: float, sample_period: float) -> ChannelTuning:
    """The rescaled filter, with the period that it was found at in `how`.

    That period comes first: a header may cut the end, and a lag that was asked for does not hold at the new period.
    """
    momentum = " and momentum divided by it" if new.momentum > 0.0 else ""
    chain = ", chain rescaled" if new.chain is not None else ""
    return replace(new, how=f"at {old:.4g} s: {new.how}; q times {sample_period / old:.4g}{momentum}{chain}")
