"""What a board makes of a momentum that it is sent: the constants of its filter, in float32 as well."""

from __future__ import annotations

import numpy as np

from kalscope.export.float32 import Float32Momentum

LAST_POWER = 13
"""Powers of 1/τ in the series: the next one is below the last bit."""


def momentum_on_board(q: np.float32, tau: np.float32) -> Float32Momentum | None:
    """The momentum that a board computes for itself when it is sent q or τ, bit for bit; None for τ = 0.

    Only sums, products and quotients, so that every processor gives these bits: 1 - e by its series for 1/τ up to
    1, doubled as often as 1/τ was halved for that; q11 by its series, or above 1 by the difference that it is.
    """
    if tau == 0.0:
        return None
    one, half = np.float32(1.0), np.float32(0.5)
    h = one / tau
    halved, doublings = h, 0
    while halved > one:
        halved, doublings = halved * half, doublings + 1
    power = gone = halved  # ±hⁿ/n!, and 1 - e
    a = both = np.float32(0.0)  # (2^(n-1) - 2) ± hⁿ/n! summed, and that factor
    for n in range(2, LAST_POWER + 1):
        power = power * -halved / np.float32(n)
        gone = gone + power
        a = a + both * power
        both = both + both + np.float32(2.0)
    for _ in range(doublings):
        gone = gone * (np.float32(2.0) - gone)
    if doublings:
        a = h - gone - half * gone * gone
    w0 = half * q / tau
    return Float32Momentum(
        momentum=tau,
        e=one - gone,
        f=tau * gone,
        q11=q * tau * a,
        q12=half * q * gone * gone,
        q22=w0 * gone * (np.float32(2.0) - gone),
        w0=w0,
    )
