"""What a method finds in records simulated under a given pair: a sampling distribution that has no formula.

A parametric bootstrap (Efron & Tibshirani 1993, section 6.5). The distribution depends on q/r and on the pattern of
the samples alone, not on the unit. A long record is simulated with fewer samples: `MAX_SAMPLES`.
"""

from __future__ import annotations

import hashlib
import math
import threading
from collections import OrderedDict

import numpy as np

from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.methods.by_name import QUICK

SIMULATIONS = 200
"""Simulated records of a whole distribution."""
FIRST_SIMULATIONS = 40
"""Simulated records of a first check whether the answer is unusual at all."""
MAX_SAMPLES = 6000
"""Samples of a simulated record."""
_BLOCKS = 8
"""Stretches of a long record whose pattern of missing samples is taken."""
_SEED = 20250316
_MAX_LAWS = 64


def law(method: str, data: Differences, ratio: float, simulations: int, progress: Progress) -> Array:
    """The pairs that the method finds in records simulated with q = λ and r = 1 (λ = ∞: q = 1 and r = 0).

    Args:
        method: one of QUICK.
        data: the record; only the gaps between its samples count.
        ratio: λ = q/r of the simulated records, 0 … inf.
        simulations: how many.
        progress: receives progress reports.

    Returns:
        q and r, shape (k, 2), one row for each record in which the method finds an answer.
    """
    gap, count = pattern(data)
    key = hashlib.blake2b(repr((method, count, ratio)).encode() + gap.tobytes(), digest_size=16).digest()
    begun, found = _laws.get(key)
    if begun < simulations:
        rows = [found]
        for i in range(begun, simulations):
            progress((i - begun) / (simulations - begun), f"simulated records, {method}")
            rows.append(_answer(method, gap, count, ratio, i))
        found = np.concatenate(rows)
        _laws.put(key, (simulations, found))
    return found


def simulated_pair(ratio: float) -> tuple[float, float]:
    """The q and r of the simulated records."""
    return (1.0, 0.0) if ratio == math.inf else (ratio, 1.0)


def pattern(data: Differences) -> tuple[Array, int]:
    """The gaps of a simulated record, empty for regular sampling, and its number of differences."""
    count = min(data.m, MAX_SAMPLES)
    if not len(data.gap) or count == data.m:
        return data.gap, count
    size = count // _BLOCKS
    starts = np.linspace(0, data.m - size, _BLOCKS).astype(int)
    return np.concatenate([data.gap[start : start + size] for start in starts]), size * _BLOCKS


def _answer(method: str, gap: Array, count: int, ratio: float, seed: int) -> Array:
    """What the method finds in one simulated record, shape (1, 2), or (0, 2) where it finds nothing."""
    q, r = simulated_pair(ratio)
    g = np.random.default_rng((_SEED, seed))
    d = g.normal(0.0, math.sqrt(q), count) * (np.sqrt(gap) if len(gap) else 1.0)
    d += math.sqrt(r) * np.diff(g.normal(size=count + 1))
    pair = QUICK[method](Differences(d, gap, 1.0))
    return np.empty((0, 2)) if pair.verdict else np.array([[pair.q, pair.r]])


class _Laws:
    """The distributions simulated last, by a digest of what they depend on; thread-safe."""

    def __init__(self) -> None:
        self._kept: OrderedDict[bytes, tuple[int, Array]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: bytes) -> tuple[int, Array]:
        """How many records were simulated, and what was found in them."""
        with self._lock:
            return self._kept.get(key, (0, np.empty((0, 2))))

    def put(self, key: bytes, law: tuple[int, Array]) -> None:
        with self._lock:
            self._kept[key] = law
            self._kept.move_to_end(key)
            while len(self._kept) > _MAX_LAWS:
                self._kept.popitem(last=False)


_laws = _Laws()
