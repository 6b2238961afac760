"""Words that the summary and the details of `kalscope tune` share."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable

from kalscope.cli.tune.answer import CHOSEN
from kalscope.common.text import gate_text, lag_in_full, number
from kalscope.filtering.params import FilterParams

WIDTH = 96
"""Columns of the page."""

VERDICT_WORDS = {
    CHOSEN: "chosen",
    "ok": "ok",
    "no_noise": "r → 0: no noise seen",
    "no_movement": "q → 0: no movement seen",
    "flat": "vague: any ratio fits",
    "too_few": "too few samples",
    "constant": "all readings equal",
    "bad_unit": "numbers out of range",
    "irregular": "needs regular sampling",
    "not_converged": "not converged",
    "too_many_outliers": "too many spikes",
    "below_resolution": "noise below the rounding step",
    "only_spikes": "r → 0 except for spikes",
}
"""Verdicts as they are shown in a table."""


def between(low: float, high: float, largest: float = math.inf, words: Callable[[float], str] = number) -> str:
    """A range from 0 … `largest` in words: "2.4 to 6.2", "up to 6.2", "2.4 or more", "any"."""
    if low == 0.0:
        return "any" if high >= largest else f"up to {words(high)}"
    return f"{words(low)} or more" if high >= largest else f"{words(low)} to {words(high)}"


def wrapped(text: str) -> list[str]:
    """The text in lines of the page; options and numbers stay whole."""
    return textwrap.wrap(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def momentum_and_gate(params: FilterParams, period: float | None) -> str:
    """What a filter has beside its variances."""
    momentum = f"momentum {lag_in_full(params.momentum, period)}" if params.momentum else "no momentum"
    return f"{momentum}, {'no gate' if params.gate is None else f'gate {gate_text(params.gate)}'}"
