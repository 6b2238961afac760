"""The chain of a channel as a table of the tuning file."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from kalscope.errors import BadFile
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.stages import (
    Butterworth,
    Exponential,
    Median,
    MovingAverage,
    OneEuro,
    PowerOfTwo,
    Stage,
)
from kalscope.tuning import toml_text as toml

KALMAN = "kalman"
"""What the file calls the channel's own Kalman filter behind a median."""
STAGES: dict[str, type[Stage]] = {
    "moving-average": MovingAverage,
    "exponential": Exponential,
    "power-of-two": PowerOfTwo,
    "median": Median,
    "butterworth": Butterworth,
    "one-euro": OneEuro,
}
"""What the file calls each classic filter."""

_SETTINGS = dict.fromkeys(one.name for stage in STAGES.values() for one in fields(stage))
"""Every key that a classic filter has, with None: those of another filter are removed from the file."""


def plain_chain(chain: Chain | None) -> dict[str, Any] | None:
    """The chain as a table; None = the key is absent."""
    if chain is None:
        return None
    names = {stage: name for name, stage in STAGES.items()}
    then = chain.then
    settings = {} if then is None else {one.name: getattr(then, one.name) for one in fields(then)}
    name = KALMAN if then is None else names[type(then)]
    return {"median": chain.median if chain.median > 1 else None, "filter": name, **_SETTINGS, **settings}


def chain_in(value: object, where: str) -> Chain:
    """The chain in a table of the file.

    Args:
        value: What the file contains.
        where: How messages name the channel.

    Raises:
        BadFile: It is not a table, or its filter or one of its numbers is missing or of another kind.
        BadSetting: A number is out of its range.
    """
    here = f"the chain of {where}"
    table = toml.table_of(value, here)
    name = toml.text_of(table, "filter", here)
    if name != KALMAN and name not in STAGES:
        known = ", ".join(f'"{one}"' for one in STAGES)
        raise BadFile(f'filter of {here} must be {known} or "{KALMAN}" (got {toml.shown(name)})')
    median: Any = toml.number_of({"median": 1, **table}, "median", here)
    if name == KALMAN:
        return Chain(median)
    settings: Any = {one.name: toml.number_of(table, one.name, here) for one in fields(STAGES[name])}
    return Chain(median, STAGES[name](**settings))
