"""What the fused value is worth, and which sensor disagrees: an idle-time computation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from kalscope.analysis.fusion.judge import judge_fusion
from kalscope.analysis.fusion.result import Fault, FusionVerdict, SensorVerdict
from kalscope_app.engine.cache import Cache
from kalscope_app.session.fusion import Fusion
from kalscope_app.session.state import State

Tone = Literal["good", "note", "bad"]

WORDS: dict[Fault, tuple[str, Tone]] = {
    "drift": ("disagrees", "bad"),
    "noise": ("disagrees", "bad"),
    "stuck": ("is stuck", "bad"),
    "spikes": ("has spikes", "note"),
    "silent": ("was silent", "note"),
}
"""The words for a sensor with a fault, and their colour."""

MAX_NAME = 20
"""Characters of a sensor's name on the button above the tabs."""


@dataclass(frozen=True)
class Judged:
    """The verdict on the fused sensors in words; plain text, with names from outside."""

    word: str
    """On the button above the tabs."""
    tone: Tone
    """Its colour."""
    headline: str
    """How much better than the best single sensor."""
    faults: tuple[str, ...]
    """The sensors with faults, one sentence each."""
    notes: tuple[str, ...]
    """What was found on a held-out stretch, and what cannot be known."""


class FusionJudge:
    """Judges the fused sensors on screen, and keeps the answer while only the view changes."""

    def __init__(self) -> None:
        self._verdicts = Cache[FusionVerdict]()

    def of(self, state: State) -> Judged | None:
        """The verdict on the fused sensors on screen, in words; None where one channel is on screen."""
        fusion = state.fusion
        if fusion is None:
            return None
        self._verdicts.begin(state.recording, fusion.used.sensors, state.recording.gaps)
        return judged(fusion, self._verdicts.get(fusion.params, lambda: _verdict(state, fusion)))


def _verdict(state: State, fusion: Fusion) -> FusionVerdict:
    found = None if fusion.dropped else fusion.estimate
    return judge_fusion(
        state.recording.values[:, fusion.columns(state.recording)],
        fusion.params if found is None else replace(found, params=fusion.params),
        state.dt,
        names=fusion.used.sensors,
        unit=fusion.tuning.unit,
        sample_period=state.recording.sample_period,
    )


def judged(fusion: Fusion, verdict: FusionVerdict) -> Judged:
    """The verdict as it appears on screen."""
    odd = [one for one in verdict.sensors if one.faults]
    faults = dict.fromkeys(sentence for one in odd for sentence in one.sentences[: len(one.faults)])
    seen = [one for one in verdict.sentences if one.startswith("In the second half")]
    word, tone = _word(odd, shared=verdict.shared is not None)
    return Judged(
        word,
        tone,
        verdict.headline,
        tuple(faults),
        (*seen, *_about_estimate(fusion)),
    )


def _word(odd: list[SensorVerdict], *, shared: bool) -> tuple[str, Tone]:
    """The label of the button, and its colour, for these sensors with faults, or noise that sensors share."""
    if shared and not odd:
        return "sensors share noise", "bad"
    if not odd:
        return "fused", "good"
    tone = "bad" if any(WORDS[fault][1] == "bad" for one in odd for fault in one.faults) else "note"
    if len(odd) > 1:
        return f"check {len(odd)} sensors", tone
    return f"{odd[0].name[:MAX_NAME]} {WORDS[odd[0].faults[0]][0]}", tone


def _about_estimate(fusion: Fusion) -> tuple[str, ...]:
    """What cannot be known, and the message of a search that did not find the usual filter."""
    found = fusion.estimate
    if found is None:
        return ()
    return found.notes if found.verdict == "ok" or fusion.dropped else (found.message, *found.notes)
