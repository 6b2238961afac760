"""What can be done about a finding, as a value.

The command line turns an action into the option that does it, the dashboard into a button.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Scale:
    """Multiply q and r."""

    q_factor: float
    """Factor for q, 1e-12 … 1e12; 1 = keep."""
    r_factor: float
    """Factor for r, 1e-12 … 1e12; 1 = keep."""


@dataclass(frozen=True)
class SetGate:
    """Set the outlier gate, or switch it off."""

    sigma: float | None
    """Residuals beyond this many σ are rejected (`FilterParams.gate` is its square); None = off."""


@dataclass(frozen=True)
class EstimateAgain:
    """Estimate q, r and momentum from the whole record, as `estimate` does by default."""


@dataclass(frozen=True)
class AddMomentum:
    """Add momentum at the same lag."""

    tau: float
    """Sample periods, > 0."""


@dataclass(frozen=True)
class AddTwoSpeeds:
    """Find two speeds: calm at rest, quick while the signal moves."""


@dataclass(frozen=True)
class AddNotch:
    """Put a notch before the filter, at the strongest narrow line of the spectrum."""


@dataclass(frozen=True)
class SetSpikesAside:
    """Estimate again by the spike-proof fit, `robust=True`."""


@dataclass(frozen=True)
class UseStillStretch:
    """Take r from a stretch in which the input is constant."""

    first: int
    """Number of its first sample."""
    last: int
    """One past its last."""


@dataclass(frozen=True)
class GiveNoise:
    """Give r: from a data sheet, or from a still stretch that the record does not show."""


@dataclass(frozen=True)
class ChooseFilter:
    """Choose the lag, the cut-off or the gain, because the record does not decide it."""


@dataclass(frozen=True)
class UnsetStart:
    """Leave x0 and p0 unset: the first sample starts the filter."""


@dataclass(frozen=True)
class RecordLonger:
    """Record again, for longer or while the signal moves."""


Action = (
    Scale
    | SetGate
    | EstimateAgain
    | AddMomentum
    | AddTwoSpeeds
    | AddNotch
    | SetSpikesAside
    | UseStillStretch
    | GiveNoise
    | ChooseFilter
    | UnsetStart
    | RecordLonger
)
"""Every action; a program that applies advice must handle each of them."""
