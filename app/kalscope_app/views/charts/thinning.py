"""Fewer points for a chart that is drawn at every step of a control that moves.

They are some of those that are drawn once it has stopped, the first and the last among them: neither the axes nor
the raw signal move when the others follow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kalscope_app.engine.cache import Cache
from kalscope_app.engine.decimation import DrawnSamples, choose_indices
from kalscope_app.engine.frame import Frame

MAX_MOVING_POINTS = 2000
"""Points of a line while a control moves, at most: about two to each pixel of a wide chart."""


class Thinning:
    """Chooses the points once for each view of the recording."""

    def __init__(self) -> None:
        self._places = Cache[NDArray[np.intp]]()

    def of(self, frame: Frame) -> NDArray[np.intp] | None:
        """Indices of the points to draw among those of the frame; None: all, where single samples are visible."""
        drawn = frame.drawn
        if drawn.band is None or frame.set_aside is not None or len(drawn.indices) <= MAX_MOVING_POINTS:
            return None
        return self._places.once(lambda: places_to_keep(drawn), drawn)


def places_to_keep(drawn: DrawnSamples) -> NDArray[np.intp]:
    """Ascending: the first, last, highest and lowest, and those that keep the shape of raw signal and truth."""
    chosen = choose_indices(drawn.raw, drawn.truth, MAX_MOVING_POINTS - 2)
    return np.union1d(chosen, (drawn.raw.argmin(), drawn.raw.argmax())).astype(np.intp)
