"""What the fused value is worth, and which sensor disagrees: an idle-time computation."""

from __future__ import annotations

from dataclasses import dataclass, replace

from kalscope.analysis.fused import FusionJudgement, judge_fusion
from kalscope_app.engine.cache import Cache
from kalscope_app.session.fusion import Fusion
from kalscope_app.session.state import State


@dataclass(frozen=True)
class Judged:
    """The judgement of the fused sensors on screen; plain text, with names from outside."""

    judgement: FusionJudgement
    """What fusing brings, and the faults of the sensors."""
    notes: tuple[str, ...]
    """What was found on a held-out stretch, and what cannot be known."""


class FusionJudge:
    """Judges the fused sensors on screen, and keeps the answer while only the view changes."""

    def __init__(self) -> None:
        self._verdicts = Cache[FusionJudgement]()

    def of(self, state: State) -> Judged | None:
        """The verdict on the fused sensors on screen, in words; None where one channel is on screen."""
        fusion = state.fusion
        if fusion is None:
            return None
        self._verdicts.begin(state.recording, fusion.used.sensors, state.recording.gaps)
        judgement = self._verdicts.get(fusion.params, lambda: _verdict(state, fusion))
        half = (judgement.second_half,) if judgement.second_half else ()
        return Judged(judgement, (*half, *_about_estimate(fusion)))


def _verdict(state: State, fusion: Fusion) -> FusionJudgement:
    found = None if fusion.dropped else fusion.estimate
    return judge_fusion(
        state.recording.values[:, fusion.columns(state.recording)],
        fusion.params if found is None else replace(found, params=fusion.params),
        state.dt,
        names=fusion.used.sensors,
        unit=fusion.tuning.unit,
        sample_period=state.recording.sample_period,
    )


def _about_estimate(fusion: Fusion) -> tuple[str, ...]:
    """What cannot be known, and the message of a search that did not find the usual filter."""
    found = fusion.estimate
    if found is None:
        return ()
    return found.notes if found.verdict == "ok" or fusion.dropped else (found.message, *found.notes)
