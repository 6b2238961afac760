"""Speed against others on the same work: every figure is a ratio of two clocks read in the same run.

The two sides of a contest take turns, A B B A, so that a noisy machine hurts both; medians are reported. Both
get the same record, q, r and start, and their results are compared, so that "the same work" is shown.
"""

from __future__ import annotations

import gc
import math
import statistics
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope.errors import BadSetting
from kalscope.filtering import kalman_filter
from kalscope.model import FilterParams

Array = NDArray[np.float64]
Clocked = Callable[[], object]

LEAST_SAMPLES = 10_000
"""Shortest record worth timing: below it the call costs more than the filter."""
MOST_SAMPLES = 50_000_000
"""Longest record: kalman_filter keeps five numbers a sample, 2 GB here."""
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


FULL = Sizes(samples=10_000_000, repetitions=7, slowness=1.0)
QUICK = Sizes(samples=200_000, repetitions=3, slowness=10.0)


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


def make_work(n: int, seed: int = 1) -> Work:
    """A record of n samples: a walk of q = λ in noise of r = 1."""
    rng = np.random.default_rng(seed)
    z = rng.standard_normal(n)
    z *= math.sqrt(RATIO)
    np.cumsum(z, out=z)
    z += rng.standard_normal(n)
    params = FilterParams(q=RATIO, r=1.0)
    return Work(z, params, kalman_filter(z, params).x)


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


def check_samples(text: str) -> int:
    """The number of samples that was asked for; 1e6 is one too.

    Raises:
        BadSetting: it is no number, or too small or too large to be timed.
    """
    try:
        samples = float(text)
    except ValueError:
        samples = math.nan
    if not (LEAST_SAMPLES <= samples <= MOST_SAMPLES and samples.is_integer()):
        must = f"a whole number from {LEAST_SAMPLES:,} to {MOST_SAMPLES:,}"
        raise BadSetting(f"--samples must be {must} (got {text!r})")
    return int(samples)


def run_bench(sizes: Sizes) -> Iterator[Row]:
    """All rows, each as soon as it is known."""
    from kalscope.bench_estimation import estimation_contests
    from kalscope.bench_own import own_contests
    from kalscope.bench_peers import peer_contests

    work = make_work(sizes.samples)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those of the peers are not ours to show
        for contests in (own_contests, peer_contests, estimation_contests):
            for contest in contests(work, sizes):
                yield contest if isinstance(contest, Row) else measure(contest, sizes.repetitions)
