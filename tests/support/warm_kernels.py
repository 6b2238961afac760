"""Compile every loop that takes long to, before a test needs it: else each worker that comes to it compiles it.

A minute of one core. `make test` spends it while pip installs what only tests need, so this needs nothing of that.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from tests.support import warm_program  # noqa: F401  # the loops of the dashboard

from kalscope import (
    FilterParams,
    KalmanFilter,
    denoise,
    estimate,
    estimate_fusion,
    fuse,
    kalman_filter,
    read_recording,
    smooth,
)
from kalscope.analysis.alternatives import compare_alternatives
from kalscope.estimation.many import estimate_many, series_of
from kalscope.estimation.pool import held_out, pool_of
from kalscope.export.float32 import filter_float32
from kalscope.filtering.classic import Butterworth, Exponential, Median, MovingAverage, OneEuro, RunningStages
from kalscope.filtering.filter import filter_at
from kalscope.papers.generalized import GeneralizedParams

SAMPLES = 30_000
"""More than a loop takes as plain Python."""
PLAIN, MOVING = FilterParams(0.1, 1.0), FilterParams(0.1, 1.0, momentum=5.0)
TWO_SPEEDS = FilterParams(0.1, 1.0, fast=100.0, spikes=0.01)
TWO = {"r": [1.0, 2.0], "offset": [0.0, 0.5], "gain": [1.0, 1.0]}

rng = np.random.default_rng(1)
z = np.cumsum(0.3 * rng.standard_normal(SAMPLES)) + rng.standard_normal(SAMPLES)
spiky = z[:400].copy()
spiky[[50, 170, 320]] += 40.0
pair = z[:, None] + rng.standard_normal((SAMPLES, 2))

live = z.copy()
live.flags.writeable = False  # as the samples of a board, for which the loops are compiled once more
for params in (PLAIN, MOVING):
    for samples in (z, live):
        kalman_filter(samples, TWO_SPEEDS)
        denoise(samples, params)
        kalman_filter(samples, params)
        smooth(samples, params)
    KalmanFilter(params).update(1.0)
    filter_float32(z, params)
    filter_at(z, params, np.arange(0, SAMPLES, 100))
classic = Median(5), MovingAverage(5), Exponential(0.1), Butterworth(0.1), OneEuro(0.1, 0.1, 0.1)
RunningStages(classic, np.float32).take(z.astype(np.float32), np.empty(0))
compare_alternatives(live, PLAIN)
estimate(spiky)
estimate(z[:2000], two_speeds=True)
series = series_of([z[:400], spiky])
estimate_many(series)
GeneralizedParams(1.0).run(np.abs(z) + 1.0)
pool_of(series)
held_out(series)
for momentum in (0.0, 5.0):
    fused = FilterParams(0.1, **TWO, momentum=momentum)
    fuse(pair, fused)
    filter_float32(pair, fused)
    estimate_fusion(pair[:400], momentum=momentum)
with tempfile.TemporaryDirectory() as folder:
    log = Path(folder) / "log.csv"
    log.write_text("a,b\n" + "".join(f"{a:.3f},{b:.3f}\n" for a, b in pair.tolist()))
    read_recording(log)
