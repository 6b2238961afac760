"""The text of a tuning file: TOML tables to text and back, without knowledge of filters.

Read with the standard library's tomllib; written with tomlkit, which keeps comments.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Mapping, MutableMapping
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any, cast

import msgspec

from kalscope.common.text import CONTROL, escaped
from kalscope.errors import BadFile, BadSetting, reason_of
from kalscope.filtering import classic

if TYPE_CHECKING:
    from tomlkit.items import Item, Table


Tables = Mapping[str, Any]
"""Tables of a TOML text by name."""

FORMATS = (1, 2, 3, 4, 5)
"""Numbers of the file format; a reader refuses the numbers it does not know. 1 has q, r and start only."""
MAX_BYTES = 1_000_000
"""Largest file read: some thousand channels."""
MAX_DEPTH = 64
"""Deepest dotted key read: the memory that tomllib takes grows with the square of the depth (40 kB of dots
took 1.5 GB)."""

_STRING_OR_COMMENT = re.compile(
    r""""{3}(?:[^\\]|\\.)*?"{3}|'{3}.*?'{3}|"(?:[^"\\\n]|\\.)*"|'[^'\n]*'|\#[^\n]*""", re.DOTALL
)
_DEEP_KEY = re.compile(rf'(?<![\w-])(?:(?:[\w-]+|"")[ \t]*\.[ \t]*){{{MAX_DEPTH}}}')

_TITLE = "Kalscope tuning: the parameters of a scalar Kalman noise filter. Edit freely: your comments are kept."
_COMMENTS = {
    "date": "UTC",
    "selected": "the channel on the screen",
    "spec": "what reopens the recording",
    "sha256": "of the recording's bytes",
    "sample_period": "s; q belongs to this period",
    "unit": "of the signal; variances are in its square",
    "q": "process-noise variance added per sample, unit²",
    "r": "measurement-noise variance, unit²",
    "p0": 'variance of the estimate before the first predict, unit²; or "diffuse": unknown',
    "x0": 'estimate before the first predict, unit; or "first": the first sample',
    "momentum": "how long the signal keeps its direction, in sample periods",
    "gate": "a sample whose v²/s exceeds it is not used",
    "fast": "two speeds: q is this many times larger while the signal moves",
    "spikes": "with two speeds, the probability that a reading is a spike",
    "median": "a median of this many samples comes first",
    "filter": 'what filters then; "kalman" = q, r, ... above',
    "frequency": "what a notch before it takes out, cycles per sample",
    "width": "between the frequencies whose power it halves, cycles per sample",
    "window": "samples",
    "alpha": "share of each step that is taken",
    "cutoff": "cycles per sample",
    "beta": "growth of the cut-off for a speed of one unit per sample",
    "speed_cutoff": "of the speed itself, cycles per sample",
    "offset": "what the sensor reads where the fused value is 0",
    "gain": "by how much its reading grows with the fused value",
}
"""Comments beside the keys of a new file."""


