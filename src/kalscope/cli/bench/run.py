"""All contests of `kalscope bench`, one after the other."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator

import numpy as np

from kalscope.cli.bench.contest import RATIO, Row, Sizes, Work, measure
from kalscope.errors import BadSetting
from kalscope.filtering.batch import kalman_filter
from kalscope.filtering.params import FilterParams

LEAST_SAMPLES = 10_000
"""Shortest record worth timing: below it the call costs more than the filter."""


MOST_SAMPLES = 50_000_000
"""Longest record: kalman_filter keeps five numbers a sample, 2 GB here."""


FULL = Sizes(samples=10_000_000, repetitions=7, slowness=1.0)


QUICK = Sizes(samples=200_000, repetitions=3, slowness=10.0)


def make_work(n: int, seed: int = 1) -> Work:
    """A record of n samples: a walk of q = λ in noise of r = 1."""
    rng = np.random.default_rng(seed)
    z = rng.standard_normal(n)
    z *= math.sqrt(RATIO)
    np.cumsum(z, out=z)
    z += rng.standard_normal(n)
    params = FilterParams(q=RATIO, r=1.0)
    return Work(z, params, kalman_filter(z, params).x)


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
    from kalscope.cli.bench.estimation import estimation_contests
    from kalscope.cli.bench.own import own_contests
    from kalscope.cli.bench.peers import peer_contests

    work = make_work(sizes.samples)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those of the peers are not ours to show
        for contests in (own_contests, peer_contests, estimation_contests):
            for contest in contests(work, sizes):
                yield contest if isinstance(contest, Row) else measure(contest, sizes.repetitions)
