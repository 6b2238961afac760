"""The one place that decides whether a filter fits a record; everything else quotes it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from kalscope.analysis.actions import (
    AddMomentum,
    AddNotch,
    AddTwoSpeeds,
    ChooseFilter,
    GiveNoise,
    RecordLonger,
    UseStillStretch,
)
from kalscope.analysis.correction import MIN_SAMPLES
from kalscope.analysis.diagnostics import Diagnostics
from kalscope.analysis.findings import (
    CHOOSE,
    KEEP,
    STATUSES,
    WITH_MOMENTUM,
    Evidence,
    Finding,
    Known,
    Tone,
    as_sentences,
    findings_of,
)
from kalscope.common.numbers import Array, ShortRepr
from kalscope.common.text import count, decibels, number, percent
from kalscope.estimation.hum import Line
from kalscope.estimation.request import Request
from kalscope.estimation.result import Estimate, Shared
from kalscope.estimation.two_speeds import TwoSpeeds
from kalscope.estimation.verdict import below_step
from kalscope.filtering.steady import steady_state

HARDLY_DB = 3.0
"""Noise reduction below which a filtered curve looks like the raw one, dB."""

MAX_ADVICE = 2
"""Findings at a time: the first may make the later ones unnecessary."""

LEAST_GAIN = 0.05
"""Share by which errors must be smaller with momentum, to advise it."""

FEW = 100
"""Residuals below which only gross misfits show."""


CLOSE = 0.005
"""Relative differences below this count as none: both errors read the same."""

Stretch = tuple[int, int]
"""First row, and one past the last; (0, 0) for none."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """How the readings of the second half are predicted one row ahead. There is no truth to compare with."""

    fused: float
    """Root mean square error of the prediction, the noise of the predicted readings included, unit."""
    single: Array
    """The same of predictions by each sensor alone, shape (sensors,)."""
    best: int
    """The sensor that predicts best."""
    saved: float
    """The share by which fusing predicts better than the best sensor alone, below 0 if worse; 0 by chance."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Judgement(ShortRepr):
    """Whether a filter fits a record, and what to do where it does not. No number is ever NaN.

    It is of a channel, of fused sensors, or of one of these, whose findings are its faults.
    """

    status: str
    """The most urgent finding: one of STATUSES."""
    headline: str
    """One sentence with capital and full stop; it is true of the record whatever else is found."""
    word: str
    """The judgement in a few words, such as "fits", "too slow", "check 2 sensors"."""
    tone: Tone
    """"good", nothing to correct; "note", something to know; "bad", something that should be corrected."""
    findings: tuple[Finding, ...] = ()
    """What was found and what to do, most urgent first, of a channel two at most; () where nothing is to do."""
    second_half: str = ""
    """How the second half is predicted, of a channel as a clause; "" where that was not possible."""
    residuals: Diagnostics | None = None
    """Of a channel: the filter on the whole record."""
    held_out: Diagnostics | None = None
    """Of a channel: a pair that has not seen the second half, on that half."""

    sensors: tuple[Judgement, ...] = ()
    """Of fused sensors: one a sensor, in the order of the columns."""
    error: float = math.inf
    """Error of the fused value, or of the quantity by this sensor alone, 1 σ, unit, predicted by the model for the
    rows in which every sensor has begun; inf where it is not known."""
    best: int = 0
    """The sensor with the smallest error alone."""
    prediction: Prediction | None = None
    """How well all sensors and each predict the second half; None where there are too few rows."""
    shares: str = ""
    """What each sensor contributes, one sentence; "" of one sensor."""
    shared: Shared | None = None
    """The sensors whose noises are correlated; None where none shows."""

    name: str = ""
    """Of one of the sensors: its name."""
    share: float = 1.0
    """Its share of the fused value while all sensors answer, 0 … 1."""
    answered: float = 1.0
    """Share of the rows in which it has a reading."""
    error_without: float = math.inf
    """Error where it drops out and the others continue, unit; inf where it is the only one."""
    shares_without: Array = field(default_factory=lambda: np.zeros(1))
    """Shares of all sensors then, shape (sensors,): that of this one is 0."""
    drift: float = 0.0
    """By how much its difference from the others moves within the record, unit; 0 where not more than by chance."""
    noise_ratio: float = 1.0
    """Largest over smallest variance of its noise within the record; 1 where not more than by chance."""
    spikes: int = 0
    """Readings far off that no other sensor confirms."""
    stuck: Stretch = (0, 0)
    """Its longest stretch of equal readings; (0, 0) where none is odd."""
    silent: Stretch = (0, 0)
    """The same of its longest stretch without a reading."""
    if_it_fails: tuple[str, ...] = ()
    """What happens when it drops out, and when it sticks."""

    @property
    def faults(self) -> tuple[str, ...]:
        """The statuses of the findings; () where nothing was found."""
        return tuple(one.status for one in self.findings)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Of fused sensors: headline, second half, shares, and faults."""
        first = (one for one in (self.headline, self.second_half, self.shares) if one)
        return *first, *(one.text for one in self.findings)


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
    if residuals is None:  # only of several sensors: the message names the sensor, and says what to do
        headline = "There is no q and r to judge." if estimate is None else estimate.message
        one = _judgement("no_pair", headline, (NOISE, LAG) if needs_noise(estimate) else ())
    else:
        one = replace(_of_pair(residuals, held_out, estimate, request), residuals=residuals, held_out=held_out)
    step = 0.0 if estimate is None else estimate.resolution
    if one.status == "rounded" and estimate is not None and 0.0 < estimate.r < step * step * (1.0 + 1.0 / 12.0):
        # the noise without that of rounding, Δ²/12, is smaller than the step Δ of the readings
        one = replace(one, headline=below_step(estimate.resolution, unit))
    if still is None:
        return one
    take = Finding(one.status, "take r from the still stretch that the record shows", UseStillStretch(*still))
    findings = (take if isinstance(each.action, GiveNoise) else each for each in one.findings)
    return replace(one, findings=tuple(findings))


def with_momentum(one: Judgement, tau: float, gain: float) -> Judgement:
    """The judgement of a filter whose errors would be smaller by the share `gain` with the momentum τ."""
    if gain < LEAST_GAIN:
        return one
    text = f"with momentum the errors at the same lag would be {percent(gain)} smaller"
    return replace(one, findings=(Finding(one.status, text, AddMomentum(tau)), *one.findings)[:MAX_ADVICE])


def with_two_speeds(one: Judgement, found: TwoSpeeds | None) -> Judgement:
    """The judgement of a filter with one speed on a record in which two were found; None = they were not."""
    if found is None or found.gain < LEAST_GAIN:
        return one
    text = f"the signal rests and moves: two speeds predict it with {percent(found.gain)} smaller errors than one"
    return replace(one, findings=(Finding(one.status, text, AddTwoSpeeds()), *one.findings)[:MAX_ADVICE])


def with_notch(one: Judgement, line: Line | None, sample_period: float | None) -> Judgement:
    """The judgement of a filter without a notch on a record with this narrow line; None = there is none."""
    text = "" if line is None else line.advice(sample_period)
    return (
        replace(one, findings=(Finding(one.status, text, AddNotch()), *one.findings)[:MAX_ADVICE]) if text else one
    )


def needs_noise(estimate: Estimate | None) -> bool:
    """Whether the record leaves r open, so that a still stretch is worth a search."""
    return estimate is not None and estimate.verdict in ("no_noise", "flat")


NOISE = Finding("no_pair", "take r from a still stretch or the data sheet", GiveNoise())
LAG = Finding("no_pair", CHOOSE, ChooseFilter())
MOVE = Finding("no_pair", "record while the signal moves", RecordLonger())
"""What to do where the record shows no noise, or no movement."""


def _of_pair(
    residuals: Diagnostics, held_out: Diagnostics | None, estimate: Estimate | None, request: Request | None
) -> Judgement:
    """The judgement of a pair on a record in which no still stretch is known."""
    evidence, outliers = residuals.evidence, None if estimate is None else estimate.outliers
    known = Known(
        robust=outliers is not None, momentum_searched=request is not None and request.checked_momentum() is None
    ).with_request(request)
    known = replace(known, estimated=estimate is not None and not known.goal)
    if held_out is not None and held_out.n < MIN_SAMPLES:
        held_out = None
    if request is not None and request.setting:
        status = "slow" if request.setting == "slow" else "setting"
        lost = replace(LAG, text="choose the lag by the movement that you can lose")
        advice = (LAG, MOVE) if status == "slow" else (lost, NOISE) if needs_noise(estimate) else (lost,)
        listed = [replace(one, status=status) for one in advice]
    elif estimate is not None and estimate.verdict == "below_resolution":
        listed = [Finding("rounded", "for a smaller r, let the sensor give finer steps")]
    else:
        listed = findings_of(evidence, known)
    if not listed and estimate is not None and estimate.verdict == "flat":
        listed = [Finding("vague", "take r from a still stretch or the data sheet, or record longer", GiveNoise())]
    if known.estimated and estimate is not None:
        listed = _with_next_step(listed, estimate, lag_costs=evidence.lag_costs)
    half = "" if held_out is None else _second_half(held_out)
    if not listed:
        return _without_misfit(residuals, known, half)
    status = listed[0].status
    headline = as_sentences(listed[0].text) if status == "as_chosen" else _headline(status, evidence, known)
    findings = tuple(one for one in listed if as_sentences(one.text) not in headline)[:MAX_ADVICE]
    word = _band(evidence) if status == "band" else ""
    return _judgement(status, headline, findings, half, word)


def _judgement(
    status: str, headline: str, findings: tuple[Finding, ...] = (), second_half: str = "", word: str = ""
) -> Judgement:
    usual, tone, _ = STATUSES[status]
    return Judgement(
        status=status, headline=headline, word=word or usual, tone=tone, findings=findings, second_half=second_half
    )


def _headline(status: str, evidence: Evidence, known: Known) -> str:
    if status == "too_few":
        return f"Too few samples to judge the filter: {count(evidence.n)} were scored, {MIN_SAMPLES} are needed."
    if status == "band":
        best, at = evidence.correction, f" {WITH_MOMENTUM}" if evidence.momentum else ""
        size = "smaller" if best.r_factor > 1.0 else "larger"
        text = f"The ± {_band(evidence).replace('band', 'band is')}: it predicts {size} errors."
        # Two factors too alike to be worth a change may still fit clearly better, as may others with the spikes.
        compared = best.q_factor == best.r_factor and not evidence.spikes
        return f"{text} No other q/r fits clearly better{at}." if compared else text
    _, tone, headline = STATUSES[status]
    return f"{known.chosen if tone == 'note' else ''}{headline}"


def _band(evidence: Evidence) -> str:
    return f"band too {'narrow' if evidence.correction.r_factor > 1.0 else 'wide'}"


NO_NEXT = ("start", "constant", "two_speeds")
"""Statuses after which there is nothing to choose."""


def _with_next_step(listed: list[Finding], estimate: Estimate, *, lag_costs: bool) -> list[Finding]:
    """The findings on the best fit, which end with an action where it may look worse than the previous filter."""
    if estimate.params is None or any(one.action or one.status in NO_NEXT for one in listed):
        return listed
    removed = steady_state(estimate.params).noise_reduction_db
    reason = ""
    if removed < HARDLY_DB:
        reason = f": the best statistical fit removes only {decibels(removed)} of the noise"
    elif lag_costs or not listed:
        return listed
    status = listed[0].status if listed else "weak"
    step = Finding(status, f"{KEEP}{reason}") if lag_costs else Finding(status, f"{CHOOSE}{reason}", ChooseFilter())
    return [*listed[: MAX_ADVICE - 1], step]


def _without_misfit(residuals: Diagnostics, known: Known, half: str) -> Judgement:
    """A filter without a misfit that is worth correcting."""
    n, refused = residuals.evidence.n, residuals.evidence.refused
    without = f", {count(refused)} more rejected by the gate" if refused else ""
    text = f"The filter fits: no misfit worth correcting in {count(n)} residuals{without}."
    if n < FEW:
        text = f"Nothing in the {count(n)} residuals contradicts the filter, but so few show only gross misfits."
    return _judgement("fits", f"{known.chosen}{text}", (), half)


def _second_half(held_out: Diagnostics) -> str:
    """The size of the errors of the second half, without a verdict on it that the whole record could contradict."""
    if held_out.nis_low <= held_out.nis <= held_out.nis_high:
        return "squared errors are as large as q and r predict"
    size = f"squared errors are {number(held_out.nis)} × what q and r predict"
    return f"{size}, on the first half {number(held_out.nis_before)} ×"
