"""How much the steps of a recording vary: its rate with that jitter, for the screen."""

from __future__ import annotations

import numpy as np

from kalscope.common.text import percent, sample_rate
from kalscope.recording import Recording

MIN_JITTER = 0.005
"""Steps that vary by a smaller share of the sample period are called even."""


def jitter_of(recording: Recording) -> float:
    """Standard deviation of the steps as a share of the sample period, pauses left out; 0 where they are even.

    It reads every stamp, so call it once per recording. Only uneven stamps have a jitter: bursts and coarse clocks
    were placed evenly, and a rate that the user chose has none.
    """
    period, timing = recording.sample_period, recording.report.timing
    if period is None or timing is None or timing.stamps != "uneven" or timing.source == "option":
        return 0.0
    steps = np.diff(recording.time)
    steps = steps[steps > 0.0]
    usual = len(steps) - timing.pauses  # the longest steps are the pauses
    if recording.gaps == "missing" or not 0 < usual < len(steps):  # rows were put into the pauses, or there is none
        usual = len(steps)
    return float(np.partition(steps, usual - 1)[:usual].std()) / period


def rate_words(period: float | None, jitter: float) -> str:
    """The rate of one sample every `period` s: "100 Hz", "13.4 Hz, steps ± 12 %", or that it is unknown."""
    if period is None:
        return "sample rate unknown"
    return sample_rate(period) + steps_words(jitter)


def steps_words(jitter: float) -> str:
    """What follows a rate: ", steps ± 12 %"; "" where the steps are even."""
    return f", steps ± {percent(jitter)}" if jitter >= MIN_JITTER else ""
