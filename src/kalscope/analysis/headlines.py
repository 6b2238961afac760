"""The words of a judgement by its status: one or two for the header, and one sentence."""

from __future__ import annotations

from typing import Literal

from kalscope.analysis.actions import Advice, ChooseFilter, EstimateAgain, GiveNoise, RecordLonger, Status

Tone = Literal["good", "note", "bad"]
"""The tone of a judgement: nothing to correct; something to know; something that should be corrected."""

WORDS: dict[Status, tuple[str, Tone]] = {
    "fits": ("fits", "good"),
    "rounded": ("coarse steps", "note"),
    "vague": ("any ratio fits", "note"),
    "weak": ("hardly filters", "note"),
    "too_few": ("too few samples", "note"),
    "constant": ("constant signal", "note"),
    "start": ("wrong start", "bad"),
    "spikes": ("spikes", "bad"),
    "bursts": ("noise bursts", "note"),
    "too_slow": ("too slow", "bad"),
    "too_fast": ("too fast", "bad"),
    "band": ("wrong band", "bad"),
    "as_chosen": ("as chosen", "note"),
    "structure": ("model misfit", "note"),
    "changes": ("noise changes", "note"),
    "steps": ("signal steps", "note"),
    "gate": ("gate too narrow", "bad"),
    "shape": ("unusual noise", "note"),
    "no_pair": ("no result", "bad"),
}
"""One or two plain words for each status, and their tone."""

HEADLINES: dict[Status, str] = {
    "start": "The filter starts too far from the signal.",
    "spikes": "The record has spikes: single readings far from those around them.",
    "bursts": "Large errors are too many, or too close together, for single outliers.",
    "too_slow": "The filter is too slow for this record.",
    "too_fast": "The filter is too fast for this record: it lets through noise that could be removed.",
    "structure": "The record holds more than the model describes.",
    "changes": "The record changes as it goes on: one pair cannot fit all of it.",
    "gate": "The outlier gate rejects more than single outliers.",
    "shape": "The errors of the filter are far from normally distributed.",
    "steps": "The signal steps: no q both follows the steps and smooths well between them.",
    "constant": "The signal is constant: there is nothing to judge the filter by.",
    "rounded": "The readings are rounded more coarsely than their noise, or held.",
    "vague": "The filter fits, and so does any other q/r: the record cannot tell them apart.",
    "weak": "The filter fits, but by this model nearly every change in the record is movement.",
}
"""What each status says of the record; the others hold a number or quote the estimate."""

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
