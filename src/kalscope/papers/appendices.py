"""The programs of the documents, line for line in Python: the reference for our filter.

They share no code with it. The tests compare these transcripts with the originals, run by Octave and gcc.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array


def matlab_appendix(zk: ArrayLike, r: float = 100.0, q: float = 1.0) -> Array:
    """Appendix a of Ma'arif et al. (2019): xk = 0, Pk = 0, then predict, gain, update.

    Args:
        zk: the numbers that the appendix draws as (rand − rand)·100, shape (n,).
        r: its R, unit².
        q: its Q, unit².

    Returns:
        buff_xk, shape (n,).
    """
    xk, pk = 0.0, 0.0
    buff_xk: list[float] = []
    for z in np.asarray(zk, dtype=np.float64).tolist():
        pk = pk + q
        kk = pk / (pk + r)
        xk = xk + (kk * (z - xk))
        pk = (1 - kk) * pk
        buff_xk.append(xk)
    return np.array(buff_xk)


def arduino_appendix(sensor_data: ArrayLike, r: float = 100.0, q: float = 1.0, number: Any = np.float64) -> Array:
    """Appendix b of Ma'arif et al. (2019): Xt_prev = 0 as a global, Pt_prev = 1.

    Args:
        sensor_data: readings, shape (n,).
        r: its R, unit².
        q: its Q, unit².
        number: np.float32, as a `float` on the board, or np.float64.

    Returns:
        KalmanFilterData after each reading, shape (n,), of the kind `number`.
    """
    one, noise, drift = number(1), number(r), number(q)
    xt_prev, pt_prev = number(0), number(1)
    kalman_filter_data: list[Any] = []
    for reading in np.asarray(sensor_data, dtype=number):
        xt_update = xt_prev
        pt_update = pt_prev + drift
        kt = pt_update / (pt_update + noise)
        xt = xt_update + (kt * (reading - xt_update))
        pt = (one - kt) * pt_update
        xt_prev, pt_prev = xt, pt
        kalman_filter_data.append(xt)
    return np.array(kalman_filter_data, dtype=number)


def c_listing(measurements: ArrayLike, q: float, r: float, p: float, initial_value: float) -> tuple[Array, Array]:
    """kalman_init and kalman_update of the interactive-matter listing (2009).

    Args:
        measurements: shape (n,).
        q: process noise, unit².
        r: sensor noise, unit².
        p: first estimated error, unit².
        initial_value: first value, unit.

    Returns:
        x and p after each update, shape (n,) each.
    """
    x = initial_value
    states: list[tuple[float, float]] = []
    for measurement in np.asarray(measurements, dtype=np.float64).tolist():
        p = p + q
        k = p / (p + r)
        x = x + k * (measurement - x)
        p = (1 - k) * p
        states.append((x, p))
    pairs = np.array(states).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
