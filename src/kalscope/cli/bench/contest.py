"""Speed against others on the same work: every figure is a ratio of two clocks read in the same run.

The two sides of a contest take turns, A B B A, so that a noisy machine hurts both; medians are reported. Both
get the same record, q, r and start, and their results are compared, so that "the same work" is shown.
"""

from __future__ import annotations

import gc
import math
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.params import FilterParams

Clocked = Callable[[], object]

LEAST_TURN = 0.03
"""Seconds that a turn lasts at least: a single short run after a long one of the other side is luck."""
RATIO = 1e-4
"""λ of the record: the slowest filter for which the speed is promised."""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    """What was timed."""
    n: int
    """Samples that both sides worked on."""
    microseconds_per_sample: float | None
    """Median time over n, µs; None where the peer is not installed."""
    ratio: float | None
    """Median of time / time of `against`, turn by turn."""
    against: str
    """The other side."""
    difference: float | None
    """Largest |result − kalman_filter's x| over max |z|, or as the note says; None where nothing compares."""
    note: str
    """What a reader must know to judge the row."""


@dataclass(frozen=True)
class Sizes:
    """How much work a run does."""

    samples: int
    """Samples of the long record, for whatever is fast."""
    repetitions: int
    """Turns of each side; the median of them counts."""
    slowness: float
    """Slow peers run on their own number of samples over this."""

    def at_most(self, wanted: int) -> int:
        """Samples for a peer that would take too long on the whole record."""
        return min(self.samples, max(500, round(wanted / self.slowness)))


@dataclass(frozen=True)
class Work:
    """A random walk in noise, the model that made it, and what `kalman_filter` says of it."""

    z: Array
    """Measurements, shape (n,)."""
    params: FilterParams
    """q and r of the walk; exact diffuse start."""
    x: Array
    """x of `kalman_filter`, shape (n,)."""

    @property
    def q(self) -> float:
        """Process-noise variance a sample."""
        return float(self.params.q)

    @property
    def r(self) -> float:
        """Measurement-noise variance."""
        return float(self.params.r)

    def first(self, n: int) -> Work:
        """The work of the first n samples; the filter is causal, so x is the same."""
        return Work(self.z[:n], self.params, self.x[:n])


@dataclass(frozen=True)
class Contest:
    """Two ways to do the same work."""

    name: str
    against: str
    n: int
    run: Clocked
    """One turn of `name`."""
    rival: Clocked
    """One turn of `against`."""
    difference: Callable[[object], float] | None
    """How far the result of `run` is from ours, relative."""
    note: str = ""
    repetitions: int | None = None
    """Turns, where it should not be the run's number."""


def missing(name: str, against: str) -> Row:
    """The row of a library that is not there."""
    return Row(name, 0, None, None, against, None, "not installed")


def compared_with(expected: Array, scale: float, since: int = 0) -> Callable[[object], float]:
    """The largest |result − expected| from sample `since` on, over `scale`."""

    def difference(result: object) -> float:
        return float(np.max(np.abs(np.asarray(result)[since:] - expected[since:]))) / scale

    return difference


def measure(contest: Contest, repetitions: int) -> Row:
    """Hold one contest; the first turn of each side is not timed, it loads and compiles."""
    result = contest.run()
    difference = None if contest.difference is None else contest.difference(result)
    del result
    contest.rival()
    ours, theirs = take_turns(contest.run, contest.rival, contest.repetitions or repetitions)
    return Row(
        name=contest.name,
        n=contest.n,
        microseconds_per_sample=statistics.median(ours) / contest.n * 1e6,
        ratio=statistics.median(a / b for a, b in zip(ours, theirs, strict=True)),
        against=contest.against,
        difference=difference,
        note=contest.note,
    )


def take_turns(a: Clocked, b: Clocked, repetitions: int) -> tuple[list[float], list[float]]:
    """Seconds of each turn of both, A B B A …, without the garbage collector."""
    first: list[float] = []
    second: list[float] = []
    collecting = gc.isenabled()
    gc.disable()
    try:
        for turn in range(repetitions):
            order = ((a, first), (b, second))
            for run, times in order if turn % 2 == 0 else reversed(order):
                times.append(_seconds(run))
    finally:
        if collecting:
            gc.enable()
    return first, second


def _seconds(run: Clocked) -> float:
    """One turn; short work is repeated. What it returns is freed inside, on both sides."""
    start = time.perf_counter()
    run()
    once = time.perf_counter() - start
    if once > LEAST_TURN:
        return once
    count = math.ceil(LEAST_TURN / max(once, 1e-7))
    start = time.perf_counter()
    for _ in range(count):
        run()
    return (time.perf_counter() - start) / count
