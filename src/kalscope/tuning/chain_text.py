"""A chain of filters as a line that a user types: "median 5, one-euro 0.02 0.7 0.1"; "kalman" is the Kalman filter.

The name of a filter is followed by its numbers, in the order of its fields. The names are those of the tuning file.
"""

from __future__ import annotations

from dataclasses import astuple, fields
from typing import Any

from kalscope.common.text import typed_number
from kalscope.errors import BadSetting
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.stages import Median, Stage
from kalscope.tuning.chain_table import KALMAN, STAGES

EXAMPLE = "median 5, one-euro 0.02 0.7 0.1"
"""A chain of two."""


def typed_chain(text: str) -> Chain | None:
    """The chain in a line that a user typed; None for the Kalman filter alone.

    Raises:
        BadSetting: it is not such a line, or the filter cannot have these numbers.
    """
    parts = [part.split() for part in text.lower().split(",")]
    if len(parts) > 2 or not all(parts):
        raise BadSetting(f'a chain must be a filter, or a median and a filter: "{EXAMPLE}" (got {text[:60]!r})')
    then = None if parts[-1] == [KALMAN] else _stage(parts[-1])
    first = _stage(parts[0]) if len(parts) == 2 else Median(1)
    if not isinstance(first, Median):
        raise BadSetting(f'the first filter of two must be a median: "{EXAMPLE}" (got {text[:60]!r})')
    return None if first.window == 1 and then is None else Chain(first.window, then)


def chain_text(chain: Chain | None) -> str:
    """The line for a chain; `typed_chain` returns the same chain for it, to the last bit."""
    if chain is None:
        return KALMAN
    last = KALMAN if chain.then is None else _text(chain.then)
    return last if chain.median == 1 else f"median {chain.median}, {last}"


def _stage(words: list[str]) -> Stage:
    name, *numbers = words
    if name not in STAGES:
        raise BadSetting(f"a filter of a chain must be one of {', '.join(STAGES)}, {KALMAN} (got {name[:40]!r})")
    wanted = [one.name for one in fields(STAGES[name])]
    if len(numbers) != len(wanted):
        raise BadSetting(f"{name} must have {len(wanted)} numbers, {', '.join(wanted)} (got {len(numbers)})")
    values: list[Any] = [typed_number(f"{key} of {name}", text) for key, text in zip(wanted, numbers, strict=True)]
    return STAGES[name](*values)


def _text(stage: Stage) -> str:
    name = next(name for name, kind in STAGES.items() if isinstance(stage, kind))
    return " ".join((name, *map(repr, astuple(stage))))
