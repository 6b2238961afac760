"""What each method returns."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Pair:
    """What one method finds in one channel, in the squared scale of its `Differences`."""

    q: float
    """Process-noise variance, scale², ≥ 0."""
    r: float
    """Measurement-noise variance, scale², ≥ 0."""
    q_se: float
    """Standard error of q, scale²; inf where unknown."""
    r_se: float
    """Standard error of r, scale²; inf where unknown."""
    verdict: str = ""
    """A verdict of the method itself: "irregular", "too_few", "not_converged"; "" = judge by the numbers."""
    text: str = ""
    """The message, in place of the one for the verdict; "" = that one."""
    note: str = ""
    """A sentence to add to the message."""
