"""The TOML file that stores a tuning.

It is meant to be edited and annotated by hand: saving over it changes only the values that changed, and keeps every
comment and every unknown key.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from kalscope.common.files import write_atomic
from kalscope.errors import BadFile, BadSetting
from kalscope.tuning import toml_text as toml
from kalscope.tuning.toml_text import chain_in, plain_chain
from kalscope.tuning.tuning import ChannelTuning, Tuning

# The tables of the file; None = the key is absent.


class _Sensor(msgspec.Struct):
    name: str
    r: float
    offset: float = 0.0
    gain: float = 1.0


class _Filter(msgspec.Struct, kw_only=True):
    """A channel; r must be given."""

    name: str
    unit: str = ""
    q: float
    r: float | None = None
    p0: float | Literal["diffuse"] = "diffuse"
    x0: float | Literal["first"] = "first"
    momentum: float | None = 0.0
    gate: float | None = None
    fast: float | None = None
    spikes: float | None = None
    how: str = ""
    chain: dict[str, Any] | None = None


class _Fusion(_Filter, kw_only=True):
    """The fusion, which has an r for each sensor, and no chain."""

    sensors: Annotated[list[_Sensor], msgspec.Meta(min_length=1)]


class _Source(msgspec.Struct):
    name: str = ""
    spec: str = ""
    sha256: str = ""
    sample_period: float | None = None


class _File(msgspec.Struct, kw_only=True):
    format: int
    tool: str = ""
    date: Any = ""
    """A text; or a date of TOML, without quotes."""
    selected: str = ""
    source: _Source = msgspec.field(default_factory=_Source)
    channel: list[_Filter]
    fusion: _Fusion | None = None


_COMMON = ("name", "unit", "q", "momentum", "gate", "fast", "spikes", "how")
_WORDS = {"p0": "diffuse", "x0": "first"}
"""What the file calls an automatic start, which is None elsewhere."""


def save_tuning(tuning: Tuning, path: str | os.PathLike[str]) -> None:
    """Write the tuning file, whole or not at all; the comments of an existing tuning file are kept.

    Raises:
        BadFile: There is a file that is not a tuning file of this format: a typing error must not overwrite a
            recording.
        BadSetting: The file would be too large to be read again.
        OSError: The file cannot be written; it is unchanged.
    """
    text = dumps(tuning)
    if Path(path).is_file() and Path(path).stat().st_size:
        try:
            before = toml.read_text(path)
            toml.parse(before)
        except BadFile as error:
            raise BadFile(f"{os.fspath(path)!r} must be a tuning file to be overwritten (got: {error})") from None
        # tomlkit has its limits (a table defined in two places, mixed inline tables), of many exception types; the
        # values matter more than the comments
        with suppress(Exception):
            changed = toml.updated(before, _plain(tuning))
            text = changed if loads(changed) == loads(text) else text
    data = text.encode()
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
    try:
        file = msgspec.convert(toml.parse(text), _File)
        return Tuning(
            channels=tuple(map(_tuning, file.channel)),
            source=file.source.spec,
            source_name=file.source.name,
            sha256=file.source.sha256,
            sample_period=file.source.sample_period,
            selected=file.selected,
            tool=file.tool,
            date=str(file.date),
            fusion=None if file.fusion is None else _tuning(file.fusion),
        )
    except (BadSetting, msgspec.ValidationError) as error:
        raise BadFile(toml.one_line(error)) from None


def _plain(tuning: Tuning) -> dict[str, Any]:
    """The tuning as the tables of the file."""
    is_basic = tuning.fusion is None and not (tuning.has_momentum or tuning.has_chain)
    is_newest = tuning.has_two_speeds or any(one.chain is not None and one.chain.notch for one in tuning.channels)
    fusion = None
    if tuning.fusion is not None:
        columns = (getattr(tuning.fusion, name) for name in ("sensors", "r", "offset", "gain"))
        fusion = _Fusion(**_values(tuning.fusion), sensors=[_Sensor(*row) for row in zip(*columns, strict=True)])
    file = _File(
        format=5 if is_newest else 1 if is_basic else 4,  # older programs read a basic file, and refuse any other
        tool=tuning.tool,
        date=tuning.date,
        selected=tuning.selected,
        source=_Source(tuning.source_name, tuning.source, tuning.sha256, tuning.sample_period),
        channel=[_Filter(**_values(one), r=one.r, chain=plain_chain(one.chain)) for one in tuning.channels],
        fusion=fusion,
    )
    return msgspec.to_builtins(file)


def _values(one: ChannelTuning) -> dict[str, Any]:
    """What a channel and a fusion have in common."""
    values: dict[str, Any] = {name: getattr(one, name) for name in (*_COMMON, *_WORDS)}
    values |= {name: word for name, word in _WORDS.items() if values[name] is None}
    return values | {"momentum": one.momentum or None, "spikes": one.spikes or None}


def _tuning(one: _Filter) -> ChannelTuning:
    values: dict[str, Any] = {name: getattr(one, name) for name in (*_COMMON, *_WORDS)}
    values |= {name: None for name, word in _WORDS.items() if values[name] == word}
    values["spikes"] = one.spikes or 0.0
    each: dict[str, Any] = {"r": one.r}
    if isinstance(one, _Fusion):
        each = {name: tuple(getattr(row, name) for row in one.sensors) for name in ("r", "offset", "gain")}
        each["sensors"] = tuple(row.name for row in one.sensors)
    try:
        return ChannelTuning(**values, **each, chain=None if one.chain is None else chain_in(one.chain))
    except (BadSetting, msgspec.ValidationError) as error:
        raise BadFile(f"{toml.shown(one.name)}: {toml.one_line(error)}") from None
