"""What residuals hold against a filter: the evidence in numbers, and each finding in words with its advice.

One function makes one finding. The words are clauses that the residuals cannot contradict, true without the action.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from kalscope.analysis import actions, correction
from kalscope.analysis.correction import MIN_FACTOR, MIN_SAMPLES, Correction, Record
from kalscope.analysis.residuals import CLEAR, MAX_OUTLIERS, MAX_REFUSED, SPIKE, Run, Spikes
from kalscope.common.numbers import Array, Indices
from kalscope.common.text import DURATIONS, count, number, percent, trimmed
from kalscope.estimation.request import Noise, Request
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state

Tone = Literal["good", "note", "bad"]
"""Nothing to correct; something to know; something that should be corrected."""

STATUSES: dict[str, tuple[str, Tone, str]] = {
    "fits": ("fits", "good", ""),
    "rounded": ("coarse steps", "note", "The readings are rounded more coarsely than their noise, or held."),
    "vague": ("any ratio fits", "note", "The filter fits, and so does any other q/r."),
    "weak": ("hardly filters", "note", "The filter fits, but by this model nearly every change is movement."),
    "setting": (
        "no filter needed",
        "note",
        "At this rate hardly any noise shows: the medium setting smooths.",
    ),
    "slow": ("no movement", "note", "The record shows no movement, so any slow filter fits it."),
    "two_speeds": ("two speeds", "good", "Two speeds explain this record clearly better than one."),
    "set_speeds": ("set by hand", "note", "Two speeds, set by hand: only their search compares them with others."),
    "too_few": ("too few samples", "note", ""),
    "constant": ("constant signal", "note", "The signal is constant: there is nothing to judge the filter by."),
    "start": ("wrong start", "bad", "The filter starts too far from the signal."),
    "spikes": ("spikes", "bad", "The record has spikes: single readings far from those around them."),
    "bursts": ("noise bursts", "note", "Large errors are too many for single outliers."),
    "too_slow": ("too slow", "bad", "The filter is too slow for this record."),
    "too_fast": ("too fast", "bad", "The filter is too fast for this record: it lets too much noise through."),
    "band": ("wrong band", "bad", ""),
    "as_chosen": ("set by your goal", "note", ""),
    "structure": ("model misfit", "note", "One filter cannot fit it: the signal has hum, a trend or waves."),
    "changes": ("noise changes", "note", "One filter cannot fit all of it: the movement or the noise changes."),
    "steps": ("signal steps", "note", "One filter cannot fit it: the signal steps."),
    "gate": ("gate too narrow", "bad", "The outlier gate rejects more than single outliers."),
    "shape": ("long tails", "note", "Large errors are more frequent than in a normal distribution."),
    "no_pair": ("no result", "bad", ""),
    "fused": ("fused", "good", ""),
    "shared_noise": ("sensors share noise", "bad", ""),
    "silent": ("sent no data", "note", ""),
    "stuck": ("is stuck", "bad", ""),
    "drift": ("disagrees", "bad", ""),
    "noise": ("disagrees", "bad", ""),
}
"""Each status: a few plain words, its tone, and the headline; "" where that holds a number. The first are of a
channel, those from "fused" on of fused sensors and of one of them."""

NO_FAULT = "no misfit worth correcting"

WITH_MOMENTUM = "with this momentum"
"""Where pairs were compared at the momentum of the filter only."""

CHOOSE = "choose the lag that you can accept"
"""What to do where no q and r describe the signal; the reason follows."""

KEEP = "keep this filter: a lag of 5 samples would add more error than the noise"
"""What to do where the movement that the filter follows is larger; the reason why it may look worse follows."""

MAX_SHARE = 0.25
"""Share of low frequencies from which residuals are correlated for so long that parts differ by chance."""

MAX_UNCHANGED = 0.6
"""Share of readings equal to the one before, above which rounding determines the residuals."""

FAR = 100.0
"""Factor of r beyond which it is wrong whatever the rounding."""

GREAT_CHANGE = 4.0
"""A change of the variance by more than this factor explains spikes and jumps."""

NARROW = 0.75
"""σ of the residuals over that of q and r below which a gate of 4 σ is too wide, as is one 1/0.75 × as wide."""

MUCH_TOO_WIDE = 0.3
"""σ of the residuals over that of q and r below which a wrong size comes before spikes."""


@dataclass(frozen=True)
class Finding:
    """What was found, and what to do about it."""

    status: str
    """One of STATUSES, or what is wrong with a sensor of a fusion."""
    text: str
    """One clause without capital and full stop, such as "too slow: raise q about 10 ×"; true without the action."""
    action: actions.Action | None = None
    """The action to take; None where there is nothing to do."""


def as_sentences(clauses: str) -> str:
    """Clauses as sentences, each with a capital and a full stop; symbols stay as they are."""
    clauses = re.sub(r"(^|\. )([a-z])(?=[a-z])", lambda m: m[1] + m[2].upper(), clauses)
    return clauses if clauses.endswith(".") else f"{clauses}."


# --- the evidence ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Evidence:
    """The misfits of one channel, each with the value of a perfect filter where it was not found."""

    n: int
    """Scored residuals."""
    constant: bool = False
    """Whether the signal does not move: all residuals are 0, or they only show a given start."""
    ratio: float = 1.0
    """Variance of a step over r of the filter; without momentum λ."""
    momentum: bool = False
    """Whether the filter has momentum."""
    start: float = 0.0
    """How far, in σ, the first sample lies from the given x0; 0 where none was given or that is not a misfit."""
    spikes: int = 0
    """Isolated spikes, where they are more than chance."""
    jumps: int = 0
    """Jumps beyond 5 σ that stay, where spikes and jumps are more than chance."""
    scale: float = 1.0
    """Local σ of the residuals over the one that q and r predict, without spikes."""
    largest: float = 0.0
    """The largest residual, in σ as q and r predict it."""
    unchanged: float = 0.0
    """Share of the readings that equal the one before."""
    refused: int = 0
    """Samples that the outlier gate rejected."""
    refused_in_a_row: int = 0
    """The longest run of them."""
    correction: Correction = field(default_factory=Correction)
    """Better q and r."""
    structure: float | None = None
    """Share of the power that low frequencies hold in the residuals of the best q and r, 0 where these are only
    correlated; None where they are white."""
    lag_costs: bool = False
    """Whether the filter has momentum, and a lag of five samples without it would add more error than the noise."""
    two_speeds: bool = False
    """Whether the filter has two speeds, which only their search judges."""
    change: float = 1.0
    """Largest over least variance of the residuals among the parts of the record, where that is a misfit."""

    @property
    def gate(self) -> float:
        """The gate that rejects spikes and nothing else of these residuals, in σ as q and r predict it."""
        return max(float(f"{SPIKE * self.scale:.2g}"), 1.0)


def find_evidence(run: Run, seen: Indices, e: Array, spikes: Spikes, refusals: Indices, lags: int) -> Evidence:
    """All evidence against the filter, found in all samples of the record.

    Args:
        run: the filter over the channel.
        seen: indices of the scored samples, shape (N,).
        e: their standardised residuals, shape (N,).
        spikes: the spikes among them.
        refusals: the samples that the gate rejected, ascending.
        lags: of the Ljung-Box test.
    """
    n, ends = len(seen), np.flatnonzero(np.diff(refusals, append=np.inf) > 1)
    in_a_row = int(np.diff(ends, prepend=-1).max(initial=0))
    evidence = Evidence(n, momentum=run.momentum > 0.0, refused=len(refusals), refused_in_a_row=in_a_row)
    if not e.any():
        return replace(evidence, constant=True)
    if run.two_speeds:  # other pairs and the shape of its errors say nothing about it
        return replace(evidence, two_speeds=True)
    mostly_lone = spikes.lone > spikes.jumps
    spiky, steps = mostly_lone and spikes.too_many(n, lone=True), not mostly_lone and spikes.too_many(n)
    outliers = spikes.off if spiky and len(spikes.off) <= MAX_OUTLIERS * n else spikes.off[:0]
    record = Record.of(run, seen[outliers])
    if not record.moves and not len(outliers):  # only the approach from a given x0 remains
        return replace(evidence, constant=True, start=abs(float(e[0])) if abs(float(e[0])) > SPIKE else 0.0)
    if record.unchanged > MAX_UNCHANGED and len(outliers):  # its steps are not outliers
        record, outliers = Record.of(run, seen[:0]), outliers[:0]
    better = correction.find_correction(record)
    # Steps raise the best q, and so leave a correlation between them whatever the rest of the signal does.
    structure = None if steps or better.e is None else correction.find_structure(better.e, lags)
    comparable = better.e is not None and (structure is None or 0.0 < structure < MAX_SHARE)
    return replace(
        evidence,
        ratio=record.ratio,
        start=spikes.start,
        spikes=spikes.lone if spiky else 0,
        jumps=int(np.count_nonzero(spikes.size[spikes.stays] > CLEAR)) if steps else 0,
        scale=1.4826 * float(np.median(np.abs(e))) or 1.0,
        largest=float(np.abs(e).max()),
        unchanged=record.unchanged,
        correction=better,
        structure=structure,
        lag_costs=run.momentum > 0.0 and correction.lost_by_lag(record) > 1.0,
        change=correction.find_change(better.e) if comparable and better.e is not None else 1.0,
    )


# --- the findings ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Known:
    """What is known about the filter besides its residuals."""

    estimated: bool = False
    """Whether q and r were estimated from this record just now."""
    robust: bool = False
    """Whether that estimate set spikes aside."""
    momentum_searched: bool = False
    """Whether it looked for momentum."""
    goal: str = ""
    """What the user chose that fixes q/r, such as "a lag of 50 ms"; "" = nothing."""
    noise: str = ""
    """Where r was given, as in "from the data sheet"; "" = it was not."""

    def with_request(self, request: Request | None) -> Known:
        """The same with what the user decided about the filter."""
        if request is None:
            return self
        return replace(self, goal=request.goal, noise="" if request.noise == Noise() else request.noise.origin)

    @property
    def chosen(self) -> str:
        """That there is a goal, as a sentence before others; "" without one."""
        return f"You chose {self.goal}. " if self.goal and not self.goal.endswith(" setting") else ""


def findings_of(evidence: Evidence, known: Known) -> list[Finding]:
    """All findings, the most urgent first; an earlier one may explain the later ones."""
    if evidence.n < MIN_SAMPLES:
        few = f"too few samples to judge ({evidence.n} scored, {MIN_SAMPLES} needed)"
        return [Finding("too_few", few, actions.RecordLonger())]
    if evidence.constant:
        constant = Finding("constant", "the signal is constant: there is nothing to judge the filter by")
        return [_start(evidence) or constant]
    if evidence.two_speeds:
        status = "two_speeds" if known.estimated else "set_speeds"
        return [Finding(status, STATUSES[status][2].lower())]
    if evidence.unchanged > MAX_UNCHANGED:
        return _rounded(evidence, known)
    if evidence.structure is not None and not known.estimated:  # another momentum may fit all parts
        evidence = replace(evidence, change=1.0)
    spikes, change = _spikes(evidence, known), _change(evidence, known)
    fitted_again = spikes is not None and isinstance(spikes.action, actions.SetSpikesAside)
    fitted_again = fitted_again or (known.robust and evidence.spikes > 0)  # it has seen them, and kept them
    factors = (evidence.correction.q_factor, evidence.correction.r_factor)
    off = max(max(factor, 1.0 / factor) for factor in factors)
    mixed = known.estimated and evidence.change > off  # its parts need different pairs
    size = None if fitted_again or mixed else _size(evidence)
    much_too_wide = evidence.scale < MUCH_TOO_WIDE  # a gate would reject nothing
    great = evidence.change > max(off, GREAT_CHANGE)
    ordered = (
        _start(evidence),
        _refused_share(evidence, known),
        size if much_too_wide else None,
        change if great else spikes,
        None if great else _jumps(evidence, known),
        change if off < evidence.change <= GREAT_CHANGE else None,
        _edge(evidence),
        None if much_too_wide else size,
        _structure(evidence, known),
        change if evidence.change <= off else None,
        _refused_runs(evidence, known),
    )
    found = [one for one in ordered if one is not None]
    last = [one for one in found if one.text.startswith((KEEP, CHOOSE))][1:]  # the first says what to do
    listed = [one for one in found if one not in last]
    if known.goal or known.noise:
        listed = _as_chosen(listed, known, evidence.momentum)
    shape = None if listed else _shape(evidence, known)
    return listed if shape is None else [shape]


def advice_text(findings: Sequence[Finding]) -> str:
    """The two most urgent findings as sentences without capitals, or that there is no misfit."""
    return ". ".join(one.text for one in findings[:2]) or NO_FAULT


def _rounded(evidence: Evidence, known: Known) -> list[Finding]:
    """What rounding leaves to say: only a size that is wrong by far more than rounding makes it."""
    rounded = Finding(
        "rounded",
        f"{percent(evidence.unchanged)} of the readings equal the one before: they are rounded more coarsely than "
        "their noise, or held, and tests of the residuals cannot judge the filter",
    )
    is_far = not 1.0 / FAR < evidence.correction.r_factor < FAR
    size = _size(evidence) if is_far and not known.estimated else None
    return [rounded] if size is None else [size, rounded]


def _start(evidence: Evidence) -> Finding | None:
    if not evidence.start:
        return None
    far = f"the first sample lies {number(evidence.start, 2)} σ from x0"
    return Finding("start", f"{far}: leave x0 and p0 unset, or raise p0", actions.UnsetStart())


def _refused_share(evidence: Evidence, known: Known) -> Finding | None:
    share = evidence.refused / (evidence.n + evidence.refused)
    if share <= MAX_REFUSED or known.robust:  # that fit has set them aside
        return None
    text = f"the outlier gate rejects {percent(share)} of the samples: too many for outliers, switch it off"
    return Finding("gate", text, actions.SetGate(None))


def _refused_runs(evidence: Evidence, known: Known) -> Finding | None:
    if evidence.refused_in_a_row < GATE_LIMIT or known.robust:  # that fit has weighed what the gate delays
        return None
    text = (
        f"the outlier gate rejected {evidence.refused_in_a_row} samples in a row, its maximum: either the signal "
        "moved on, which the gate delays, or outliers come in runs"
    )
    return Finding("gate", text, actions.SetGate(None))


def _spikes(evidence: Evidence, known: Known) -> Finding | None:
    if not evidence.spikes or known.robust:  # that fit has looked from both sides, and chose the gate
        return None
    seen = f"spikes: {count(evidence.spikes)} beyond 4 σ"
    if evidence.spikes > MAX_OUTLIERS * evidence.n:
        return Finding("bursts", f"{seen} are too many for outliers: one variance cannot describe such noise")
    if evidence.refused:
        best = evidence.correction
        explained = any(map(_matters, (best.q_factor, best.r_factor))) or evidence.refused_in_a_row >= GATE_LIMIT
        explained = explained or (evidence.scale > NARROW and evidence.largest < SPIKE / NARROW)
        text = f"{seen} pass the outlier gate: narrow it to {evidence.gate:g} σ"
        return None if explained else Finding("spikes", text, actions.SetGate(evidence.gate))
    if known.estimated:
        return Finding(
            "spikes", f"{seen}, and the fit took them for noise: set them aside", actions.SetSpikesAside()
        )
    wide = evidence.scale > 1.0 / NARROW  # a gate of 4 σ would reject what such a filter has not followed
    sigma, at = (evidence.gate, f" at {evidence.gate:g} σ") if wide else (SPIKE, "")
    text = f"{seen}: switch the outlier gate on{at}"
    # Where r is too large the gate would reject nothing.
    return Finding("spikes", text, actions.SetGate(sigma)) if evidence.largest > sigma else None


def _jumps(evidence: Evidence, known: Known) -> Finding | None:
    if not evidence.jumps:
        return None
    text = (
        f"jumps: {count(evidence.jumps)} beyond 5 σ that stay: the signal itself steps; an outlier gate "
        f"{'delays it' if evidence.refused else 'would delay it'}, and a q that follows it lets more noise through "
        "between the steps"
    )
    if evidence.refused and not known.robust:  # that fit has weighed what the gate delays
        return Finding("steps", text, actions.SetGate(None))
    return _to_accept("steps", text, evidence, known)


def _to_accept(status: str, text: str, evidence: Evidence, known: Known) -> Finding:
    """A misfit that no q and r mend, and what an estimate leaves to do: keep the filter, or choose the lag."""
    if not known.estimated:
        return Finding(status, text)
    if evidence.lag_costs:
        return Finding(status, f"{KEEP}. {text}")
    return Finding(status, f"{CHOOSE}. {text}", actions.ChooseFilter())


def _change(evidence: Evidence, known: Known) -> Finding | None:
    if evidence.change <= 1.0:
        return None
    size = "over 1000" if evidence.change > 1000.0 else number(evidence.change, 2)
    text = f"the noise or the movement changes: the variance of the residuals differs {size} × between parts "
    return _to_accept("changes", f"{text}of the record, which one pair cannot fit", evidence, known)


def _edge(evidence: Evidence) -> Finding | None:
    if not evidence.correction.leaves_edge:
        return None
    status, text = "too_slow", "q = 0 cannot follow this signal"
    if evidence.ratio > 1.0:
        status, text = "too_fast", "r = 0 lets all noise through"
    return Finding(status, f"{text}: estimate q and r", actions.EstimateAgain())


def _size(evidence: Evidence) -> Finding | None:
    q, r = evidence.correction.q_factor, evidence.correction.r_factor
    q_off, r_off, ratio_off = map(_matters, (q, r, q / r))
    if not (q_off or r_off):
        return None
    scale = actions.Scale(q if q_off else 1.0, r if r_off else 1.0)
    if q_off and r_off and not ratio_off:
        size = "small" if r > 1.0 else "large"
        edges = {0.0: "r is", math.inf: "q is"}
        names = edges.get(evidence.ratio, "q and r are both")
        text = f"{names} too {size} by about {times(r)}: this changes the band, not the curve"
        return Finding("band", text, scale)
    pace = "too slow" if q > r else "too fast"
    change_q, change_r = (
        f"{'raise' if f > 1.0 else 'lower'} {x} about {times(f)}" for x, f in (("q", q), ("r", r))
    )
    changes = [change for change, is_off in ((change_q, q_off), (change_r, r_off)) if is_off]
    ratio = f", so that q/r becomes {larger(q / r)}" if q_off and r_off and (q > 1.0) == (r > 1.0) else ""
    text = f"{pace}: {' and '.join(changes)}{ratio}"
    return Finding(pace.replace(" ", "_"), text, scale)


def _structure(evidence: Evidence, known: Known) -> Finding | None:
    share = evidence.structure
    if share is None:
        return None
    low = f"low frequencies hold {percent(share)} of the residual power" if share else ""
    if not known.momentum_searched:
        at = f" {WITH_MOMENTUM}" if evidence.momentum else ""
        text = f"{low or 'residuals stay correlated'} for any q and r{at}; estimate q, r and momentum together"
        return Finding("structure", text, actions.EstimateAgain())
    if low:
        text = f"{low}: the signal has a trend or waves that the model lacks"
    else:
        pair, walk = ("", " with momentum") if evidence.momentum else (" for any q and r", "")
        text = (
            f"residuals stay correlated{pair}: the signal has hum, trend, steps or coloured noise that a random "
            f"walk{walk} cannot describe"
        )
    return _to_accept("structure", text, evidence, known)


def _shape(evidence: Evidence, known: Known) -> Finding | None:
    if not evidence.spikes or not known.robust:
        return None
    tails = f"{count(evidence.spikes)} of {count(evidence.n)} residuals lie beyond 4 σ"
    return Finding("shape", f"{tails}: the noise has long tails, or two kinds of readings are mixed")


def _matters(factor: float) -> bool:
    """Whether a factor is worth a change."""
    return abs(math.log(factor)) >= math.log(MIN_FACTOR)


def times(factor: float) -> str:
    """A factor in words: "1.6 ×", "4 ×", "1000 × or more"; of a decrease, the divisor."""
    size = factor if factor > 1.0 else 1.0 / factor
    return "1000 × or more" if size >= 900.0 else f"{trimmed(size, 2 if size < 3.0 else 1)} ×"


def larger(ratio: float) -> str:
    """By how much, as in "about 500 × larger"."""
    way, size = ("larger", ratio) if ratio > 1.0 else ("smaller", 1.0 / ratio)
    return f"more than 1000 × {way}" if size >= 1000.0 else f"about {number(size, 2 if size < 3.0 else 1)} × {way}"


# --- a filter that was chosen ---------------------------------------------------------------------------------

KEEPING = (actions.SetGate, actions.UnsetStart)
"""Actions that correct a filter and leave its q/r: they come before what the choice costs."""

TRUSTED = {"from a still stretch": "that stretch", "from the data sheet": "the data sheet"}
"""What a given r relies on, by where it comes from."""

ROUNDING = 1e-3
"""Relative difference that four digits in a tuning file, and three of a rounded q, may make."""

_NUMBER = r"(\d[\d.e+-]*)"

_GOALS = (
    *(
        (re.compile(rf"a lag of {_NUMBER} {unit}{'?' if len(unit) > 3 else ''}\b"), "lag_s", length)  # 2 days
        for unit, length in DURATIONS
    ),
    (re.compile(f"a lag of {_NUMBER} samples"), "lag_samples", 1.0),
    (re.compile(f"a −3 dB cut-off at {_NUMBER} Hz"), "cutoff_hz", 1.0),
    (re.compile(f"{_NUMBER} dB less noise"), "noise_reduction_db", 1.0),
    (re.compile(f"the gain {_NUMBER}"), "gain", 1.0),
)
"""How a tuning names the goal that was chosen, the target, and its unit."""


def request_in(how: str, r: float) -> Request | None:
    """What a tuning says about the origin of its q and r, where the search is no longer known; None = no choice.

    Args:
        how: as `FitResult.how` or a tuning file says it. Its numbers have four digits: for words, not for a search.
        r: the r of the tuning, given where `how` says so.
    """
    given = any(f"r {origin}" in how for origin in (*TRUSTED, "as given"))
    noise = Noise(r=r) if given and r > 0.0 else Noise()
    if setting := re.match("the (light|medium|strong|slow) setting", how):
        return Request(setting=setting[1])
    for pattern, name, unit in _GOALS:
        if goal := pattern.match(how):
            return Request(target={name: unit * float(goal[1])}, noise=noise)
    if ratio := re.match(f"q/r = {_NUMBER}", how):
        return Request(ratio=float(ratio[1]), noise=noise)
    return Request(noise=noise) if noise != Noise() else None


def still_met(request: Request | None, params: FilterParams, sample_period: float | None) -> Request | None:
    """The request with its goal only where the filter meets it: another sample period changes a lag in ms."""
    if request is None or not request.target:
        return request
    name, value = next(iter(request.target.items()))
    now = float(getattr(steady_state(params, sample_period), name))
    if math.isclose(now, value, rel_tol=ROUNDING):
        return request
    return None if request.noise == Noise() else Request(noise=request.noise)


def _as_chosen(listed: list[Finding], known: Known, momentum: bool) -> list[Finding]:
    """The findings on a chosen filter: what can be corrected, what the choice costs in numbers, the rest as notes.

    No advice undoes the choice. A filter that is slower than the best leaves waves in its residuals, which say
    nothing about the model.
    """
    costs: list[Finding] = []
    rest: list[Finding] = []
    slow = False
    fit = f"the best statistical fit {WITH_MOMENTUM}" if momentum else "the best statistical fit"
    for one in listed:
        action = one.action
        if isinstance(action, actions.Scale) and _ends(action, known):
            slow = bool(known.goal) and action.q_factor > action.r_factor
            costs.append(_cost(known, action, fit))
        elif known.goal and one.status in ("too_slow", "too_fast"):  # a factor too small for a change
            continue
        elif isinstance(action, actions.EstimateAgain):  # it would end the choice
            rest.append(Finding(one.status, one.text.split("; ")[0]))
        else:
            rest.append(one)
    rest = [one for one in rest if not (slow and one.status == "structure")]
    keeping = [one for one in rest if isinstance(one.action, KEEPING)]
    return [*keeping, *costs, *(one for one in rest if one not in keeping)]


def _ends(scale: actions.Scale, known: Known) -> bool:
    """Whether a change of q and r ends the choice: another q/r than chosen, or another r than given."""
    moved = (scale.q_factor / scale.r_factor if known.goal else 1.0, scale.r_factor if known.noise else 1.0)
    return any(map(_matters, moved))


def _cost(known: Known, best: actions.Scale, fit: str) -> Finding:
    """What the best fit would do differently, as clauses of two sentences."""
    ratio = best.q_factor / best.r_factor
    if known.goal and _matters(ratio):
        change = f"({'q/r' if _matters(best.r_factor) else 'q'} {larger(ratio)})"
        if ratio > 1.0:
            best_fit = f"follow faster {change}, so fast movement is smoothed away"
        else:
            best_fit = f"smooth more {change}, so noise that it would remove stays"
        return Finding("as_chosen", f"you chose {known.goal}. {fit} would {best_fit}")
    origin = f" {known.noise}" if known.noise in TRUSTED else ""
    return Finding(
        "as_chosen",
        f"you gave r{origin}. {fit} has an r "
        f"{larger(best.r_factor)}: keep yours if you trust {TRUSTED.get(known.noise, 'it')}",
    )
