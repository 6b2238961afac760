"""The one compiled loop here: the one-euro filter, whose cut-off follows its speed. No checks, no GIL, cached."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Array = NDArray[np.float64]


@compiled()
def one_euro(z: Array, slowest: float, beta: float, speed_cutoff: float, out: Array) -> None:
    """Exponential smoothing with cut-off slowest + beta·|speed|, cycles a sample; the speed has one of its own.

    A missing sample leaves the output where it is, and the next one counts the time since: α = 1/(1 + 1/(2πf·t)).
    Casiez, Roussel & Vogel (2012), CHI '12, 2527, section "1€ filter"; speed from the last output.
    """
    x, speed, elapsed, started = math.nan, 0.0, 0.0, False
    for i in range(len(z)):
        elapsed += 1.0
        if not math.isnan(z[i]):
            if started:
                turn = 2.0 * math.pi * elapsed
                share = 1.0 / (1.0 + 1.0 / (turn * speed_cutoff))
                speed += share * ((z[i] - x) / elapsed - speed)
                x += (z[i] - x) / (1.0 + 1.0 / (turn * (slowest + beta * abs(speed))))
            else:
                x, started = z[i], True
            elapsed = 0.0
        out[i] = x
