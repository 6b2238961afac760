"""SimpleKalmanFilter (denyssene): refused, with the smoothing line that is nearest."""

from __future__ import annotations

from kalscope.export.fixed_gain import refusal
from kalscope.export.job import ExportJob


def files(job: ExportJob) -> dict[str, str]:
    """Always raises BadSetting."""
    raise refusal(job, "SimpleKalmanFilter", lambda word, gain: f"{word} += {gain} * (z - {word})")