def parse(text: str) -> dict[str, Any]:
    """The tables of a tuning file; only the format number is checked.

    Raises:
        BadFile: The text is too long, not TOML, or of another format.
    """
    if len(text) > MAX_BYTES:
        raise BadFile(f"a tuning file must hold at most {MAX_BYTES} characters (got {len(text)})")
    if _DEEP_KEY.search(_STRING_OR_COMMENT.sub('""', text)):
        raise BadFile(f"keys must be nested at most {MAX_DEPTH} deep (got more)")
    try:
        document = tomllib.loads(text)
    except RecursionError:
        raise BadFile("a tuning file must be TOML text (got brackets nested without end)") from None
    except ValueError as error:  # TOMLDecodeError, or an integer of 5000 digits
        raise BadFile(f"a tuning file must be TOML text (got: {one_line(error)})") from None
    held = document.get("format")
    if isinstance(held, bool) or held not in FORMATS:
        newer = isinstance(held, int) and held > FORMATS[-1]
        why = ": a newer Kalscope may have written this file" if newer else ""
        known = f"{', '.join(map(str, FORMATS[:-1]))} or {FORMATS[-1]}"
        raise BadFile(f"format must be {known}{why} (got {shown(held)})")
    return document


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a tuning file; BadFile where it is missing, too long or binary."""
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise BadFile(f"cannot read the tuning file: {reason_of(error)}") from None
    return text_of(data)


def text_of(data: bytes) -> str:
    """The text in the bytes of a tuning file; BadFile where it is too long or binary."""
    if len(data) > MAX_BYTES:
        raise BadFile(f"a tuning file must hold at most {MAX_BYTES} bytes (got more)")
    try:
        return data.decode("utf-8-sig")  # the old Notepad of Windows begins a file with a BOM
    except UnicodeDecodeError:
        raise BadFile("a tuning file must be TOML text in UTF-8 (got binary data)") from None


def fresh(tables: Mapping[str, Any]) -> str:
    """The text of a new file with a comment beside each value.

    Args:
        tables: As `parse` returns them; None is a key that must be absent.
    """
    import tomlkit

    document = tomlkit.document()
    document.add(tomlkit.comment(_TITLE))
    _write(document, tables)
    return tomlkit.dumps(document)


def updated(before: str, tables: Mapping[str, Any]) -> str:
    """The text `before` with the values of `tables`: unchanged values, comments and unknown keys stay."""
    import tomlkit

    document = tomlkit.parse(before)
    _write(document, tables)
    return tomlkit.dumps(document)


def _write(table: MutableMapping[str, Any], values: Tables) -> None:
    """Put `values` into a tomlkit table, touching only what differs."""
    for key, value in values.items():
        if value is None:
            table.pop(key, None)
        elif isinstance(value, Mapping):
            if key not in table:
                table[key] = _new_table()
            _write(table[key], cast("Tables", value))
        elif isinstance(value, list):
            _write_entries(table, key, cast("list[Tables]", value))
        elif key not in table:
            table[key] = _commented(key, value)
        elif table[key] != value:
            table[key] = _plain(value)


def _write_entries(table: MutableMapping[str, Any], key: str, entries: list[Tables]) -> None:
    """Put the entries into an array of tables in their order; an entry of the same name is updated."""
    import tomlkit

    array: Any = table.setdefault(key, tomlkit.aot())
    there = {str(entry["name"]): entry for entry in array.body}
    if list(there) != [entry["name"] for entry in entries]:
        del array[:]
        for entry in entries:
            array.append(there.get(entry["name"], _new_table()))
    for held, entry in zip(array.body, entries, strict=True):
        _write(held, entry)


def _new_table() -> Table:
    import tomlkit

    table = tomlkit.table()
    table.trivia.indent = "\n"  # an empty line above its [header]
    return table


def _commented(key: str, value: object) -> Item:
    import tomlkit

    item = tomlkit.item(_plain(value))
    return item.comment(_COMMENTS[key]) if key in _COMMENTS else item


def _plain(value: object) -> object:
    r"""A text with what would act on a terminal that shows the file written as `\u009b`; anything else as it is.

    Lone surrogates, which file names may hold and UTF-8 may not, are replaced.
    """
    if not isinstance(value, str):
        return value
    value = value.encode("utf-8", "replace").decode()
    if not CONTROL.search(value):
        return value
    import tomlkit

    inside = json.dumps(value, ensure_ascii=False)[1:-1]  # the escapes of JSON are those of TOML
    return tomlkit.string(escaped(inside), escape=False)


def shown(value: object) -> str:
    """A value as it appears in a message, cut at 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}…"


def one_line(value: object) -> str:
    """A message on one line, cut at 200 characters: numpy writes arrays of many values in several lines."""
    text = " ".join(str(value).split())
    return text if len(text) <= 200 else f"{text[:199]}…"


# The chain of a channel as a table of the tuning file.


KALMAN = "kalman"
"""What the file calls the channel's own Kalman filter behind a median."""
STAGES: dict[str, type[classic.Stage]] = {
    "moving-average": classic.MovingAverage,
    "exponential": classic.Exponential,
    "median": classic.Median,
    "butterworth": classic.Butterworth,
    "one-euro": classic.OneEuro,
}
"""What the file calls each classic filter."""

_SETTINGS = dict.fromkeys(one.name for stage in STAGES.values() for one in fields(stage))
"""Every key that a classic filter has, with None: those of another filter are removed from the file."""


def plain_chain(chain: classic.Chain | None) -> dict[str, Any] | None:
    """The chain as a table; None = the key is absent."""
    if chain is None:
        return None
    names = {stage: name for name, stage in STAGES.items()}
    then = chain.then
    settings = {} if then is None else {one.name: getattr(then, one.name) for one in fields(then)}
    name = KALMAN if then is None else names[type(then)]
    notch = None if chain.notch is None else asdict(chain.notch)
    median = chain.median if chain.median > 1 else None
    return {"median": median, "filter": name, **_SETTINGS, **settings, "notch": notch}


def chain_in(table: dict[str, Any]) -> classic.Chain:
    """The chain in a table of the file.

    Raises:
        BadSetting: There is no such filter, or a number is out of its range.
        msgspec.ValidationError: A number is missing or something else.
    """
    name, median = msgspec.convert(table.get("filter"), str), msgspec.convert(table.get("median", 1), int)
    notch = msgspec.convert(table.get("notch"), classic.Notch | None)
    if name == KALMAN:
        return classic.Chain(median, None, notch)
    if name == "power-of-two":  # the name and setting of α = 2^-shift in older files
        return classic.Chain(median, classic.Exponential(2.0 ** -msgspec.convert(table.get("shift"), int)), notch)
    if name not in STAGES:
        known = ", ".join(f'"{one}"' for one in STAGES)
        raise BadSetting(f'filter of the chain must be {known} or "{KALMAN}" (got {shown(name)})')
    return classic.Chain(median, msgspec.convert(table, STAGES[name]), notch)
