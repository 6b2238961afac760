"""SimpleKalmanFilter (denyssene): refused, with the smoothing line that is nearest."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kalscope.export.targets.fixed_gain import refusal

if TYPE_CHECKING:
    from kalscope.export.job import ExportJob


def files(job: ExportJob) -> dict[str, str]:
    """Always raises BadSetting."""
    raise refusal(job, "SimpleKalmanFilter", lambda word, gain: f"{word} += {gain} * (z - {word})")
