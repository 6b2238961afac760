"""What the fused value is worth beside the best single sensor: an idle-time computation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from kalscope.common.text import percent
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state
from kalscope_app.session.fusion import Fusion
from kalscope_app.session.state import State


@dataclass(frozen=True)
class Judged:
    """What is said about the fused sensors."""

    word: str
    """On the button above the tabs."""
    tone: Literal["good", "note", "bad"]
    """Its colour."""
    headline: str
    """How much better than the best single sensor; plain text."""
    notes: tuple[str, ...]
    """Who disagrees, and what cannot be known; plain text."""


def judge_fused(state: State) -> Judged | None:
    """What is to be said about the fused sensors on screen; None where one channel is."""
    fusion = state.fusion
    if fusion is None:
        return None
    notes = () if fusion.estimate is None else fusion.estimate.notes
    return Judged("fused", "good", headline_of(fusion), tuple(notes))


def headline_of(fusion: Fusion) -> str:
    """The predicted error beside that of the best sensor alone."""
    params, names = fusion.params, fusion.used.sensors
    if len(names) == 1:
        return f"Only {names[0]} takes part: nothing is gained."
    alone = [_error(FilterParams(params.q, float(r), momentum=params.momentum)) for r in params.r / params.gain**2]
    best = min(range(len(names)), key=alone.__getitem__)
    gained = 1.0 - _error(params.as_single) / alone[best] if alone[best] > 0.0 else 0.0
    return f"{percent(max(gained, 0.0))} less error than {names[best]} alone, the best sensor, is predicted."


def _error(params: FilterParams) -> float:
    return math.sqrt(float(steady_state(params).p))
