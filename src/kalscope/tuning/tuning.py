"""The tuning: the filters of the channels of a recording, and the TOML file that stores them.

The file is meant to be edited and annotated by hand: saving over it changes only the values that changed, and
keeps every comment and every unknown key.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any, cast

import numpy as np

from kalscope.common.checks import above_zero
from kalscope.common.files import write_atomic
from kalscope.common.text import duration, number
from kalscope.common.version import program
from kalscope.errors import BadFile, BadSetting
from kalscope.filtering.params import MAX_MOMENTUM, NO_GATE, FilterParams
from kalscope.tuning import toml_text as toml

SAME_PERIOD = 1e-3
"""Sample periods whose relative difference is smaller are equal: a median of time stamps is no more exact."""


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


@dataclass(frozen=True)
class ChannelTuning:
    """The filter of one channel.

    Raises:
        BadSetting: The numbers are not valid parameters (see `FilterParams`).
    """

    name: str
    """Name of the channel, as in the recording."""
    unit: str
    """Unit of the signal, "" where unknown."""
    q: float
    """Process-noise variance added per nominal sample period, unit², 0 … 1e300."""
    r: float
    """Measurement-noise variance, unit², 0 … 1e300; q and r are not both 0."""
    p0: float | None = None
    """Variance of the estimate before the first predict, unit², ≥ 0; None = exact diffuse start."""
    x0: float | None = None
    """Estimate before the first predict, unit; None = the first finite sample. Needs p0."""
    how: str = "by hand"
    """How q and r were found, for the user: "by hand", "maximum likelihood", …"""
    gate: float | None = None
    """Outlier gate on v²/s, > 0; None = off."""
    momentum: float = 0.0
    """Momentum τ: how long the signal keeps its direction, in nominal sample periods, 0 … 1e5; 0 = it does not."""

    def __post_init__(self) -> None:
        params = self.params
        for name in ("q", "r", "p0", "x0", "gate", "momentum"):
            value = getattr(params, name)
            if isinstance(value, np.ndarray):
                raise BadSetting(f"{name} of a channel must be one number (got {value})")
            object.__setattr__(self, name, value)

    @property
    def params(self) -> FilterParams:
        """The parameters as the filter takes them, scalars."""
        return FilterParams(self.q, self.r, self.p0, self.x0, self.gate, self.momentum)


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

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(self.channels))
        names = [channel.name for channel in self.channels]
        if not names:
            raise BadSetting("tuning must hold at least one channel (got none)")
        if len(set(names)) < len(names):
            raise BadSetting(f"channels must have distinct names (got {toml.shown(names)})")
        if self.selected and self.selected not in names:
            raise BadSetting(f"selected must be one of {toml.shown(names)} (got {self.selected!r})")
        if self.sample_period is not None:
            object.__setattr__(self, "sample_period", above_zero("sample_period", self.sample_period))

    def channel(self, name: str) -> ChannelTuning:
        """The tuning of the channel `name`; BadSetting names the choices."""
        named = {channel.name: channel for channel in self.channels}
        if name not in named:
            raise BadSetting(f"channel must be one of {', '.join(named)} (got {name!r})")
        return named[name]

    def only(self, name: str | None) -> Tuning:
        """With the channel `name` alone, so that no other one is rescaled or refused; itself for None."""
        return self if name is None else replace(self, channels=(self.channel(name),), selected="")

    def params(self, channel_name: str | None = None) -> FilterParams:
        """Parameters of one channel as scalars, or of all as arrays of shape (channels,) for None.

        Raises:
            BadSetting: No such channel; or some channels have a p0 or x0 and others have not, which arrays
                cannot say. Ask for each channel by its name then.
        """
        if channel_name is not None:
            return self.channel(channel_name).params
        return FilterParams(
            np.array([channel.q for channel in self.channels]),
            np.array([channel.r for channel in self.channels]),
            p0=self._together("p0"),
            x0=self._together("x0"),
            gate=self._together("gate", NO_GATE),
            momentum=np.array([channel.momentum for channel in self.channels]) if self.has_momentum else 0.0,
        )

    @property
    def has_momentum(self) -> bool:
        """Whether any channel has momentum."""
        return any(channel.momentum > 0.0 for channel in self.channels)

    def rescaled(self, sample_period: float) -> Tuning:
        """The same filter in continuous time, for another sample period in s.

        A random walk gains variance in proportion to time, so q per sample becomes q·T_new/T_old; momentum lasts
        as long in s, so it becomes τ·T_old/T_new; r and p0 are properties of one sample and of the start, and stay.

        Raises:
            BadSetting: Either period is unknown or not positive, or q or the momentum leaves its range.
        """
        period = above_zero("sample_period", sample_period)
        if self.sample_period is None:
            raise BadSetting("sample_period of the tuning must be known to rescale q (got none)")
        ratio = period / self.sample_period  # first, so that an equal period changes no bit of q
        self._refuse_longer_momentum(ratio, period)
        channels = tuple(replace(one, q=one.q * ratio, momentum=one.momentum / ratio) for one in self.channels)
        return replace(self, channels=channels, sample_period=period)

    def _refuse_longer_momentum(self, ratio: float, period: float) -> None:
        """BadSetting where τ would become too long, with one that filters alike: then only q/τ² matters."""
        for one in (each for each in self.channels if each.momentum > MAX_MOMENTUM * ratio):
            shorter = float(f"{0.999 * MAX_MOMENTUM * ratio:.4g}")
            raise BadSetting(
                f"momentum of {one.name} must be at most {number(MAX_MOMENTUM)} samples of {duration(period)} (got"
                f" {number(one.momentum / ratio)}): set momentum = {shorter:g} and"
                f" q = {one.q * (shorter / one.momentum) ** 2:.4g} in the tuning, which filters alike"
            )

    def _together(self, name: str, instead: float | None = None) -> np.ndarray | None:
        given = [getattr(channel, name) for channel in self.channels]
        values = [instead if value is None else value for value in given]
        if instead is None and None in given and given != [None] * len(given):
            raise BadSetting(f"{name} must be given for all channels or for none (got {toml.shown(given)})")
        return None if given == [None] * len(given) else np.array(values)


def same_period(a: float, b: float) -> bool:
    """Whether two sample periods in s are equal within the resolution of time stamps."""
    return math.isclose(a, b, rel_tol=SAME_PERIOD)


def save_tuning(tuning: Tuning, path: str | os.PathLike[str]) -> None:
    """Write the tuning file, whole or not at all; the comments of an existing tuning file are kept.

    Raises:
        BadFile: There is a file that is not a tuning file of this format: a typing error must not overwrite a
            recording.
        BadSetting: The file would be too large to be read again.
        OSError: The file cannot be written; it is unchanged.
    """
    before = ""
    if Path(path).is_file() and Path(path).stat().st_size:
        try:
            before = toml.read_text(path)
            toml.parse(before)
        except BadFile as error:
            raise BadFile(f"{os.fspath(path)!r} must be a tuning file to be saved over (got: {error})") from None
    data = toml.updated(before, _plain(tuning)).encode()
    if len(data) > toml.MAX_BYTES:
        raise BadSetting(f"a tuning file must hold at most {toml.MAX_BYTES} bytes (got {len(data)})")
    write_atomic(path, data)


def load_tuning(path: str | os.PathLike[str]) -> Tuning:
    """Read a tuning file.

    Raises:
        BadFile: The file cannot be read or is not a tuning file.
    """
    try:
        return loads(toml.read_text(path))
    except BadFile as error:
        raise BadFile(f"{os.fspath(path)!r}: {error}") from None


def dumps(tuning: Tuning) -> str:
    """The text of a new tuning file. Every float is read back bit for bit."""
    return toml.fresh(_plain(tuning))


def loads(text: str) -> Tuning:
    """The tuning in the text of a file. Unknown keys are ignored.

    Raises:
        BadFile: As `load_tuning`.
    """
    document = toml.parse(text)
    if isinstance(made := document.get("date"), date):  # TOML has dates, without quotes
        document["date"] = made.isoformat()
    source = toml.table_of(document.get("source", {}), "[source]")
    channels = cast("list[object] | None", document.get("channel"))
    if not isinstance(channels, list) or not channels:
        raise BadFile(f"there must be at least one [[channel]] (got {toml.shown(channels)})")
    try:
        return Tuning(
            channels=tuple(_channel(entry, i, document["format"]) for i, entry in enumerate(channels, 1)),
            source=toml.text_of(source, "spec", "[source]"),
            source_name=toml.text_of(source, "name", "[source]"),
            sha256=toml.text_of(source, "sha256", "[source]"),
            sample_period=toml.optional_number_of(source, "sample_period", "[source]"),
            selected=toml.text_of(document, "selected", "the file"),
            tool=toml.text_of(document, "tool", "the file"),
            date=toml.text_of(document, "date", "the file"),
        )
    except BadSetting as error:
        raise BadFile(str(error)) from None


def _plain(tuning: Tuning) -> dict[str, Any]:
    """The tuning as the tables of the file; None = the key is absent."""
    name, spec, sha256 = (toml.clean(text) for text in (tuning.source_name, tuning.source, tuning.sha256))
    source = {"name": name, "spec": spec, "sha256": sha256, "sample_period": tuning.sample_period}
    channels = [
        {
            "name": toml.clean(channel.name),
            "unit": toml.clean(channel.unit),
            "q": channel.q,
            "r": channel.r,
            "p0": "diffuse" if channel.p0 is None else channel.p0,
            "x0": "first" if channel.x0 is None else channel.x0,
            "momentum": channel.momentum or None,
            "gate": channel.gate,
            "how": toml.clean(channel.how),
        }
        for channel in tuning.channels
    ]
    # Without momentum the file stays one that older programs read; with it they must refuse the file.
    tool, made, selected = (toml.clean(text) for text in (tuning.tool, tuning.date, tuning.selected))
    head = {"format": 2 if tuning.has_momentum else 1, "tool": tool, "date": made, "selected": selected}
    return {**head, "source": source, "channel": channels}


def _channel(entry: object, number: int, file_format: int) -> ChannelTuning:
    where = f"[[channel]] {number}"
    table = toml.table_of(entry, where)
    if "name" not in table:
        raise BadFile(f"name of {where} must be given (got nothing)")
    name = toml.text_of(table, "name", where)
    where = f"channel {toml.shown(name)}"
    if "momentum" in table and file_format < 2:
        raise BadFile(f"momentum of {where} needs format = 2 at the top of the file (got format = {file_format})")
    try:
        return ChannelTuning(
            name=name,
            unit=toml.text_of(table, "unit", where),
            q=toml.number_of(table, "q", where),
            r=toml.number_of(table, "r", where),
            p0=toml.optional_number_of(table, "p0", where, "diffuse"),
            x0=toml.optional_number_of(table, "x0", where, "first"),
            how=toml.text_of(table, "how", where),
            gate=toml.optional_number_of(table, "gate", where),
            momentum=toml.optional_number_of(table, "momentum", where) or 0.0,
        )
    except BadSetting as error:
        raise BadFile(f"{where}: {error}") from None
