"""A filter that was chosen: what the best statistical fit would do differently, and what the choice costs.

Advice on such a filter does not undo the choice; it says once, in numbers, how far the best fit to the record
differs.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

from kalscope.analysis.actions import (
    Advice,
    AllowMomentum,
    EstimateAgain,
    Scale,
    SetGate,
    SetRatio,
    Status,
    UnsetStart,
)
from kalscope.analysis.fit.correction import MIN_FACTOR
from kalscope.common.text import DURATIONS, number, trimmed
from kalscope.estimation.finding import Noise, Request
from kalscope.filtering.arrays import scalar
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state

Finding = tuple[Status, Advice]
"""What was found, and what is said about it."""

UNDOING = (Scale, SetRatio, AllowMomentum, EstimateAgain)
"""Actions that end a choice."""

KEEPING = (SetGate, UnsetStart)
"""Actions that correct a filter and leave its q/r: they come before what the choice costs."""

NUMBER = r"(\d[\d.e+-]*)"

HOW = (
    *(
        (re.compile(rf"a lag of {NUMBER} {unit}{'?' if len(unit) > 3 else ''}\b"), "lag_s", length)  # 1 day, 2 days
        for unit, length in DURATIONS
    ),
    (re.compile(f"a lag of {NUMBER} samples"), "lag_samples", 1.0),
    (re.compile(f"a −3 dB cut-off at {NUMBER} Hz"), "cutoff_hz", 1.0),
    (re.compile(f"{NUMBER} dB less noise"), "noise_reduction_db", 1.0),
    (re.compile(f"the gain {NUMBER}"), "gain", 1.0),
)
"""How a tuning says that a target was chosen, the target, and its unit."""

WITH_MOMENTUM = "with this momentum"
"""Where pairs were compared at the momentum of the filter only."""

ROUNDING = 1e-3
"""Relative difference that four digits in a tuning file, and three of a rounded q, may make."""

TRUSTED = {"from a still stretch": "that stretch", "from the data sheet": "the data sheet"}
"""What a given r relies on, by where it comes from."""


@dataclass(frozen=True)
class Choice:
    """What the user decided about a filter, in words."""

    goal: str = ""
    """What fixes q/r, such as "a lag of 50 ms"; "" = nothing."""
    faster: str = "fast movement"
    """The movement that such a filter cannot follow, such as "movement faster than 50 ms"."""
    noise: str = ""
    """Where r was given, as in "from the data sheet"; "" = it was not."""

    @staticmethod
    def of(request: Request | None) -> Choice:
        """The choice that a request holds."""
        if request is None:
            return Choice()
        noise = "" if request.noise == Noise() else request.noise.origin
        if "cutoff_hz" in request.target:
            return Choice(request.goal, f"movement above {request.target['cutoff_hz']:.4g} Hz", noise)
        if "lag_s" in request.target or "lag_samples" in request.target:
            lag = request.goal.removeprefix("a lag of ").split(" and ")[0]
            return Choice(request.goal, f"movement faster than {lag}", noise)
        return Choice(request.goal, noise=noise)

    def __bool__(self) -> bool:
        return bool(self.goal or self.noise)


def request_in(how: str, r: float) -> Request | None:
    """What a tuning says about the origin of its q and r, where the search is no longer known; None = no choice.

    Args:
        how: as `Found.how` or a tuning file says it. Its numbers have four digits: for words, not for a search.
        r: the r of the tuning, given where `how` says so.
    """
    given = any(f"r {origin}" in how for origin in (*TRUSTED, "as given"))
    noise = Noise(r=r) if given and r > 0.0 else Noise()
    for pattern, name, unit in HOW:
        if found := pattern.match(how):
            return Request(target={name: unit * float(found[1])}, noise=noise)
    if found := re.match(f"q/r = {NUMBER}", how):
        return Request(ratio=float(found[1]), noise=noise)
    return Request(noise=noise) if noise != Noise() else None


def still_met(request: Request | None, params: FilterParams, sample_period: float | None) -> Request | None:
    """The request with its goal only where the filter meets it: another sample period changes a lag in ms."""
    if request is None or not request.target:
        return request
    name, value = next(iter(request.target.items()))
    now = scalar(getattr(steady_state(params, sample_period), name))
    if math.isclose(now, value, rel_tol=ROUNDING):
        return request
    return None if request.noise == Noise() else Request(noise=request.noise)


def with_choice(said: list[Finding], choice: Choice, momentum: bool) -> list[Finding]:
    """The findings on a chosen filter: what can be corrected, what the choice costs, and the rest as notes.

    A filter that is slower than the best leaves waves in its residuals, which say nothing about the model.
    """
    costs: list[Finding] = []
    rest: list[Finding] = []
    slow = False
    fit = f"the best statistical fit {WITH_MOMENTUM}" if momentum else "the best statistical fit"
    for status, advice in said:
        if isinstance(advice.action, Scale) and _ends(advice.action, choice):
            slow = bool(choice.goal) and advice.action.q_factor > advice.action.r_factor
            costs.append(("as_chosen", Advice(_costs(choice, advice.action, fit))))
        elif not (choice.goal and status in ("too_slow", "too_fast")):  # a factor too small for a change
            rest.append((status, _harmless(advice, choice)))
    rest = [one for one in rest if not (slow and one[0] == "structure")]
    mended = [one for one in rest if isinstance(one[1].action, KEEPING)]
    return [*mended, *costs, *(one for one in rest if one not in mended)]


def _ends(scale: Scale, choice: Choice) -> bool:
    """Whether a change of q and r ends the choice: another q/r than chosen, or another r than given."""
    moved = (scale.q_factor / scale.r_factor if choice.goal else 1.0, scale.r_factor if choice.noise else 1.0)
    return any(abs(math.log(factor)) >= math.log(MIN_FACTOR) for factor in moved)


def _harmless(advice: Advice, choice: Choice) -> Advice:
    """The advice without an action that undoes the choice, and without the words for it."""
    action = advice.action
    if not isinstance(action, UNDOING) or (isinstance(action, Scale) and not _ends(action, choice)):
        return advice
    return replace(advice, text=advice.text.split("; ")[0], action=None)


def _costs(choice: Choice, best: Scale, fit: str) -> str:
    """What the best fit would do differently, as clauses of two sentences."""
    ratio = best.q_factor / best.r_factor
    if choice.goal and abs(math.log(ratio)) >= math.log(MIN_FACTOR):
        change = f"({'q' if 1.0 / MIN_FACTOR < best.r_factor < MIN_FACTOR else 'q/r'} {larger(ratio)})"
        if ratio > 1.0:
            best_fit = f"follow faster {change}, so {choice.faster} is smoothed away"
        else:
            best_fit = f"smooth more {change}, so noise that it would remove stays"
        return f"you chose {choice.goal}. {fit} would {best_fit}"
    origin = f" {choice.noise}" if choice.noise in TRUSTED else ""
    return (
        f"you gave r{origin}. {fit} has an r "
        f"{larger(best.r_factor)}: keep yours if you trust {TRUSTED.get(choice.noise, 'it')}"
    )


def times(factor: float) -> str:
    """A factor in words: "1.6 ×", "4 ×", "1000 × or more"; of a decrease, the divisor."""
    size = factor if factor > 1.0 else 1.0 / factor
    if size >= 900.0:
        return "1000 × or more"
    return f"{trimmed(size, 2 if size < 3.0 else 1)} ×"


def larger(ratio: float) -> str:
    """By how much, as in "about 500 × larger"."""
    way, size = ("larger", ratio) if ratio > 1.0 else ("smaller", 1.0 / ratio)
    return f"more than 1000 × {way}" if size >= 1000.0 else f"about {number(size, 2 if size < 3.0 else 1)} × {way}"
