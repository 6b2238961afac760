"""Findings in words: each a status, a clause that the residuals cannot contradict, and what to do about it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from kalscope.analysis.actions import (
    Advice,
    AllowMomentum,
    ChooseFilter,
    EstimateAgain,
    RecordLonger,
    Scale,
    SetGate,
    SetRatio,
    SetSpikesAside,
    UnsetStart,
)
from kalscope.analysis.fit.correction import MIN_FACTOR, MIN_SAMPLES
from kalscope.analysis.fit.findings import MAX_UNCHANGED, Findings
from kalscope.analysis.fit.goal import WITH_MOMENTUM, Choice, Finding, larger, times, with_choice
from kalscope.analysis.fit.spikes import MAX_OUTLIERS, MAX_REFUSED
from kalscope.analysis.residual_tests import SPIKE
from kalscope.common.text import count, number, percent, plural
from kalscope.filtering.kernels import GATE_LIMIT

NO_FAULT = "no misfit worth correcting"

CHOOSE = "choose the lag that you can accept"
"""What to do where no q and r describe the signal; the reason follows."""

KEEP = "keep this filter: a lag of 5 samples would add more error than the noise"
"""What to do where the movement that the filter follows is larger; the reason why it may look worse follows."""

FAR = 100.0
"""Factor of r beyond which it is wrong whatever the rounding."""

GREAT_CHANGE = 4.0
"""A change of the variance by more than this factor explains spikes and jumps."""

NARROW = 0.75
"""σ of the residuals over that of q and r below which a gate of 4 σ is too wide, as is one 1/0.75 × as wide."""


MUCH_TOO_WIDE = 0.3
"""σ of the residuals over that of q and r below which a wrong size comes before spikes."""


@dataclass(frozen=True)
class Known:
    """What is known about the filter besides its residuals."""

    estimated: bool = False
    """Whether q and r were estimated from this record just now."""
    robust: bool = False
    """Whether that estimate set spikes aside."""
    momentum_searched: bool = False
    """Whether it looked for momentum."""
    choice: Choice = field(default_factory=Choice)
    """What the user decided about it."""


def findings_in_words(found: Findings, known: Known) -> list[Finding]:
    """All findings, the most urgent first; an earlier one may explain the later ones."""
    if found.n < MIN_SAMPLES:
        few = f"too few samples to judge ({found.n} scored, {MIN_SAMPLES} needed)"
        return [("too_few", Advice(few, RecordLonger(MIN_SAMPLES)))]
    if found.constant:
        start = _start(found)
        return (
            [start]
            if start
            else [("constant", Advice("the signal is constant: there is nothing to judge the filter by"))]
        )
    if found.unchanged > MAX_UNCHANGED:
        return _rounded(found, known)
    spikes, change = _spikes(found, known), _change(found)
    fitted_again = spikes is not None and isinstance(spikes[1].action, SetSpikesAside)
    fitted_again = fitted_again or (known.robust and found.spikes > 0)  # it has seen them, and kept them
    factors = (found.correction.q_factor, found.correction.r_factor)
    off = max(max(factor, 1.0 / factor) for factor in factors)
    mixed = known.estimated and found.change > off  # its parts need different pairs
    size = None if fitted_again or mixed else _size(found)
    said = [_start(found), _refused_share(found)]
    said += [size] if found.scale < MUCH_TOO_WIDE else []  # a gate would reject nothing
    said += [change] if found.change > max(off, GREAT_CHANGE) else [spikes, _jumps(found, known)]
    said += [change] if off < found.change <= GREAT_CHANGE else []
    said += [_edge(found), None if found.scale < MUCH_TOO_WIDE else size, _structure(found, known)]
    said += [change] if found.change <= off else []
    said.append(_refused_runs(found, known))
    there = [finding for finding in said if finding is not None]
    there = with_choice(there, known.choice, found.momentum) if known.choice else there
    shape = _shape(found, known)
    return there if there or shape is None else [shape]


def advice_text(said: list[Finding]) -> str:
    """The two most urgent findings as sentences without capitals, or that there is no misfit."""
    return ". ".join(advice.text for _, advice in said[:2]) or NO_FAULT


def _rounded(found: Findings, known: Known) -> list[Finding]:
    """What rounding leaves to say: only a size that is wrong by far more than rounding makes it."""
    text = f"{percent(found.unchanged)} of the readings equal the one before: they are rounded more coarsely than "
    advice = Advice(f"{text}their noise, or held, and tests of the residuals cannot judge the filter")
    factor = found.correction.r_factor
    size = _size(found) if not 1.0 / FAR < factor < FAR else None
    return [*([size] if size is not None and not known.estimated else []), ("rounded", advice)]


def _start(found: Findings) -> Finding | None:
    if not found.start:
        return None
    text = f"the first sample lies {number(found.start, 2)} σ from x0: leave x0 and p0 unset, or raise p0"
    return "start", Advice(text, UnsetStart())


def _refused_share(found: Findings) -> Finding | None:
    share = found.refused / (found.n + found.refused)
    if share <= MAX_REFUSED:
        return None
    text = f"the outlier gate rejects {percent(share)} of the samples: too many for outliers, switch it off"
    return "gate", Advice(text, SetGate(None))


def _refused_runs(found: Findings, known: Known) -> Finding | None:
    if found.refused and found.burst and not found.spikes:
        first, last = (count(at) for at in found.burst)
        seen = f"the outlier gate rejected {plural(found.refused, 'sample')}"
        return "bursts", Advice(f"{seen}, most of them in a burst, samples {first} to {last}")
    if found.refused_in_a_row < GATE_LIMIT or known.robust:  # that fit has weighed what the gate delays
        return None
    text = (
        f"the outlier gate rejected {found.refused_in_a_row} samples in a row, its maximum: either the signal "
        "moved on, which the gate delays, or outliers come in runs"
    )
    return "gate", Advice(text, SetGate(None))


def _spikes(found: Findings, known: Known) -> Finding | None:
    if not found.spikes or known.robust:  # that fit has looked from both sides, and chose the gate
        return None
    seen = f"spikes: {count(found.spikes)} beyond 4 σ"
    if found.spikes > MAX_OUTLIERS * found.n:
        return "bursts", Advice(f"{seen} are too many for outliers: one variance cannot describe such noise")
    if found.burst:
        first, last = (count(at) for at in found.burst)
        return "bursts", Advice(f"{seen}, most of them in a burst, samples {first} to {last}")
    if found.refused:
        explained = found.correction.worth_it or found.refused_in_a_row >= GATE_LIMIT
        explained = explained or (found.scale > NARROW and found.largest < SPIKE / NARROW)
        return None if explained else _passing(found, seen)
    if known.estimated:
        return "spikes", Advice(f"{seen}, and the fit took them for noise: set them aside", SetSpikesAside())
    return _switched_on(found, seen)


def _switched_on(found: Findings, seen: str) -> Finding | None:
    """The gate to switch on; none where it would reject nothing, because r is too large."""
    wide = found.scale > 1.0 / NARROW  # a gate of 4 σ would reject what such a filter has not followed
    sigma, at = (_wide(found), f" at {_wide(found):g} σ") if wide else (SPIKE, "")
    if found.largest <= sigma:
        return None
    return "spikes", Advice(f"{seen}: switch the outlier gate on{at}", SetGate(sigma))


def _passing(found: Findings, seen: str) -> Finding:
    sigma = _wide(found)
    return "spikes", Advice(f"{seen} pass the outlier gate: narrow it to {sigma:g} σ", SetGate(sigma))


def _wide(found: Findings) -> float:
    """The gate that rejects spikes and nothing else of these residuals, in σ as q and r predict it."""
    return max(float(f"{SPIKE * found.scale:.2g}"), 1.0)


def _edge(found: Findings) -> Finding | None:
    best = found.correction.instead_of_edge
    if best is None:
        return None
    action = SetRatio(best, found.correction.edge_factor)
    if found.ratio < 1.0:
        return "too_slow", Advice(
            f"q = 0 cannot follow this signal: q about {number(best, 1)} × r fits best", action
        )
    return "too_fast", Advice(
        f"r = 0 lets all noise through: r about {number(1.0 / best, 1)} × q fits best", action
    )


def _size(found: Findings) -> Finding | None:
    q, r = found.correction.q_factor, found.correction.r_factor
    q_off, r_off, ratio_off = (abs(math.log(f)) >= math.log(MIN_FACTOR) for f in (q, r, q / r))
    scale = Scale(q, r)
    if q_off and r_off and not ratio_off:
        size = "small" if r > 1.0 else "large"
        names = "r is" if found.ratio == 0.0 else "q is" if math.isinf(found.ratio) else "q and r are both"
        text = f"{names} too {size} by about {times(r)}: this changes the band, not the curve"
        return "band", Advice(text, scale)
    if not (q_off or r_off):
        return None
    status = "too_slow" if q > r else "too_fast"
    pace = status.replace("_", " ")
    change_q, change_r = ("raise" if f > 1.0 else "lower" for f in (q, r))
    if q_off and r_off:
        text = f"{pace}: {change_q} q about {times(q)} and {change_r} r about {times(r)}"
        if change_q == change_r:
            text += f", so that q/r becomes {larger(q / r)}"
        return status, Advice(text, scale)
    if q_off:
        return status, Advice(f"{pace}: {change_q} q about {times(q)}", scale)
    band = "narrow" if r > 1.0 else "wide"
    text = f"the band is too {band} and the filter {pace}: {change_r} r about {times(r)}"
    return status, Advice(text, scale)


def _structure(found: Findings, known: Known) -> Finding | None:
    left = found.structure
    if left is None:
        return None
    low = f"low frequencies hold {percent(left.low_share)} of the residual power" if left.low_share else ""
    if found.momentum and not known.estimated:
        text = f"{low or 'residuals stay correlated'} for any q and r {WITH_MOMENTUM}"
        return "structure", Advice(f"{text}; estimate q, r and momentum together", EstimateAgain())
    if low:
        text = f"{low}: the signal has a trend or waves that the model lacks"
    elif found.momentum:
        text = (
            "residuals stay correlated: the signal has hum, trend, steps or coloured noise that a random walk with "
            "momentum cannot describe"
        )
    else:
        text = (
            "residuals stay correlated for any q and r: the signal has hum, trend, steps or coloured noise that a "
            "random walk cannot describe"
        )
    if left.momentum and not known.momentum_searched:
        size = f"a momentum of about {number(left.momentum, 1)} samples"
        text += f"; try {size}" if left.whole else f"; {size} explains part of it"
        return "structure", Advice(text, AllowMomentum(left.momentum))
    if not known.estimated:
        return "structure", Advice(text)
    if found.lag_costs:
        return "structure", Advice(f"{KEEP}; {text}")
    return "structure", Advice(f"{CHOOSE}: {text}", ChooseFilter())


def _shape(found: Findings, known: Known) -> Finding | None:
    if found.spikes and known.robust:
        tails = f"{count(found.spikes)} of {count(found.n)} residuals lie beyond 4 σ"
        return "shape", Advice(f"{tails}: the noise has long tails, or two kinds of readings are mixed")
    if not found.skewness and not found.excess:
        return None
    size = f"skewness {number(found.skewness, 2)}, excess kurtosis {number(found.excess, 2)}"
    text = (
        f"the residuals are far from a normal distribution ({size}): if two kinds of readings are mixed, such as "
    )
    return "shape", Advice(f"{text}echoes and misses, separate them before the filter")


def _change(found: Findings) -> Finding | None:
    if found.change <= 1.0:
        return None
    size = "over 1000" if found.change > 1000.0 else number(found.change, 2)
    text = f"the noise or the movement changes: the variance of the residuals differs {size} × between parts "
    return "changes", Advice(f"{text}of the record, which one pair cannot fit")


def _jumps(found: Findings, known: Known) -> Finding | None:
    if not found.jumps:
        return None
    gate = "delays it" if found.refused else "would delay it"
    text = (
        f"jumps: {count(found.jumps)} beyond 5 σ that stay: the signal itself steps; an outlier gate {gate}, and a "
        "q that follows it lets more noise through between the steps"
    )
    mends = found.refused and not known.robust  # that fit has weighed what the gate delays
    return "steps", Advice(text, SetGate(None) if mends else None)
