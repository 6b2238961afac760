"""Speed against others on the same work: every figure is a ratio of two times measured in the same run.

The two sides of a contest alternate, A B B A, so that a noisy machine slows both; medians are reported. Both get
the same record, q, r and start, and their results are compared, which shows that the work is the same.
"""

from __future__ import annotations

import gc
import math
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import FilterParams

Timed = Callable[[], Any]

MIN_TURN_S = 0.03
"""Least time of a turn, s: a single short run after a long one of the other side is luck."""
Q, R = 1e-4, 1.0
"""Variances of the random walk and of its noise: the slowest filter for which the speed is promised."""
PARAMS = FilterParams(q=Q, r=R)
"""Both for `kalman_filter`, with the exact diffuse start."""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    """What was timed."""
    n: int
    """Samples that both sides processed."""
    microseconds_per_sample: float | None
    """Median time over n, µs; None if the peer is not installed."""
    ratio: float | None
    """Median of time / time of `against`, turn by turn."""
    against: str
    """The other side."""
    difference: float | None
    """Largest |result − kalman_filter's x| over max |z|, or as the note says."""
    note: str
    """What a reader must know to judge the row."""


@dataclass(frozen=True)
class Work:
    """A random walk in noise, and the answer of `kalman_filter`."""

    z: Array
    """Measurements, shape (n,)."""
    x: Array
    """x of `kalman_filter`, shape (n,)."""

    @classmethod
    def make(cls, n: int) -> Work:
        """A record of n samples."""
        rng = np.random.default_rng(1)
        z = rng.standard_normal(n)
        z *= math.sqrt(Q)
        np.cumsum(z, out=z)
        z += rng.standard_normal(n)
        return cls(z, kalman_filter(z, PARAMS).x)

    def first(self, n: int) -> Work:
        """The first n samples; the filter is causal, so x is the same."""
        return Work(self.z[:n], self.x[:n])

    def difference(self, result: Any, since: int = 0) -> float:
        """The largest |result − x| from sample `since` on, over max |z|."""
        return float(np.max(np.abs(np.asarray(result)[since:] - self.x[since:])) / np.abs(self.z).max())


@dataclass(frozen=True)
class Contest:
    """Two ways to do the same work."""

    name: str
    against: str
    n: int
    """Samples of the work."""
    run: Timed
    """One turn of `name`."""
    opponent: Timed
    """One turn of `against`."""
    difference: Callable[[Any], float]
    """How far the result of `run` is from that of Kalscope, relative."""
    note: str = ""
    repetitions: int | None = None
    """Turns, if not as many as in the other contests."""


def measure(contest: Contest, repetitions: int) -> Row:
    """Hold one contest; the first turn of each side is not timed, it loads and compiles."""
    difference = contest.difference(contest.run())
    contest.opponent()
    first, second = take_turns(contest.run, contest.opponent, contest.repetitions or repetitions)
    return Row(
        name=contest.name,
        n=contest.n,
        microseconds_per_sample=statistics.median(first) / contest.n * 1e6,
        ratio=statistics.median(a / b for a, b in zip(first, second, strict=True)),
        against=contest.against,
        difference=difference,
        note=contest.note,
    )


def take_turns(a: Timed, b: Timed, repetitions: int) -> tuple[list[float], list[float]]:
    """Seconds of each turn of both, A B B A …, without the garbage collector."""
    times: tuple[list[float], list[float]] = [], []
    collecting = gc.isenabled()
    gc.disable()
    try:
        for turn in range(repetitions):
            order = ((a, times[0]), (b, times[1]))
            for run, into in order if turn % 2 == 0 else reversed(order):
                into.append(_seconds(run))
    finally:
        if collecting:
            gc.enable()
    return times


def _seconds(run: Timed) -> float:
    """The time of one turn; short work is repeated. Its result is freed within the time, on both sides."""
    start = time.perf_counter()
    run()
    once = time.perf_counter() - start
    if once > MIN_TURN_S:
        return once
    count = math.ceil(MIN_TURN_S / max(once, 1e-7))
    start = time.perf_counter()
    for _ in range(count):
        run()
    return (time.perf_counter() - start) / count
