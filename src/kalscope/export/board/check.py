"""Whether a board that runs the exported filter computes what Kalscope computes, compared bit by bit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.export.float32 import Float32Params, filter_float32

MAX_ROWS_TO_RESTART = 2000
"""Rows in which a restart is searched for: a board executes it within a few."""

MAX_RESTARTS_TRIED = 256
"""Candidate rows that are tried: while the input is constant and the old filter has settled on it, every row looks
like a restart."""


@dataclass(frozen=True)
class BoardCheck:
    """A board's filtered rows beside those of `filter_float32`, from its restart on."""

    rows: int
    """Rows compared."""
    different: int
    """Rows whose float32 is another one."""
    largest_steps: int
    """Largest distance, in steps from one float32 to the next."""
    largest: float
    """Largest distance, unit."""


def check_board(raw: ArrayLike, board: ArrayLike, params: Float32Params) -> BoardCheck | None:
    """Compare what a board sent with what its filter should have given.

    Args:
        raw: What the board measured, shape (n,), unit; NaN where missing.
        board: What its filter made of it, shape (n,), unit.
        params: The values that it reported. Its filter was restarted: the comparison begins at a row whose
            filtered value is that of a start, of several the one with the fewest differences after it.

    Returns:
        None where no restart is among the rows.
    """
    z, x = np.asarray(raw, dtype=np.float32), np.asarray(board, dtype=np.float32)
    best: BoardCheck | None = None
    for first in find_restarts(z, x, params)[:MAX_RESTARTS_TRIED]:
        check = _compared(z[first:], x[first:], params)
        if best is None or check.different < best.different:
            best = check
        if check.different == 0:
            break
    return best


def _compared(z: NDArray[np.float32], x: NDArray[np.float32], params: Float32Params) -> BoardCheck:
    ours, theirs = filter_float32(z, params), x
    sent = np.isfinite(theirs) & np.isfinite(ours)
    ours, theirs = ours[sent], theirs[sent]
    steps = np.abs(_ordered(ours) - _ordered(theirs))
    far = np.abs(ours.astype(np.float64) - theirs)
    return BoardCheck(
        rows=len(steps),
        different=int(np.count_nonzero(steps)),
        largest_steps=int(steps.max(initial=0)),
        largest=float(far.max(initial=0.0)),
    )


def find_restarts(raw: NDArray[np.float32], board: NDArray[np.float32], params: Float32Params) -> list[int]:
    """The rows whose filtered value is that of a filter's first row, in their order."""
    begins = np.zeros(len(raw), dtype=bool)
    if np.isnan(params.x0):
        begins = raw == board
    else:
        for i in range(min(len(raw), MAX_ROWS_TO_RESTART)):
            begins[i] = filter_float32(raw[i : i + 1], params)[0] == board[i]
    same = np.flatnonzero(begins)
    return same[: np.searchsorted(same, same[0] + MAX_ROWS_TO_RESTART)].tolist() if len(same) else []


def _ordered(values: NDArray[np.float32]) -> NDArray[np.int64]:
    """Numbers that count the float32 values in their order, so that differences count steps."""
    bits = values.view(np.int32).astype(np.int64)
    return np.where(bits < 0, -(bits & 0x7FFFFFFF), bits)
