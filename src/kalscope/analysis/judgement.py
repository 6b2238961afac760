"""The one place that decides whether a filter fits a record; everything else quotes it."""

from __future__ import annotations

from dataclasses import dataclass

from kalscope.analysis.actions import Advice, Status
from kalscope.analysis.diagnostics import Diagnostics
from kalscope.estimation.result import Estimate


@dataclass(frozen=True)
class Judgement:
    """Whether a filter fits a record, and what to do where it does not."""

    status: Status
    """The most urgent finding in one word."""
    headline: str
    """One sentence with capital and full stop; it is true of the record whatever else is found."""
    advice: tuple[Advice, ...] = ()
    """What to do, most urgent first, two at most; () where nothing is to be done."""


def judge(
    residuals: Diagnostics | None,
    held_out: Diagnostics | None = None,
    estimate: Estimate | None = None,
    disagreement: str = "",
    chosen: str = "",
) -> Judgement:
    """Decide whether a filter fits a record.

    Args:
        residuals: the filter judged on the whole record; None where there is no pair.
        held_out: of the second half, by a pair that has not seen it; None where that was not possible.
        estimate: where q and r come from; None where they were chosen.
        disagreement: how the methods of estimation differ, "" where they agree or were not asked.
        chosen: what the user asked for, such as "a lag of 50 ms"; the advice then does not undo it.
    """
    del held_out, estimate, disagreement, chosen
    if residuals is None:
        return Judgement("no_pair", "There is no q and r to judge.")
    text = residuals.advice
    status = "fits" if text == "no misfit worth correcting" else "structure"
    return Judgement(status, f"{text[:1].upper()}{text[1:]}.")
