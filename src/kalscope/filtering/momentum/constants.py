"""What a device must know about a momentum: the constants of one sample period, which never change."""

from __future__ import annotations

from dataclasses import dataclass

from kalscope.filtering.kernels import transition

FORGOTTEN = 1.2e-38
"""Shares of a velocity below this are 0: float32 cannot hold them, and they change no later value."""


@dataclass(frozen=True)
class StepConstants:
    """Over one sample period x grows by f v, v fades to e v, and their variances grow."""

    momentum: float
    """Momentum τ, sample periods; 0 = the five lines."""
    e: float
    """Share of the velocity that is left after one sample."""
    f: float
    """Distance that a velocity of 1 goes in one sample, sample periods."""
    q11: float
    """Variance added to x, unit²."""
    q12: float
    """Covariance added, unit² per sample."""
    q22: float
    """Variance added to v, (unit per sample)²."""
    w0: float
    """Variance of v before the first sample, q/(2τ), (unit per sample)²."""


def step_constants(q: float, momentum: float) -> StepConstants:
    """The constants of one channel; a velocity that does not last a sample is none, so τ = 0 is the five lines."""
    if momentum == 0.0:
        return StepConstants(0.0, e=0.0, f=0.0, q11=q, q12=0.0, q22=0.0, w0=0.0)
    e, f, q11, q12, q22 = transition(1.0, q, momentum)
    return StepConstants(momentum, e if e > FORGOTTEN else 0.0, f, q11, q12, q22, 0.5 * q / momentum)
