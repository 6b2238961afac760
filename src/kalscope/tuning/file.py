"""The TOML file that stores a tuning.

It is meant to be edited and annotated by hand: saving over it changes only the values that changed, and keeps every
comment and every unknown key.
"""

from __future__ import annotations

import os
from datetime import date
from pathlib import Path
from typing import Any

from kalscope.common.files import write_atomic
from kalscope.errors import BadFile, BadSetting
from kalscope.tuning import toml_text as toml
from kalscope.tuning.toml_text import chain_in, plain_chain
from kalscope.tuning.tuning import ChannelTuning, Tuning

FUSION = "[fusion]"
"""How messages name the table of the fusion."""


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
            raise BadFile(f"{os.fspath(path)!r} must be a tuning file to be overwritten (got: {error})") from None
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
    channels = toml.tables_of(document.get("channel"), "[[channel]]")
    try:
        return Tuning(
            channels=tuple(
                _filter(entry, f"[[channel]] {i}", document["format"]) for i, entry in enumerate(channels, 1)
            ),
            source=toml.text_of(source, "spec", "[source]"),
            source_name=toml.text_of(source, "name", "[source]"),
            sha256=toml.text_of(source, "sha256", "[source]"),
            sample_period=toml.optional_number_of(source, "sample_period", "[source]"),
            selected=toml.text_of(document, "selected", "the file"),
            tool=toml.text_of(document, "tool", "the file"),
            date=toml.text_of(document, "date", "the file"),
            fusion=_filter(document["fusion"], FUSION, document["format"]) if "fusion" in document else None,
        )
    except BadSetting as error:
        raise BadFile(str(error)) from None


def _plain(tuning: Tuning) -> dict[str, Any]:
    """The tuning as the tables of the file; None = the key is absent."""
    name, spec, sha256 = (toml.clean(text) for text in (tuning.source_name, tuning.source, tuning.sha256))
    source = {"name": name, "spec": spec, "sha256": sha256, "sample_period": tuning.sample_period}
    tool, made, selected = (toml.clean(text) for text in (tuning.tool, tuning.date, tuning.selected))
    head = {"format": _format(tuning), "tool": tool, "date": made, "selected": selected}
    fusion = None if tuning.fusion is None else _plain_filter(tuning.fusion)
    return {**head, "source": source, "channel": [*map(_plain_filter, tuning.channels)], "fusion": fusion}


def _format(tuning: Tuning) -> int:
    """The lowest that can hold it: older programs can read the file, unless they would run another filter."""
    if tuning.has_chain:
        return 4
    if tuning.fusion is not None:
        return 3
    return 2 if tuning.has_momentum else 1


def _plain_filter(one: ChannelTuning) -> dict[str, Any]:
    """A channel, or a fusion with a table in it for each sensor."""
    values = zip(one.sensors, one.r, one.offset, one.gain, strict=True) if one.sensors else ()
    sensors = [{"name": toml.clean(name), "r": r, "offset": b, "gain": c} for name, r, b, c in values]
    return {
        "name": toml.clean(one.name),
        "unit": toml.clean(one.unit),
        "q": one.q,
        **({} if sensors else {"r": one.r}),
        "p0": "diffuse" if one.p0 is None else one.p0,
        "x0": "first" if one.x0 is None else one.x0,
        "momentum": one.momentum or None,
        "gate": one.gate,
        "how": toml.clean(one.how),
        **({"sensors": sensors} if sensors else {"chain": plain_chain(one.chain)}),
    }


def _filter(entry: object, here: str, file_format: int) -> ChannelTuning:
    """A channel, or the fusion."""
    fuses = here == FUSION
    table, name, where = _named(entry, here, "fusion" if fuses else "channel")
    least, what = (2, f"momentum of {where}") if "momentum" in table else (1, where)
    if fuses or "chain" in table:
        least, what = (3, here) if fuses else (4, f"the chain of {where}")
    if file_format < least:
        raise BadFile(f"{what} needs format = {least} at the top of the file (got format = {file_format})")
    try:
        r: dict[str, Any] = _sensors(table) if fuses else {"r": toml.number_of(table, "r", where)}
        return ChannelTuning(
            name,
            toml.text_of(table, "unit", where),
            toml.number_of(table, "q", where),
            p0=toml.optional_number_of(table, "p0", where, "diffuse"),
            x0=toml.optional_number_of(table, "x0", where, "first"),
            how=toml.text_of(table, "how", where),
            gate=toml.optional_number_of(table, "gate", where),
            momentum=toml.optional_number_of(table, "momentum", where) or 0.0,
            chain=chain_in(table["chain"], where) if "chain" in table and not fuses else None,
            **r,
        )
    except BadSetting as error:
        raise BadFile(f"{where}: {toml.one_line(error)}") from None


def _sensors(table: toml.Tables) -> dict[str, Any]:
    """What a fusion has for each sensor."""
    entries = toml.tables_of(table.get("sensors"), "[[fusion.sensors]]")
    sensors = [_named(one, f"[[fusion.sensors]] {i}", "sensor") for i, one in enumerate(entries, 1)]
    usual: dict[str, Any] = {"r": {}, "offset": {"offset": 0.0}, "gain": {"gain": 1.0}}
    each = {
        key: tuple(toml.number_of({**default, **one}, key, where) for one, _, where in sensors)
        for key, default in usual.items()
    }
    return {"sensors": tuple(name for _, name, _ in sensors), **each}


def _named(entry: object, where: str, what: str) -> tuple[toml.Tables, str, str]:
    """A table, its name, and how messages name it: by `where` before its name is known, then by `what` and name."""
    table = toml.table_of(entry, where)
    if "name" not in table:
        raise BadFile(f"name of {where} must be given (got nothing)")
    name = toml.text_of(table, "name", where)
    return table, name, f"{what} {toml.shown(name)}"
