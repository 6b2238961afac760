"""What the spike-proof fit says."""

from __future__ import annotations

from kalscope.common.text import count as whole
from kalscope.common.text import number, percent, plural, trimmed
from kalscope.estimation.result import USABLE, Estimate
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state


def set_aside(count: int, present: int, plain: Estimate, gate: float | None) -> str:
    """How many samples were set aside, what the answer would be with them, and what the gate does.

    Args:
        count: samples set aside.
        present: samples that are not missing.
        plain: the estimate from all of them.
        gate: the gate of the filter, in standard deviations; None for none.
    """
    if not count:
        return "No sample was set aside: each is predicted by the samples before it or by those after it."
    what = "sample is a spike" if count == 1 else "samples are spikes"
    text = (
        f"{whole(count)} of {whole(present)} {what} ({percent(count / present)}): neither the samples before nor "
        f"those after predict {'it' if count == 1 else 'them'}. {_without(count, plain)}"
    )
    if gate is not None:
        text += f" The filter gets a gate of {trimmed(gate)} σ, which ignores such samples."
    return f"{text} If they belong to the signal, switch the spike-proof fit off."


def only_spikes(params: FilterParams) -> str:
    """The record shows no noise apart from its spikes; `params` have the largest r that it allows."""
    return (
        "Apart from the spikes, no noise can be identified: every other change looks like movement. "
        f"r = {number(float(params.r))} is the largest that the record allows (95 %), so the gate removes the "
        f"spikes and nearly everything else passes: it settles at gain {number(steady_state(params).gain)}."
    )


def kept(count: int) -> str:
    """Without the spikes no noise is left, and a gate would do more harm than good."""
    one = count == 1
    return (
        f"{whole(count)} {'sample looks like a spike' if one else 'samples look like spikes'}, but without "
        f"{'it' if one else 'them'} no noise could be identified, and a gate would reject movement too: "
        f"{'it stays' if one else 'they stay'} in the fit."
    )


def too_many(count: int, present: int) -> str:
    """More than a fifth of the samples would have to be set aside."""
    return (
        f"{whole(count)} of {whole(present)} samples ({percent(count / present)}) are predicted neither by the "
        "samples before nor by those after them: too many for spikes, so no pair is given. Check the wiring, the "
        "supply and the decoding of the sensor, or take a stretch without them. If they belong to the signal, "
        "switch the spike-proof fit off, or choose the lag or the cut-off that you can accept."
    )


def _without(count: int, plain: Estimate) -> str:
    them = "it" if count == 1 else "them"
    aside = f"{'It was' if count == 1 else 'They were'} set aside"
    if plain.verdict == "no_noise":
        return f"{aside}; with {them} no noise could be identified."
    if plain.verdict == "no_movement":
        return f"{aside}; with {them} r would be {number(float(plain.r))}, and no movement could be identified."
    if plain.verdict not in USABLE:
        return f"{aside}; with {them} no pair could be found."
    tau = float(plain.momentum)
    momentum = f" and the momentum {plural(tau, 'sample')}" if tau else ""
    return f"{aside}; with {them} q would be {number(float(plain.q))}, r {number(float(plain.r))}{momentum}."
