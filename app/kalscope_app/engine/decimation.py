"""Which samples of a long record are drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from tsdownsample import MinMaxLTTBDownsampler

from kalscope.common.array import Array

POINT_LIMIT = 4000
"""Most points a line is drawn with."""


def choose_indices(z: Array, truth: Array | None = None, limit: int = POINT_LIMIT) -> NDArray[np.intp]:
    """Ascending indices of at most `limit` samples that keep the look of z, shape (n,), and of the truth."""
    n = len(z)
    if n <= limit:
        return np.arange(n, dtype=np.intp)
    if truth is None:
        return _downsample(z, limit)
    share = limit // 4
    return np.union1d(_downsample(z, limit - share), _downsample(truth, share)).astype(np.intp)


def _downsample(y: Array, points: int) -> NDArray[np.intp]:
    """MinMaxLTTB; missing samples are held at their last value for the choice."""
    if np.isnan(y).any():
        known = np.where(np.isnan(y), 0, np.arange(len(y)))
        y = np.nan_to_num(y[np.maximum.accumulate(known)])
    chosen = MinMaxLTTBDownsampler().downsample(np.ascontiguousarray(y), n_out=points)
    return np.unique(chosen).astype(np.intp)
