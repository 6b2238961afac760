"""The one place that decides whether a filter fits a record; everything else quotes it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from kalscope.analysis.actions import Advice, ChooseFilter, GiveNoise, Status, UseStillStretch, as_sentences
from kalscope.analysis.diagnostics import Diagnostics
from kalscope.analysis.fit.correction import MIN_SAMPLES
from kalscope.analysis.fit.findings import Findings
from kalscope.analysis.fit.goal import Choice, Finding
from kalscope.analysis.fit.words import CHOOSE, KEEP, NO_FAULT, Known, findings_in_words
from kalscope.analysis.headlines import HEADLINES, NO_PAIR, NO_PAIR_HEADLINES, WORDS, Tone
from kalscope.analysis.held_out import halves_differ, held_out_clause, small_misfit
from kalscope.common.text import count, decibels, number
from kalscope.estimation.finding import Request
from kalscope.estimation.result import Estimate
from kalscope.estimation.verdict.words import below_step
from kalscope.filtering.arrays import scalar
from kalscope.filtering.steady_state import steady_state

HARDLY_DB = 3.0
"""Noise reduction below which a filtered curve looks like the raw one, dB."""

MAX_ADVICE = 2
"""Pieces of advice at a time: the first may make the later ones unnecessary."""

FEW = 100
"""Residuals below which only gross misfits show."""

ROUNDED: Finding = ("rounded", Advice("for a smaller r, let the sensor give finer steps"))
"""All that is said where r is a floor that the residuals need not reach."""

FIRST_IS_SPIKE: Finding = (
    "start",
    Advice("leave the first sample out of the record: it is a spike, and the filter takes it for the signal"),
)
"""All that is said where the filter has to find its way back from a spike: its residuals show mostly that."""

BEST = " No other q/r fits clearly better."
"""What a wrong band adds where the other pairs were compared: with momentum only an estimate compares them."""


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
    """The judgement in one to three words, such as "fits", "too slow", "as chosen"; `judge` always gives it."""
    tone: Tone = "note"
    """"good", nothing to correct; "note", something to know; "bad", something that should be corrected."""


def judge(
    residuals: Diagnostics | None,
    held_out: Diagnostics | None = None,
    estimate: Estimate | None = None,
    request: Request | None = None,
    still: tuple[int, int] | None = None,
    unit: str = "",
) -> Judgement:
    """Decide whether a filter fits a record.

    Args:
        residuals: the filter judged on the whole record; None where there is no pair.
        held_out: of the second half, by a pair that has not seen it; None where that was not possible.
        estimate: where q and r come from; None where they were chosen.
        request: what the user wanted and knew, from which the filter follows; None where the parameters were set by
            hand. The advice does not undo a goal such as a lag, and does not repeat a search.
        still: the still stretch that was found, its first sample and one past its last; where r is to be given, it
            is offered.
        unit: of the record, "" where unknown; the step of a sensor that rounds is named in it.
    """
    one = _judged(residuals, held_out, estimate, request)
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
    request: Request | None,
) -> Judgement:
    """The judgement of a record in which no still stretch is known."""
    if residuals is None:
        return _without_pair(estimate)
    choice = Choice.of(request)
    known = Known(
        estimated=estimate is not None and not choice.goal,
        robust=estimate is not None and getattr(estimate, "outliers", None) is not None,
        momentum_searched=request is not None and request.checked_momentum() is None,
        choice=choice,
    )
    if held_out is not None and held_out.n < MIN_SAMPLES:
        held_out = None
    rounded = estimate is not None and estimate.verdict == "below_resolution"
    if estimate is not None and estimate.outliers is not None and estimate.outliers[0]:
        said = [FIRST_IS_SPIKE]
    else:
        said = [ROUNDED] if rounded else findings_in_words(residuals.findings, known)
    halves = "" if held_out is None else held_out_clause(held_out)
    if not said:
        said = _beyond_residuals(held_out, estimate)
    if known.estimated and estimate is not None:
        said = _with_next_step(said, estimate, residuals.findings.lag_costs)
    if not said:
        return _without_misfit(residuals, held_out, choice, halves)
    status, first = said[0]
    headline = as_sentences(first.text) if status == "as_chosen" else _headline(status, residuals.findings, known)
    advice = tuple(advice for _, advice in said if as_sentences(advice.text) not in headline)[:MAX_ADVICE]
    word, tone = WORDS[status]
    return Judgement(
        status, headline, advice, halves, _band_word(residuals.findings) if status == "band" else word, tone
    )


def _with_next_step(said: list[Finding], estimate: Estimate, lag_costs: bool) -> list[Finding]:
    """The findings on the best fit, which end with an action where it may look worse than the previous filter."""
    told = any(advice.action is not None or status in ("start", "constant") for status, advice in said)
    if estimate.params is None or told:
        return said
    removed = scalar(steady_state(estimate.params).noise_reduction_db)
    reason = (
        f": the best statistical fit removes only {decibels(removed)} of the noise" if removed < HARDLY_DB else ""
    )
    if not reason and (lag_costs or not said):
        return said
    step = Advice(f"{KEEP}{reason}") if lag_costs else Advice(f"{CHOOSE}{reason}", ChooseFilter())
    return [*said[: MAX_ADVICE - 1], (said[0][0] if said else "weak", step)]


def _without_misfit(residuals: Diagnostics, held_out: Diagnostics | None, choice: Choice, halves: str) -> Judgement:
    """A filter without a misfit that is worth correcting."""
    n, refused = residuals.findings.n, residuals.findings.refused
    misfit = small_misfit(residuals, held_out)
    if n < FEW:
        headline = (
            f"Nothing in the {count(n)} residuals contradicts the filter, but so few show only gross misfits."
        )
    elif misfit:
        headline = f"The filter nearly fits: {misfit}, more than chance and too little to correct."
    else:
        without = f", {count(refused)} more rejected by the gate" if refused else ""
        headline = f"The filter fits: no misfit worth correcting in {count(n)} residuals{without}."
    word, tone = WORDS["fits"]
    return Judgement("fits", f"{_chosen(choice)}{headline}", (), halves, "nearly fits" if misfit else word, tone)


def _chosen(choice: Choice) -> str:
    return f"You chose {choice.goal}. " if choice.goal else ""


def _band_word(found: Findings) -> str:
    return _by_factor(found, "band too narrow", "band too wide")


def _by_factor(found: Findings, narrow: str, wide: str) -> str:
    return narrow if found.correction.r_factor > 1.0 else wide


def advice_words(judgement: Judgement) -> str:
    """The advice as clauses without capitals; where there is none, that there is no misfit, or the headline."""
    said = ". ".join(advice.text for advice in judgement.advice)
    return said or (NO_FAULT if judgement.status == "fits" else judgement.headline.rstrip("."))


def _headline(status: Status, found: Findings, known: Known) -> str:
    choice, compared = known.choice, known.estimated or not found.momentum
    if status == "too_few":
        return f"Too few samples to judge the filter: {count(found.n)} were scored, {MIN_SAMPLES} are needed."
    if status == "band":
        is_wrong, errors = _band_word(found).replace("band", "band is"), _by_factor(found, "smaller", "larger")
        return f"The ± {is_wrong}: it predicts {errors} errors.{BEST if compared else ''}"
    if status == "changes" and not compared:
        return "The size of the residuals changes along the record."
    return f"{_chosen(choice) if WORDS[status][1] == 'note' else ''}{HEADLINES[status]}"


def _without_pair(estimate: Estimate | None) -> Judgement:
    if estimate is None:
        return Judgement("no_pair", "There is no q and r to judge.", (), "", *WORDS["no_pair"])
    verdict = str(estimate.verdict)
    headline = NO_PAIR_HEADLINES.get(verdict) or f"{str(estimate.message).split('. ', 1)[0].rstrip('.')}."
    return Judgement("no_pair", headline, NO_PAIR.get(verdict, NO_PAIR["no_noise"][1:]), "", *WORDS["no_pair"])


def _beyond_residuals(held_out: Diagnostics | None, estimate: Estimate | None) -> list[Finding]:
    """The evidence against a filter whose residuals on the whole record are white and of the right size."""
    verdict = "" if estimate is None else str(estimate.verdict)
    if verdict == "flat":
        return [("vague", Advice("take r from a still stretch or the data sheet, or record longer", GiveNoise()))]
    if held_out is not None and halves_differ(held_out):
        size = f"{number(held_out.nis)} × what q and r predict, those of the first {number(held_out.nis_before)} ×"
        text = f"the squared errors of the second half are {size}: the noise or the movement changes"
        return [("changes", Advice(text))]
    return []
