"""How much noise the rule itself removes: of good samples the largest few are set aside with the spikes.

A sample is z = x + e with e of variance r, and both sides together predict it with an error v, z - prediction, of
variance s = r + p/2, where p is that of one side. It is set aside where |v| > c √s. The part ρ v of e, ρ = r/s, is
known from v, the rest is independent of it: with the share P = 2 Q(c) of the samples goes the share

    I = ρ 2 (c φ(c) + Q(c)) + (1 - ρ) P

of Σe², and the kept samples show the variance r (1 - I)/(1 - P). At c = 4 this is 0.999 r where x hardly moves, and
nearer to r where it moves fast. The movement is the same for kept samples and others, so q
needs no correction. It is scaled with r all the same, so that q/r stays as fitted: 0.1 % is far below its error.
"""

from __future__ import annotations

import math


def kept_variance(gain: float, sigmas: float) -> float:
    """Share of r that the kept samples show, (1 - I)/(1 - P).

    Args:
        gain: steady gain of the filter, p/(p + r), 0 … 1.
        sigmas: the threshold c.
    """
    gone = math.erfc(sigmas / math.sqrt(2.0))
    density = math.exp(-0.5 * sigmas * sigmas) / math.sqrt(2.0 * math.pi)
    known = (1.0 - gain) / (1.0 - 0.5 * gain)
    taken = known * (2.0 * sigmas * density + gone) + (1.0 - known) * gone
    return (1.0 - taken) / (1.0 - gone)
