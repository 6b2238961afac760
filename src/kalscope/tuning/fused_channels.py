"""Which channels of a recording are fused, and what is known of each: texts such as "a,b,c" and "a=4,b=9"."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping, Sequence

from kalscope.errors import BadSetting

MAX_HINTS = 8
"""Units, and channels of each, that a refusal names; a car sends hundreds."""


def channels_to_fuse(units: Mapping[str, str], text: str, *, mixed_units: bool = False) -> tuple[str, ...]:
    """The channels that `text` names, by their names or their numbers from 1, with commas between them.

    Args:
        units: the unit of every channel there is, "" where unknown, in order.
        text: what a user typed. A name with a comma must be in double quotes.
        mixed_units: whether the units may differ: the gains of the sensors are estimated too.

    Raises:
        BadSetting: fewer than two, an unknown one, one twice, or two units.
    """
    must = f"--fuse must be two or more channels of one unit{_hint(units)}"
    names = tuple(
        _channel(tuple(units), cell, f"{must} (got {cell!r}, which is not a channel)") for cell in _cells(text)
    )
    if len(names) < 2 or len(set(names)) < len(names):
        raise BadSetting(f"{must} (got {text!r})")
    if not mixed_units:
        common_unit({name: units[name] for name in names})
    return names


def common_unit(units: Mapping[str, str]) -> str:
    """The unit that all these channels have, "" where none of them has one.

    Raises:
        BadSetting: two units, or one channel with a unit and one without.
    """
    if len(set(units.values())) > 1:
        said = ", ".join(f"{name} in {unit}" if unit else f"{name} without a unit" for name, unit in units.items())
        raise BadSetting(
            f"fused channels must have one unit (got {said}); channels that measure one quantity in different "
            "units can be fused with --sensor-gains and --reference"
        )
    return next(iter(units.values()))


def sensor_named(sensors: Sequence[str], option: str, text: str) -> str:
    """The sensor of this name, or of this number from 1 among them; BadSetting names the choices."""
    return _channel(sensors, text, f"{option} must be a sensor of --fuse: {', '.join(sensors)} (got {text!r})")


def for_each_sensor(sensors: Sequence[str], option: str, given: Mapping[str, float] | float) -> tuple[float, ...]:
    """The number of an option such as `--r 4` or `--r a=4,b=9` for each sensor; NaN where it names none for it.

    Raises:
        BadSetting: a name that is not one of the sensors.
    """
    if not isinstance(given, Mapping):
        return (given,) * len(sensors)
    by_name = {sensor_named(sensors, option, name): value for name, value in given.items()}
    return tuple(by_name.get(name, math.nan) for name in sensors)


def named_numbers(text: str, number: Callable[[str], float]) -> dict[str, float]:
    """The numbers of "a=4,b=9" by their names, in order; {} where the text has another form.

    Args:
        text: what a user typed.
        number: reads one of them; may raise.
    """
    pairs = [cell.rpartition("=") for cell in _cells(text)]
    names = [name.strip() for name, _, _ in pairs]
    if not all(names) or len(set(names)) < len(names):
        return {}
    return {name: number(value) for name, (_, _, value) in zip(names, pairs, strict=True)}


def _cells(text: str) -> list[str]:
    try:
        cells = next(csv.reader([text], skipinitialspace=True), list[str]())
    except csv.Error:  # a line end, which no name has
        cells = [text]
    return [cell.strip() for cell in cells]


def _channel(names: Sequence[str], text: str, refusal: str) -> str:
    """The channel of this name, else of this number from 1."""
    if text in names:
        return text
    if text.isdecimal() and 1 <= int(text) <= len(names):
        return names[int(text) - 1]
    raise BadSetting(refusal)


def _hint(units: Mapping[str, str]) -> str:
    """The channels that could be fused, by their unit."""
    groups: dict[str, list[str]] = {}
    for name, unit in units.items():
        groups.setdefault(unit, []).append(name)
    several = [(unit, names) for unit, names in groups.items() if len(names) > 1][:MAX_HINTS]
    said = "; ".join(f"{', '.join(names[:MAX_HINTS])}{f' ({unit})' if unit else ''}" for unit, names in several)
    return f", such as {said}" if said else "; no two channels here have the same unit"
