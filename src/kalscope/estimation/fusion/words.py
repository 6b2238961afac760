"""What the fit of several sensors says."""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.common.text import count, gate_text, number, percent, plural
from kalscope.estimation.verdict.words import MIN_SAMPLES


def common(gains: bool, falling: bool) -> str:
    """What all sensors share, without a reference; `gains` where they were searched, `falling` where one is < 0."""
    signs = ", each with the sign of its gain," if falling else ""
    also, product = (" or gain", ", and the gains so that their sizes multiply to 1") if gains else ("", "")
    return (
        f"An offset{also} that all sensors share cannot be known: the offsets are given so that their sum{signs} "
        f"is 0{product}. Name a reference sensor where one of them is right."
    )


def listed(names: Sequence[str]) -> str:
    """Names as a list in words: a, b and c."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def too_few(name: str, readings: int) -> str:
    """A sensor with too few readings."""
    return (
        f"{name} has too few readings ({count(readings)}): at least {MIN_SAMPLES} are needed to find its noise. "
        "Record longer, or leave it out."
    )


def constant(name: str) -> str:
    """A sensor that always reads the same."""
    return (
        f"All readings of {name} are equal, so it says nothing about the quantity: it may be dead, or its steps "
        "are too coarse. Leave it out."
    )


def copies(first: str, second: str) -> str:
    """Two sensors that always move exactly alike."""
    return (
        f"{first} and {second} always move exactly alike: one is a copy of the other, and a copy adds nothing. "
        "Leave one of them out."
    )


def too_many(name: str) -> str:
    """A sensor of which too many readings look like spikes."""
    return (
        f"Over 20 % of the readings of {name} are predicted neither by those before nor by those after them: too "
        "many for spikes. Check its wiring and its supply, leave it out, or switch the spike-proof fit off."
    )


def found(names: Sequence[str], shares: Sequence[float], gain: float, lag: float) -> str:
    """The fused filter: what each sensor contributes, and how it follows."""
    parts = [f"{percent(share)} from {name}" for name, share in zip(names, shares, strict=True)]
    return (
        f"The fused value takes {listed(parts)}. While all sensors answer it settles at gain {number(gain)}: it "
        f"lags a ramp by {plural(lag, 'sample')}."
    )


def no_movement(q: float) -> str:
    """For q → 0."""
    return (
        "No movement can be identified: a constant plus noise explains this record best, so only the noise of the "
        f"sensors is known. q = {number(q)} is the largest that the record allows (95 %). Record while the "
        "quantity moves, or choose a lag."
    )


def no_noise(name: str, r: float, alone: bool) -> str:
    """For r → 0 of one sensor."""
    others = "" if alone else ", and what the others show beside it counts as their noise"
    return (
        f"No noise can be identified in {name}: every change of it looks like movement{others}. "
        f"r = {number(r)} is the largest that the record allows for it (95 %). Usual reasons: it "
        "smooths or rounds its output, or the sensors do not see the same quantity. Give its r "
        "from a still stretch or the data sheet."
    )


def set_aside(name: str, spikes: int, readings: int) -> str:
    """Spikes of one sensor."""
    return f"{plural(spikes, 'spike')} of {name} ({percent(spikes / readings)}) set aside before the fit."


def adds_nothing(name: str, share: float) -> str:
    """A sensor of little weight."""
    return f"{name} adds almost nothing while the others answer: its share of the fused value is {percent(share)}."


def at_rounding(name: str, r: float) -> str:
    """R at the variance of rounding."""
    return f"The noise of {name} is smaller than its steps: r = {number(r)} is the variance of rounding, Δ²/12."


def shared_noise(names: Sequence[str], correlation: float, passes: bool, known: bool) -> str:
    """Noise that sensors share; `passes` where no other sensor shows it, `known` where some r was given."""
    advice = (
        "It passes as movement, because no sensor differs from the others by it: choose a longer lag to smooth it."
        if passes
        else "Leave one of them out, or remove what they share."
    )
    return (
        f"{common_part(names, correlation)}, such as interference or a common supply: it does not average out, so "
        f"the error of the fused value can be larger than predicted. {advice}"
        f"{' Or an r that was given is too small.' if known else ''}"
    )


def common_part(names: Sequence[str], correlation: float) -> str:
    """Which sensors share noise, and how much of it."""
    return f"{listed(names)} share noise (correlation {'up to ' if len(names) > 2 else ''}{number(correlation, 2)})"


def held(name: str, rows: int) -> str:
    """A sensor whose last reading a logger fills in."""
    return (
        f"Each reading of {name} fills about {rows} rows, as where a logger repeats the last one of a slow "
        "sensor: it counts that often, and the sensor seems far better than it is. Leave the repeated cells empty."
    )


def slow(names: Sequence[str], sensors: int) -> str:
    """Sensors whose difference from the others changes slowly."""
    who = "the sensors" if len(names) == sensors else f"the fused value and {listed(names)}"
    return (
        f"The difference between {who} changes slowly: an offset that drifts, or not quite the same quantity. It "
        "counts as noise, so trust neither the shares nor the intervals too far."
    )


def momentum(tau: float, interval: tuple[float, float], less: float) -> str:
    """Momentum that was found."""
    low, high = interval
    span = f"{number(low)} to {number(high)}" if high < float("inf") else f"{number(low)} or more"
    return (
        f"The quantity keeps its direction for about {number(tau)} samples ({span}): with this momentum the error "
        f"of predicting unseen samples of the fused value is {percent(less)} smaller."
    )


def given_momentum(tau: float) -> str:
    """Momentum that was given."""
    return f"The momentum of {plural(tau, 'sample')} was given."


def gate(threshold: float) -> str:
    """The gate that goes with spikes."""
    return f"The filter gets a gate of {gate_text(threshold)}, which ignores such spikes."


def not_excluded(names: Sequence[str]) -> str:
    """Variances whose intervals begin at 0: "q" or "r of A"."""
    return (
        f"The record does not exclude that {listed(names)} {'is' if len(names) == 1 else 'are'} 0: record longer."
    )
