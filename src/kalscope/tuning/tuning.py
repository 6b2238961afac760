"""The tuning: the filters of the channels of a recording, and the one that fuses several of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from kalscope.common.array import Array
from kalscope.common.checks import above_zero
from kalscope.common.text import duration, number
from kalscope.common.version import program
from kalscope.errors import BadSetting
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.chain_filter import ChainFilter
from kalscope.filtering.classic.rescaling import rescaled_chain
from kalscope.filtering.params import MAX_MOMENTUM, MAX_VARIANCE, FilterParams
from kalscope.filtering.protocol import Filter, StandardFilter
from kalscope.tuning.toml_text import shown

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from kalscope.recording import Recording

SAME_PERIOD = 1e-3
"""Sample periods with a smaller relative difference are equal: a median of time stamps is no more accurate."""


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
        for name in ("q", "r", "p0", "x0", "gate", "momentum"):
            object.__setattr__(self, name, getattr(params, name))
        for name in ("r", "offset", "gain") if self.sensors else ():
            object.__setattr__(self, name, tuple(getattr(params, name).tolist()))

    @property
    def params(self) -> FilterParams:
        """The parameters as the filter takes them."""
        r = np.array(self.r) if self.sensors else self.r
        each: dict[str, Any] = {name: of for name in ("offset", "gain") if len(of := getattr(self, name))}
        return FilterParams(self.q, r, self.p0, self.x0, self.gate, self.momentum, **each)

    @property
    def filter(self) -> Filter:
        """The filter that runs: the Kalman filter of `params`, or the chain."""
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
        names = ("q", "r", "p0", "x0", "gate", "momentum", *(("offset", "gain") if sensors else ()))
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
    """The filter at a period of `ratio` times as long, `period` in s.

    BadSetting where τ would become too long, with one that filters alike: then only q/τ² matters.
    """
    if one.momentum > MAX_MOMENTUM * ratio:
        shorter = float(f"{0.999 * MAX_MOMENTUM * ratio:.4g}")
        raise BadSetting(
            f"momentum of {one.name} must be at most {number(MAX_MOMENTUM)} samples of {duration(period)} (got"
            f" {number(one.momentum / ratio)}): set momentum = {shorter:g} and"
            f" q = {one.q * (shorter / one.momentum) ** 2:.4g} in the tuning, which filters alike"
        )
    moved = replace(one, q=one.q * ratio, momentum=one.momentum / ratio)
    try:
        return moved if moved.chain is None else replace(moved, chain=rescaled_chain(moved.chain, ratio))
    except BadSetting as error:
        raise BadSetting(
            f"{one.name} cannot be filtered alike every {duration(period)}: {error}. Sample more often, or choose"
            " another filter"
        ) from None


def same_period(a: float, b: float) -> bool:
    """Whether two sample periods in s are equal within the resolution of time stamps."""
    return math.isclose(a, b, rel_tol=SAME_PERIOD)
