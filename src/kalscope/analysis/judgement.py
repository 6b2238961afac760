"""The one place that decides whether a filter fits a record; everything else quotes it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from kalscope.analysis.actions import (
    Advice,
    ChooseFilter,
    EstimateAgain,
    GiveNoise,
    RecordLonger,
    Status,
    UseStillStretch,
)
from kalscope.analysis.diagnostics import Diagnostics
from kalscope.analysis.fit.correction import MIN_FACTOR, MIN_SAMPLES
from kalscope.analysis.fit.findings import Findings
from kalscope.analysis.fit.words import CHOOSE, NO_FAULT, Finding, Known, findings_in_words
from kalscope.analysis.residual_tests import dot
from kalscope.common.text import count, number
from kalscope.estimation.finding import Request
from kalscope.estimation.result import Estimate
from kalscope.estimation.verdict_text import below_step

MAX_ADVICE = 2
"""Pieces of advice at a time: the first may make the later ones unnecessary."""

FEW = 100
"""Residuals below which only gross misfits show."""

CERTAIN = 4.0
"""Standard errors by which the second half must differ before it is said."""

BLOCKS = 16
"""Blocks of the second half from whose scatter the standard error of its mean v²/s comes."""

Tone = Literal["good", "note", "bad"]
"""How a judgement sounds: nothing to correct; something to know; something that should be corrected."""

WORDS: dict[Status, tuple[str, Tone]] = {
    "fits": ("fits", "good"),
    "rounded": ("coarse steps", "note"),
    "vague": ("any ratio fits", "note"),
    "too_few": ("too few samples", "note"),
    "constant": ("constant signal", "note"),
    "start": ("wrong start", "bad"),
    "spikes": ("spikes", "bad"),
    "bursts": ("noise bursts", "note"),
    "too_slow": ("too slow", "bad"),
    "too_fast": ("too fast", "bad"),
    "band": ("wrong band", "bad"),
    "edge": ("variance is 0", "bad"),
    "structure": ("model misfit", "note"),
    "changes": ("noise changes", "note"),
    "steps": ("signal steps", "note"),
    "gate": ("gate too narrow", "bad"),
    "shape": ("unusual noise", "note"),
    "methods_differ": ("methods differ", "note"),
    "no_pair": ("no result", "bad"),
}
"""One or two plain words for each status, and their tone."""

HEADLINES: dict[Status, str] = {
    "start": "The filter starts too far from the signal.",
    "spikes": "The record has spikes, which the filter takes for signal.",
    "bursts": "Large errors are too many, or too close together, for single outliers.",
    "too_slow": "The filter is too slow for this record.",
    "too_fast": "The filter is too fast for this record: it lets through noise that could be removed.",
    "band": "q and r are wrong by one factor: the band is wrong, but no other ratio fits better.",
    "edge": "With a variance of 0 this filter does not fit the record.",
    "structure": "The record holds more than the model describes.",
    "changes": "The record changes as it goes on: one pair cannot fit all of it.",
    "gate": "The outlier gate refuses more than single outliers.",
    "shape": "The errors of the filter are far from normally distributed.",
    "steps": "The signal steps: no q both follows the steps and smooths well between them.",
    "constant": "The signal is constant: there is nothing to judge the filter by.",
    "rounded": "The readings are rounded more coarsely than their noise, or held.",
    "vague": "The filter fits, and so does any other q/r: the record cannot tell them apart.",
    "methods_differ": "Predictions one sample ahead fit, but other methods of estimation contradict the model.",
}
"""What each status says of the record; the others hold a number or quote the estimate."""

ROUNDED: Finding = ("rounded", Advice("for a smaller r, let the sensor give finer steps"))
"""All that is said where r is a floor that the residuals need not reach."""

FIRST_IS_SPIKE: Finding = (
    "start",
    Advice("leave the first sample out of the record: it is a spike, and the filter takes it for the signal"),
)
"""All that is said where the filter has to find its way back from a spike: its residuals show mostly that."""

NO_PAIR_HEADLINES = {
    "no_noise": "No noise can be identified: every change looks like movement.",
    "no_movement": "No movement can be identified: a constant plus noise explains this record best.",
}
"""Headlines of verdicts whose message begins with something else, such as spikes."""

NO_PAIR: dict[str, tuple[Advice, ...]] = {
    "no_noise": (
        Advice("take r from a still stretch or the data sheet", GiveNoise()),
        Advice("choose the lag or the cut-off that you can accept", ChooseFilter()),
    ),
    "no_movement": (
        Advice("keep this r and choose the lag or the cut-off that you can accept", ChooseFilter()),
        Advice("record while the signal moves", RecordLonger(0)),
    ),
    "too_few": (Advice("record longer", RecordLonger(8)),),
    "constant": (Advice("record while the signal moves, or take r from the data sheet", GiveNoise()),),
    "irregular": (Advice("estimate by maximum likelihood, which takes irregular sampling", EstimateAgain()),),
    "too_many_outliers": (Advice("choose the lag or the cut-off that you can accept", ChooseFilter()),),
}
"""What to do where the estimate gives no pair, by its verdict."""


@dataclass(frozen=True)
class Judgement:
    """Whether a filter fits a record, and what to do where it does not."""

    status: Status
    """The most urgent finding in one word."""
    headline: str
    """One sentence with capital and full stop; it is true of the record whatever else is found."""
    advice: tuple[Advice, ...] = ()
    """What to do, most urgent first, two at most; () where nothing is to be done."""
    held_out: str = ""
    """What the second half says of a pair that has not seen it, one clause; "" where that was not possible."""
    word: str = ""
    """The judgement in one or two words, such as "fits", "too slow", "as chosen"; `judge` always gives it."""
    tone: Tone = "note"
    """"good", nothing to correct; "note", something to know; "bad", something that should be corrected."""


def judge(
    residuals: Diagnostics | None,
    held_out: Diagnostics | None = None,
    estimate: Estimate | None = None,
    disagreement: str = "",
    request: Request | None = None,
    still: tuple[int, int] | None = None,
    unit: str = "",
) -> Judgement:
    """Decide whether a filter fits a record.

    Args:
        residuals: the filter judged on the whole record; None where there is no pair.
        held_out: of the second half, by a pair that has not seen it; None where that was not possible.
        estimate: where q and r come from; None where they were chosen.
        disagreement: how the methods of estimation differ, "" where they agree or were not asked.
        request: what the user wanted and knew, from which the filter follows; None where the parameters were set by
            hand. The advice does not undo a goal such as a lag, and does not repeat a search.
        still: the still stretch that was found, its first sample and one past its last; where r is to be given, it
            is offered.
        unit: of the record, "" where unknown; the step of a sensor that rounds is named in it.
    """
    one = _judged(residuals, held_out, estimate, disagreement, request)
    word, tone = WORDS[one.status]
    one = replace(one, word=word, tone=tone)
    if one.status == "rounded" and estimate is not None and _noise_is_below_step(estimate):
        one = replace(one, headline=below_step(float(estimate.resolution), unit))
    return one if still is None else replace(one, advice=tuple(_from_still(advice, still) for advice in one.advice))


def _noise_is_below_step(estimate: Estimate) -> bool:
    """Whether the noise without that of rounding, Δ²/12, is smaller than the step Δ of the readings."""
    step = float(estimate.resolution)
    return step > 0.0 and float(estimate.r) < step * step * (1.0 + 1.0 / 12.0)


def needs_noise(estimate: Estimate | None) -> bool:
    """Whether the record leaves r open, so that a still stretch is worth a search."""
    return estimate is not None and str(estimate.verdict) in ("no_noise", "flat")


def _from_still(advice: Advice, still: tuple[int, int]) -> Advice:
    if not isinstance(advice.action, GiveNoise):
        return advice
    return Advice("take r from the still stretch that the record shows", UseStillStretch(*still))


def _judged(
    residuals: Diagnostics | None,
    held_out: Diagnostics | None,
    estimate: Estimate | None,
    disagreement: str,
    request: Request | None,
) -> Judgement:
    """The judgement of a record in which no still stretch is known."""
    if residuals is None:
        return _without_pair(estimate)
    chosen = "" if request is None else request.goal
    known = Known(
        estimated=estimate is not None and not chosen,
        robust=estimate is not None and getattr(estimate, "outliers", None) is not None,
        momentum_searched=request is not None and request.checked_momentum() is None,
        chosen=chosen,
    )
    if held_out is not None and held_out.n < MIN_SAMPLES:
        held_out = None
    rounded = estimate is not None and estimate.verdict == "below_resolution"
    if estimate is not None and estimate.outliers is not None and estimate.outliers[0]:
        said = [FIRST_IS_SPIKE]
    else:
        said = [ROUNDED] if rounded else findings_in_words(residuals.findings, known)
    halves = "" if held_out is None else _held_out_clause(held_out)
    if not said:
        said = _beyond_residuals(held_out, estimate, disagreement)
    advice = tuple(advice for _, advice in said[:MAX_ADVICE])
    status = said[0][0] if said else "fits"
    return Judgement(status, _headline(status, residuals.findings), advice, halves)


def advice_words(judgement: Judgement) -> str:
    """The advice as clauses without capitals, or that there is nothing to advise."""
    return ". ".join(advice.text for advice in judgement.advice) or NO_FAULT


def _headline(status: Status, found: Findings) -> str:
    n = found.n
    if status == "too_few":
        return f"Too few samples to judge the filter: {count(n)} were scored, {MIN_SAMPLES} are needed."
    if status != "fits":
        return HEADLINES[status]
    if n < FEW:
        return f"Nothing in the {count(n)} residuals speaks against the filter, but so few show only gross misfits."
    without = f", {count(found.refused)} more refused by the gate" if found.refused else ""
    return f"The filter fits: no misfit worth correcting in {count(n)} residuals{without}."


def _without_pair(estimate: Estimate | None) -> Judgement:
    if estimate is None:
        return Judgement("no_pair", "There is no q and r to judge.")
    verdict = str(estimate.verdict)
    headline = NO_PAIR_HEADLINES.get(verdict) or f"{str(estimate.message).split('. ', 1)[0].rstrip('.')}."
    return Judgement("no_pair", headline, NO_PAIR.get(verdict, ()))


def _beyond_residuals(held_out: Diagnostics | None, estimate: Estimate | None, disagreement: str) -> list[Finding]:
    """What speaks against a filter whose residuals on the whole record are white and of the right size."""
    verdict = "" if estimate is None else str(estimate.verdict)
    if verdict == "flat":
        return [("vague", Advice("take r from a still stretch or the data sheet, or record longer", GiveNoise()))]
    if held_out is not None and _differs(held_out):
        size = f"{number(held_out.nis)} × what q and r predict, those of the first {number(held_out.nis_before)} ×"
        text = f"the squared errors of the second half are {size}: the noise or the movement changes"
        return [("changes", Advice(text))]
    if disagreement:
        reason = f"{disagreement[0].lower()}{disagreement[1:].rstrip('.')}"
        return [("methods_differ", Advice(f"{CHOOSE}: {reason}", ChooseFilter()))]
    return []


def _held_out_clause(held_out: Diagnostics) -> str:
    """The size of the errors of the second half, without a verdict on it that the whole record could contradict."""
    if held_out.nis_low <= held_out.nis <= held_out.nis_high:
        return "squared errors are as large as q and r predict"
    size = f"squared errors are {number(held_out.nis)} × what q and r predict"
    if _differs(held_out):
        return f"{size}, on the first half {number(held_out.nis_before)} ×: the halves differ"
    if 1.0 / MIN_FACTOR < held_out.nis < MIN_FACTOR:
        return f"{size}, too little to matter"
    return f"{size}, {'as on the first half' if _is_alike(held_out) else 'but they scatter too much to tell why'}"


def _is_alike(held_out: Diagnostics) -> bool:
    """Whether the mean v²/s of both halves is the same within a factor that matters; both may be 0."""
    return held_out.nis_before / MIN_FACTOR <= held_out.nis <= held_out.nis_before * MIN_FACTOR


def _differs(held_out: Diagnostics) -> bool:
    """Whether the mean v²/s of the halves differs by a factor that matters and by more than its own scatter.

    The scatter is that of blocks, so heavy tails and changes within the half widen it; √2 because that of the first
    half is as uncertain.
    """
    e = held_out.e[np.isfinite(held_out.e)]
    if len(e) < 4 * BLOCKS or _is_alike(held_out):
        return False
    means = np.array([dot(part, part) / len(part) for part in np.array_split(e, BLOCKS)])
    error = math.sqrt(2.0 * float(means.var(ddof=1)) / BLOCKS)
    return abs(held_out.nis - held_out.nis_before) > CERTAIN * error
