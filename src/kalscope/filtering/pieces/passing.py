"""The filter over a whole record, a piece at a time: for what needs all of its rows, but none for long."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from kalscope.filtering.arrays import one_channel, refuse_infinite, steps_of
from kalscope.filtering.batch import FilterResult
from kalscope.filtering.channels import channel_filters
from kalscope.filtering.params import FilterParams

PIECE = 16384
"""Samples that are filtered at once: their rows, 0.9 MB with momentum, stay in the processor's cache."""


def filter_pieces(
    z: ArrayLike, params: FilterParams, dt: ArrayLike | None = None
) -> Iterator[tuple[int, FilterResult]]:
    """What `kalman_filter` gives, piece by piece: the first sample of each, and its result.

    The arrays of a result are overwritten by the next one; its sums are those of the piece.

    Args:
        z: measurements of one channel, shape (n,); NaN is a missing sample.
        params: the model, scalars.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.

    Raises:
        BadSetting: z holds inf or has another shape; dt or params do not fit z.
    """
    samples = one_channel(z, params)
    steps = steps_of(dt, len(samples))
    refuse_infinite(samples[None])
    (one,) = channel_filters(params, 1)
    rows = np.empty((one.rows, min(PIECE, len(samples))))
    for first in range(0, len(samples), PIECE):
        piece = np.ascontiguousarray(samples[first : first + PIECE])
        out = rows[:, : len(piece)]
        loglik, scored, refused = one.filter(piece, steps[first : first + PIECE], list(out))
        x, p, k, innovation, s, *velocity = out
        yield first, FilterResult(x, p, k, innovation, s, loglik, scored, refused, *velocity)
