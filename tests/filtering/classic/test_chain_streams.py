"""A chain over a record, in pieces and sample by sample: the same bits."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import FilterParams
from kalscope.classic import Butterworth, Chain, Exponential, Median, MovingAverage, OneEuro
from kalscope.filtering.classic import ChainFilter, RunningStages
from kalscope.filtering.filter import GrowingRun

STAGES = (
    MovingAverage(1),
    MovingAverage(7),
    Exponential(1.0),
    Exponential(0.03),
    Median(1),
    Median(9),
    Butterworth(0.499),
    Butterworth(0.01),
    OneEuro(0.01, 0.3, 0.1),
)
CHAINS = (Chain(5), *(Chain(1, stage) for stage in STAGES), *(Chain(3, stage) for stage in STAGES[1::3]))
PARAMS = FilterParams(0.1, 2.0, gate=9.0, momentum=4.0)


def record(n=160):
    """A walk with spikes, gaps, equal and signed zeros, and uneven steps, two of them 0."""
    rng = np.random.default_rng(4)
    z = 1e3 + np.cumsum(rng.normal(size=n)) + rng.normal(size=n)
    z[rng.random(n) < 0.05] += 50.0
    z[60:80] = rng.choice([0.0, -0.0, 1.0], 20)
    z[rng.random(n) < 0.1] = np.nan
    z[:2] = np.nan
    dt = rng.uniform(0.1, 3.0, n)
    dt[[20, 21, 100]] = 0.0
    return z, dt


@pytest.mark.slow
def test_pieces_give_the_bits_of_the_whole_in_both_types():
    z, dt = record()
    for chain in CHAINS:
        for kind in (np.float64, np.float32):
            whole = RunningStages(chain.stages, kind).take(z, dt)
            pieces = RunningStages(chain.stages, kind)
            found = [pieces.take(z[at], dt[at]) for at in (slice(0, 1), slice(1, 57), slice(57, None))]
            assert whole.dtype == kind
            assert np.concatenate(found).tobytes() == whole.tobytes(), chain


@pytest.mark.slow
def test_a_stream_and_a_record_that_grows_give_the_bits_of_the_whole():
    z, dt = record()
    for chain in CHAINS:
        for steps in (None, dt):
            used = ChainFilter(chain, PARAMS)
            whole, stream, grown = used.run(z, steps), used.stream(), GrowingRun(used.stream())
            found = [stream.update(z[i], None if steps is None else steps[i]) for i in range(len(z))]
            assert np.array(found).tobytes() == whole.x.tobytes(), chain
            for at in (slice(0, 1), slice(1, 1), slice(1, 57), slice(57, None)):
                grown.extend(z[at], None if steps is None else steps[at])
            for name in ("x", "p", "k", "innovation", "s", "velocity", "velocity_p", "rejected"):
                np.testing.assert_array_equal(getattr(grown.result, name), getattr(whole, name), f"{chain} {name}")
