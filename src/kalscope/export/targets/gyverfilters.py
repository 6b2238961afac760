"""GyverFilters: its GKalman is refused; its GFilterRA is the nearest, our settled filter."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kalscope.export.targets.fixed_gain import refusal

if TYPE_CHECKING:
    from kalscope.export.job import ExportJob


def files(job: ExportJob) -> dict[str, str]:
    """Always raises BadSetting."""
    raise refusal(job, "GKalman of GyverFilters", lambda word, gain: f"GFilterRA {word}({gain}) (starts at 0)")
