"""What the tests of the dashboard show: random walks, and a live board whose samples the test sends."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from kalscope import Recording
from kalscope.sources.live.samples import Snapshot
from kalscope_app.session.state import ConnectionState


def walk(n=1000, names=("a", "b"), units="V", period=0.01, *, scale=1.0, missing=0.0, truth=False, seed=0, **more):
    """A walk of steps of variance 0.01 under noise of variance 1 in each channel, times `scale`."""
    g = np.random.default_rng(seed)
    signal = scale * np.cumsum(g.normal(0.0, 0.1, (n, len(names))), axis=0)
    z = signal + scale * g.normal(size=signal.shape)
    z[g.random(z.shape) < missing] = np.nan
    more, time = {"source": "file.csv", "truth": signal if truth else None, **more}, np.arange(n) * (period or 1.0)
    return Recording(time, names, (units,) * len(names) if isinstance(units, str) else units, z, period, **more)


class Board:
    """A board whose samples the test sends, and the only one that a session knows."""

    def __init__(self, names=("a", "b"), period=0.01):
        self.names, self.period, self.generation, self.id = names, period, 0, self
        self.looked_at = []
        self.values = np.empty((0, len(names)))
        self.first = 0

    def send(self, count, seed=0):
        new = np.random.default_rng(seed + len(self.values)).normal(size=(count, len(self.names)))
        self.values = np.concatenate([self.values, new])
        return self

    def snapshot(self, _board=None):
        values = self.values[self.first :]
        if not len(values):
            return None
        time, units = (np.arange(len(values)) + self.first) * self.period, ("",) * len(self.names)
        recording = Recording(time, self.names, units, values, self.period, source="serial:x", title="x")
        return Snapshot(recording, self.first, self.generation, len(self.values))

    def state(self, _board=None):
        return ConnectionState(True, False, SimpleNamespace(word="connected", hint="", recording=None))

    def look_at(self, board):
        self.looked_at.append(board)
