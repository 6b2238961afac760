"""The textbook of the filter with momentum, one operation a rounding: in numpy's float32, or in double."""

from __future__ import annotations

import numpy as np

from kalscope.export.float32 import without_momentum
from kalscope.filtering.kernels import GATE_LIMIT

F = np.float32


class ByHand:
    """Each matrix product written out in the order that boards use; goes on when values change.

    x and the velocity v have the variances p and w and the covariance g; without momentum v, g and w are 0: the
    five lines. Params are `Float32Params`, or what has their fields in double where `kind` is float.
    """

    def __init__(self, params, kind=F):
        self.kind, self.k = kind, kind(0)
        self.use(params)
        self.x, self.v, self.p, self.g, self.w = params.x0, kind(0), params.p0, kind(0), self.m.w0
        self.gate, self.refused = params.gate, 0

    def use(self, params):
        self.r, self.m = params.r, params.momentum or without_momentum(params.q)

    def update(self, z):
        F = self.kind
        z, m, self.k = F(z), self.m, F(0)
        fw = F(m.f * self.w)
        self.p = F(F(self.p + F(m.f * F(F(F(2) * self.g) + fw))) + m.q11)
        self.g = F(F(m.e * F(self.g + fw)) + m.q12)
        self.w = F(F(F(m.e * m.e) * self.w) + m.q22)
        self.x, self.v = F(self.x + F(m.f * self.v)), F(m.e * self.v)
        s, i = F(self.p + self.r), F(z - self.x)
        if np.isnan(z) or (s == 0 and not np.isnan(self.x)):
            return self.x
        if np.isinf(self.p):
            self.x, self.p, self.g, self.k, self.refused = z, self.r, F(0), F(1), 0
        elif self.gate > 0 and F(i * i) > F(self.gate * s) and self.refused < GATE_LIMIT:
            self.refused += 1
        else:
            k, ell = (F(self.p / s), F(self.g / s)) if s > 0 else (F(0), F(0))
            self.k = k
            self.p, self.g, self.w = F(k * self.r), F(ell * self.r), F(self.w - F(ell * self.g))
            steps = (z, self.v) if np.isnan(self.x) else (F(self.x + F(k * i)), F(self.v + F(ell * i)))
            (self.x, self.v), self.refused = steps, 0
        return self.x
