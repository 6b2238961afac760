"""Find q and r: estimation from a record, and from what the user knows; one module a method."""

from __future__ import annotations

from kalscope.errors import Cancelled
from kalscope.estimation.estimate import METHODS, compare_methods, disagreement, estimate
from kalscope.estimation.known import (
    StillNoise,
    estimate_fixed_r,
    estimate_fixed_ratio,
    noise_from_datasheet,
    noise_from_still,
    params_for_specification,
)
from kalscope.estimation.result import Estimate

__all__ = [
    "METHODS",
    "Cancelled",
    "Estimate",
    "StillNoise",
    "compare_methods",
    "disagreement",
    "estimate",
    "estimate_fixed_r",
    "estimate_fixed_ratio",
    "noise_from_datasheet",
    "noise_from_still",
    "params_for_specification",
]
