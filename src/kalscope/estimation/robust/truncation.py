"""How much noise the rule itself takes away: of good samples the largest few are set aside with the spikes.

Take z = x + e with e of variance r, and x predicted from either side with the variance p, independently of e and of
the other side: s = r + p. With e = u √r one side refuses the sample with the probability

    g(u) = Q((c √s − u √r)/√p) + Q((c √s + u √r)/√p),

and both with g². So with the share P = ∫ φ(u) g(u)² du of the samples the share I = ∫ u² φ(u) g(u)² du of e² goes,
and the kept ones show the variance r (1 − I)/(1 − P). At c = 4 this is 0.999 r where x hardly moves, and r where it
moves fast. The movement x is the same for kept samples and others, so q stays.
"""

from __future__ import annotations

import math

import numpy as np

_GRID = np.linspace(-10.0, 10.0, 4001)
"""u of the integrals: steps of 0.005, far beyond any threshold."""


def kept_variance(gain: float, sigmas: float) -> float:
    """Share of r that the kept samples show, (1 − I)/(1 − P).

    Args:
        gain: steady gain p/s of the filter, 0 … 1.
        sigmas: the threshold c.
    """
    from scipy.special import ndtr

    p = min(max(gain, 1e-9), 1.0 - 1e-9)  # in units of s
    noise, moves = math.sqrt(1.0 - p), math.sqrt(p)
    refused = ndtr((noise * _GRID - sigmas) / moves) + ndtr((-noise * _GRID - sigmas) / moves)
    weight = np.exp(-0.5 * _GRID**2) * refused**2 * (_GRID[1] - _GRID[0]) / math.sqrt(2.0 * math.pi)
    return float((1.0 - (weight @ _GRID**2)) / (1.0 - weight.sum()))
