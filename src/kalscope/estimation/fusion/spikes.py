"""Spikes of each sensor, by the rule of one sensor, and whether the fused filter should have a gate for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kalscope.common.array import Array, Mask
from kalscope.estimation.result import Estimate
from kalscope.estimation.robust.kernels import SIGMAS
from kalscope.filtering.filter import fuse, smooth
from kalscope.filtering.params import FilterParams


def spikes_of(singles: Sequence[Estimate], z: Array) -> Mask:
    """The readings that are set aside, shape (n, sensors).

    Args:
        singles: the estimate of each sensor for itself.
        z: the readings, shape (n, sensors), NaN where missing.
    """
    none = np.zeros(len(z), dtype=bool)
    away = np.stack([none if one.outliers is None else one.outliers for one in singles], axis=1)
    if len(singles) > 1:  # what most of the sensors see at once belongs to the quantity
        away &= 2 * away.sum(axis=1, keepdims=True) <= np.isfinite(z).sum(axis=1, keepdims=True)
    return away


def with_gate(params: FilterParams, z: Array, steps: Array, away: Mask) -> FilterParams:
    """The parameters with a gate, where it brings the fused filter nearer to the signal; as `robust.gate` for one.

    Args:
        params: the filter.
        z: the readings with the spikes, shape (n, sensors).
        steps: nominal sample periods before each row; empty = 1 each.
        away: the readings set aside, shape (n, sensors).
    """
    if not away.any():
        return params
    dt = steps if len(steps) else None
    signal = smooth(np.where(away, np.nan, z), params, dt).x
    gated = replace(params, gate=SIGMAS**2)
    errors = [float(np.nansum(np.square(fuse(z, one, dt).x - signal))) for one in (params, gated)]
    return gated if errors[1] < errors[0] else params
