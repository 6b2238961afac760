"""The best q, r and τ of a record, and how well it determines them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MomentumFit:
    """q, r and τ at the maximum of the likelihood, in the unit of the data."""

    q: float
    """Process-noise variance per sample, unit²."""
    r: float
    """Measurement-noise variance, unit²."""
    tau: float
    """Momentum in sample periods."""
    loglik: float
    """Log-likelihood there, comparable with that of the random walk."""
    q_se: float
    """Standard error of q, unit²; inf at an edge."""
    r_se: float
    """Standard error of r, unit²; inf at an edge."""
    tau_interval: tuple[float, float]
    """The τ that the record allows: profile-likelihood 95 %, from 0, or up to inf; τ itself where it was given."""
    region: tuple[tuple[float, float], ...]
    """Pairs (q/r, τ) on the border of what the record allows: the possible filters lie between them."""
