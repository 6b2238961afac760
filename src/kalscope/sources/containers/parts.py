"""Which part of a file is read: one of its topics, sheets, groups or segments, all of one time axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from kalscope.common.text import count
from kalscope.errors import BadFile, BadSetting

_MAX_NAMED = 12
"""Parts that a note or a refusal names."""


@dataclass(frozen=True)
class Part:
    """One part of a file, before it is read."""

    name: str
    """Its name, as the user gives it."""
    rows: int
    """Rows that it holds."""
    channels: int
    """Columns of numbers that it holds."""


def choose_part(parts: Sequence[Part], wanted: str | None, name: str, what: str) -> tuple[int, tuple[str, ...]]:
    """Index of the part to read, and a sentence that names the others.

    Args:
        parts: The parts that hold numbers, in the order of the file.
        wanted: `ReadOptions.part`: the whole name of one, or the end of exactly one name; None for the part with
            most numbers.
        name: The file.
        what: What a part is called there: "topic", "sheet", "group".

    Raises:
        BadFile: there is no part with numbers.
        BadSetting: there is no such part, or more than one.
    """
    if not parts:
        raise BadFile(f"{name} must hold a {what} with numbers (got none)")
    if wanted is None:
        chosen = max(range(len(parts)), key=lambda i: parts[i].rows * parts[i].channels)
    else:
        chosen = _wanted(parts, wanted, what)
    if len(parts) == 1:
        return chosen, ()
    others = _listed([part for i, part in enumerate(parts) if i != chosen])
    return chosen, (f"read the {what} {_described(parts[chosen])}; --part NAME chooses another: {others}",)


def refuse_part(wanted: str | None, name: str) -> None:
    """Raise BadSetting where a part is requested of a file that is one table."""
    if wanted is not None:
        raise BadSetting(f"part must be left out, because {name} holds one table (got {wanted!r})")


def choose_text_part(
    parts: Sequence[Part], wanted: str | None, name: str, what: str
) -> tuple[int, tuple[str, ...], str | None]:
    """As `choose_part`, for parts that are text; and the part to choose within the text, a name of a long table."""
    if len(parts) == 1 and wanted is not None and not parts[0].name.endswith(wanted):
        return 0, (), wanted
    return (*choose_part(parts, wanted, name, what), None)


def _wanted(parts: Sequence[Part], wanted: str, what: str) -> int:
    names = [part.name for part in parts]
    if wanted in names:
        return names.index(wanted)
    ending = [i for i, name in enumerate(names) if wanted and name.endswith(wanted)]
    if len(ending) == 1:
        return ending[0]
    choices = _listed([parts[i] for i in ending] if ending else parts)
    raise BadSetting(f"part must be one {what} of {choices} (got {wanted!r})")


def _described(part: Part) -> str:
    return f'"{part.name}" ({count(part.rows)} × {part.channels})'


def _listed(parts: Sequence[Part]) -> str:
    shown = ", ".join(_described(part) for part in parts[:_MAX_NAMED])
    return shown if len(parts) <= _MAX_NAMED else f"{shown} and {len(parts) - _MAX_NAMED} more"
