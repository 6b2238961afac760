"""The mean rate of a recording and how much its steps vary: what a lag in seconds must be judged by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.common.text import percent, sample_rate
from kalscope.recording import Recording

MIN_SPREAD = 0.005
"""Steps that vary by a smaller share of their mean are called even."""


@dataclass(frozen=True)
class MeanRate:
    """One sample every `period` seconds on average."""

    period: float
    """Mean time between two samples in s, pauses left out."""
    spread: float
    """Standard deviation of that time as a share of it; 0 where the samples come evenly."""

    @property
    def words(self) -> str:
        """For the screen: "100 Hz", "13.4 Hz ± 12 %"."""
        varies = f" ± {percent(self.spread)}" if self.spread >= MIN_SPREAD else ""
        return f"{sample_rate(self.period)}{varies}"


def mean_rate(recording: Recording) -> MeanRate | None:
    """The mean rate of a recording; None where it has no time. It reads every stamp, so call it once a recording.

    Only uneven stamps have a spread: bursts and coarse clocks were placed evenly, and a rate that the user chose is
    taken as it is.
    """
    period, timing = recording.sample_period, recording.report.timing
    if period is None:
        return None
    if timing is None or timing.stamps != "uneven" or timing.source == "option":
        return MeanRate(period, 0.0)
    steps = np.diff(recording.time)
    steps = steps[steps > 0.0]
    usual = len(steps) - timing.pauses  # the longest steps are the pauses
    if recording.gaps == "missing" or not 0 < usual < len(steps):  # rows were put into the pauses, or there is none
        usual = len(steps)
    steps = np.partition(steps, usual - 1)[:usual]
    mean = float(steps.mean())
    return MeanRate(mean, float(steps.std()) / mean)
