"""A row of the table: one channel of one recording, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass, fields

FAILED = "failed"
"""Verdict of a recording that could not be read or fitted."""
TIMED_OUT = "timed_out"
"""Verdict of one that was not done within the time limit."""
UNREAD = (FAILED, TIMED_OUT)


@dataclass(frozen=True, slots=True)
class Row:
    """What is known of one channel of one recording. None where it is not known."""

    id: str
    """Name of the recording: its path below the folder that was given, or the id of its series."""
    channel: str = ""
    """Name of the channel; "" where the recording could not be read."""
    unit: str = ""
    """Unit of the signal, "" where unknown."""
    samples: int = 0
    """Samples, missing ones included."""
    rate_hz: float | None = None
    """Sample rate, Hz."""
    q: float | None = None
    """Process-noise variance per sample, unit²."""
    r: float | None = None
    """Measurement-noise variance, unit²."""
    q_low: float | None = None
    """The least q that the record allows, 95 %, unit²; None where nothing was estimated."""
    q_high: float | None = None
    """The largest q that it allows; inf where it excludes none."""
    r_low: float | None = None
    """The least r that the record allows, 95 %, unit²."""
    r_high: float | None = None
    """The largest r that it allows."""
    momentum: float | None = None
    """Momentum, sample periods; 0 = none."""
    gate: float | None = None
    """Outlier gate on v²/s; None = off."""
    lag_samples: float | None = None
    """Lag of the settled filter on a ramp, sample periods."""
    verdict: str = FAILED
    """That of the estimate, "chosen" where the filter was specified, or one of UNREAD."""
    nis: float | None = None
    """Mean of v²/s over the samples that the filter takes; 1 fits."""
    spikes: int = 0
    """Samples that the fit set aside."""
    rejected_lines: int = 0
    """Lines of the file that could not be read."""
    seconds: float = 0.0
    """Processor time that it took, s."""
    reason: str = ""
    """Why there is no q and r; "" where there are."""
    source: str = ""
    """Where the recording is: an absolute path, or in JSON the row groups that hold it, see `Unit.source`."""
    lag_loss_samples: float | None = None
    """By how many samples the filter for all lags more than the device's own; known once all are fitted."""
    noise_loss_db: float | None = None
    """How much more noise it leaves, dB."""
    error_growth: float | None = None
    """By which share its error of predicting samples that no fit has seen is larger."""
    left: bytes | None = None
    """What the three are computed from, see `store.left`; the finished table has them in its place."""


LEFT = "left"
"""The column that is not in a finished table."""
COLUMNS = tuple(one.name for one in fields(Row))
"""The columns of the table, in order, before the answer."""
FINISHED = tuple(name for name in COLUMNS if name != LEFT)
"""The columns of a finished table."""
