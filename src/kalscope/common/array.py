"""The array types of signals, and of positions in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Indices = NDArray[np.intp]
"""Positions in an array, from 0."""

Mask = NDArray[np.bool_]
"""True for the elements that are chosen."""
