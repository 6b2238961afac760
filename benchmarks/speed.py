"""Speed of the filter and of the fits, as ratios of two times that are measured in turns.

    python benchmarks/speed.py [--quick] [--only WORD] [--before CHECKOUT]

The opponents are memory, scipy's steady filter, the plain loop of five lines, other Kalman libraries and Kalscope
itself in a simpler case; with --before they are the same calls of an earlier checkout. Both sides get the same
record, q, r and start, and their results are compared. Exit status 1 where a ratio misses its target or two results
differ by more than 1e-9.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import math
import os
import statistics
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from kalscope import (
    FilterParams,
    KalmanFilter,
    denoise,
    estimate,
    fuse,
    kalman_filter,
    smooth,
    steady_state,
)
from kalscope.estimation.likelihood import log_likelihood
from kalscope.estimation.many import estimate_many, series_of

Array = NDArray[np.float64]
Run = Callable[[], Any]
Size = Callable[[int], Array]
"""A record of this many samples, fewer with --quick."""

Q, R = 1e-4, 1.0
"""Variances of the random walk and of its noise: the slowest filter for which the speed is promised."""
PARAMS, MOVING = FilterParams(Q, R), FilterParams(Q, R, momentum=20.0)
MIN_TURN_S = 0.03
"""Least time of a turn, s: a single short run after a long one of the other side is luck."""
ENOUGH_S = 10.0
"""Time after which a side takes no more turns, s."""
SETTLED = 5_000
"""Samples after which a filter of constant gain has forgotten its start: (1 − K)^5000 is 2e-22 at λ = 1e-4."""
SAME_WORK = 1e-9
"""Largest difference of the two results, relative to the largest value."""
FOUND = 1e-4
"""What another optimizer may lose of the log-likelihood, relative."""


@dataclass(frozen=True)
class Contest:
    """Two ways to do the same work; the ratio is the time of `run` over that of `opponent`."""

    name: str
    against: str
    n: int
    """Samples of the work."""
    run: Run
    opponent: Run
    difference: Callable[[Any, Any], float] | None = None
    """Of the results of both sides, relative; None where they do different work."""
    target: tuple[float, float] = (0.0, math.inf)
    """Range of the ratio."""
    tolerance: float = SAME_WORK


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer samples and turns")
    parser.add_argument("--only", default="", metavar="WORD", help="the contests with this word in their names")
    parser.add_argument("--before", type=Path, metavar="CHECKOUT", help="compare with an earlier checkout")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # those of the other libraries

    def size(n: int) -> Array:
        return random_walk(max(n // 50, 500) if options.quick else n)

    if options.serve:
        serve(calls(size))
        return 0
    passed = [
        hold(contest, 3 if options.quick else 7)
        for contest in (yesterday(options) if options.before else contests(size))
        if options.only in f"{contest.name} {contest.against}"
    ]
    return int(not all(passed))


def hold(contest: Contest, turns: int) -> bool:
    """Hold a contest, print its row, and tell whether it passed; the first turn of each side loads and compiles."""
    results = contest.run(), contest.opponent()
    difference = None if contest.difference is None else contest.difference(*results)
    ours, others = take_turns(contest.run, contest.opponent, turns)
    ratio = statistics.median(a / b for a, b in zip(ours, others, strict=True))
    low, high = contest.target
    passed = low <= ratio <= high and (difference is None or difference <= contest.tolerance)
    print(
        f"{contest.name:30}{contest.n:>11,} samples {1e9 * statistics.median(ours) / contest.n:10.4g} ns/sample"
        f"{ratio:10.4g} × {contest.against:24}",
        "" if difference is None else f"differ by {difference:.1e}",
        "" if passed else "MISSED",
        flush=True,
    )
    return passed


def take_turns(a: Run, b: Run, turns: int) -> tuple[list[float], list[float]]:
    """Seconds of each turn of both, A B B A …: a noisy machine slows both. What is slow takes fewer turns."""
    times: tuple[list[float], list[float]] = [], []
    for turn in range(turns):
        if sum(times[0]) > ENOUGH_S:
            break
        order = ((a, times[0]), (b, times[1]))
        for run, into in order if turn % 2 == 0 else reversed(order):
            into.append(run() if isinstance(run, Remote) else seconds(run))
    return times


def seconds(run: Run) -> float:
    """Processor time of one turn, without the garbage collector; short work is repeated."""
    gc.disable()
    try:
        count, start = 0, time.process_time()
        while not count or time.process_time() - start < MIN_TURN_S:
            run()
            count += 1
        return (time.process_time() - start) / count
    finally:
        gc.enable()


def random_walk(n: int) -> Array:
    rng = np.random.default_rng(1)
    return np.cumsum(math.sqrt(Q) * rng.standard_normal(n)) + rng.standard_normal(n)


def far(result: Any, expected: Any, since: int = 0) -> float:
    """The largest |result − expected| from sample `since` on, over max |expected|."""
    result, expected = np.atleast_1d(result)[..., since:], np.atleast_1d(expected)[..., since:]
    return float(np.max(np.abs(result - expected)) / np.max(np.abs(expected)))


@numba.njit(cache=True)
def five_lines(z: Array, q: float, r: float, out: Array) -> Array:
    """The plain loop of the source documents, compiled; the first sample sets x = z, p = r."""
    x, p = z[0], r
    out[0] = x
    for i in range(1, z.shape[0]):
        p = p + q
        k = p / (p + r)
        x = x + k * (z[i] - x)
        p = (1.0 - k) * p
        out[i] = x
    return out


def calls(size: Size) -> dict[str, tuple[int, Run]]:
    """Samples and work of each public function whose speed is compared with that of an earlier checkout."""
    long, z, short = size(10_000_000), size(1_000_000), size(100_000)
    out, rows, stream = np.empty_like(long), size(1_000_000).reshape(-1, 500), short.tolist()

    def streaming() -> list[float]:
        update = KalmanFilter(PARAMS).update
        return [update(value) for value in stream]

    works: dict[str, tuple[Array, Run]] = {
        "denoise(out=)": (long, lambda: denoise(long, PARAMS, out=out)),
        "denoise": (long, lambda: denoise(long, PARAMS)),
        "denoise, momentum": (long, lambda: denoise(long, MOVING)),
        "kalman_filter": (z, lambda: kalman_filter(z, PARAMS)),
        "kalman_filter, momentum": (z, lambda: kalman_filter(z, MOVING)),
        "smooth": (z, lambda: smooth(z, PARAMS)),
        "log_likelihood": (short, lambda: log_likelihood(short, PARAMS)),
        "KalmanFilter.update": (short, streaming),
        "estimate(momentum=0)": (short, lambda: estimate(short, momentum=0.0)),
        "estimate": (short, lambda: estimate(short)),
        "estimate_many": (rows, lambda: estimate_many(series_of(rows))),
    }
    return {name: (record.size, run) for name, (record, run) in works.items()}


@dataclass(frozen=True)
class Remote:
    """Work that another process does."""

    process: subprocess.Popen[str]
    name: str

    def __call__(self) -> float:
        """The seconds of one turn."""
        assert self.process.stdin
        assert self.process.stdout
        print(self.name, file=self.process.stdin, flush=True)
        return float(self.process.stdout.readline())


def serve(works: dict[str, tuple[int, Run]]) -> None:
    """Do what the lines of stdin name, and print the seconds of each."""
    for line in sys.stdin:
        print(seconds(works[line.strip()][1]), flush=True)


def yesterday(options: argparse.Namespace) -> Iterator[Contest]:
    """Each call of this checkout against that of the earlier one, in a process each."""
    command = [sys.executable, __file__, "--serve", *(["--quick"] if options.quick else [])]
    here, before = (
        subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": str(checkout.resolve() / "src")},
        )
        for checkout in (Path(__file__).parents[1], options.before)
    )
    with here, before:
        for name, (n, _) in calls(lambda n: np.zeros(max(n // 50, 500) if options.quick else n)).items():
            yield Contest(name, "before", n, Remote(here, name), Remote(before, name))


def contests(size: Size) -> Iterator[Contest]:
    """All contests; those of a library that is not installed are left out, with a line that says so."""
    for group in (plain, filterpy, pykalman, simdkalman, statsmodels, many, momentum, fusion):
        try:
            yield from group(size)
        except ModuleNotFoundError as error:
            print(f"left out: {error.name} is not installed", file=sys.stderr)


def plain(size: Size) -> Iterator[Contest]:
    """Memory, scipy's filter of constant gain, and the plain loop."""
    z = size(10_000_000)
    n, out, other = len(z), np.empty_like(z), np.empty_like(z)
    gain, lfilter = float(steady_state(PARAMS).gain), importlib.import_module("scipy.signal").lfilter

    def existing() -> Array:
        return denoise(z, PARAMS, out=out)

    def steady() -> Array:
        return lfilter([gain], [1.0, gain - 1.0], z, zi=[(1.0 - gain) * z[0]])[0]

    def settled(result: Array, expected: Array) -> float:
        return far(result, expected, min(SETTLED, n // 2))

    yield Contest("denoise(out=)", "np.copyto", n, existing, lambda: np.copyto(other, z))
    yield Contest("denoise", "z.copy()", n, lambda: denoise(z, PARAMS), z.copy)
    yield Contest("scipy lfilter", "denoise", n, steady, lambda: denoise(z, PARAMS), settled)
    yield Contest("five lines, numba", "denoise(out=)", n, lambda: five_lines(z, Q, R, other), existing, far)
    short = size(1_000_000)
    yield Contest(
        "kalman_filter",
        "five lines, numba",
        len(short),
        lambda: kalman_filter(short, PARAMS).x,
        lambda: five_lines(short, Q, R, np.empty_like(short)),
        far,
    )


def filtered_by(z: Array) -> Run:
    """The opponent of the libraries: they return x and p, as `kalman_filter` does, and make their output."""
    return lambda: kalman_filter(z, PARAMS).x


def filterpy(size: Size) -> Iterator[Contest]:
    """Over a record, and sample by sample."""
    library: Any = importlib.import_module("filterpy.kalman")
    z = size(10_000)

    def start() -> Any:
        peer = library.KalmanFilter(dim_x=1, dim_z=1)
        peer.x, peer.H = np.array([[z[0]]]), np.ones((1, 1))
        peer.P, peer.Q, peer.R = np.array([[R]]), np.array([[Q]]), np.array([[R]])
        return peer

    def batch() -> Array:
        return np.concatenate((z[:1], start().batch_filter(z[1:])[0].reshape(-1)))

    def one_by_one() -> list[float]:
        peer, out = start(), [z[0]]
        for value in z[1:].tolist():
            peer.predict()
            peer.update(value)
            out.append(peer.x[0, 0])
        return out

    def streaming() -> list[float]:
        stream = KalmanFilter(PARAMS)
        return [stream.update(value) for value in z.tolist()]

    yield Contest("filterpy batch_filter", "kalman_filter", len(z), batch, filtered_by(z), far)
    yield Contest("filterpy predict, update", "KalmanFilter.update", len(z), one_by_one, streaming, far)


def pykalman(size: Size) -> Iterator[Contest]:
    """Its prior is that of the first observed state, after one predict."""
    library: Any = importlib.import_module("pykalman")
    z = size(3_000)

    def run() -> Array:
        peer = library.KalmanFilter([[1.0]], [[1.0]], [[Q]], [[R]], None, None, [z[0]], [[R + Q]])
        return np.concatenate((z[:1], np.asarray(peer.filter(z[1:])[0]).reshape(-1)))

    yield Contest("pykalman filter", "kalman_filter", len(z), run, filtered_by(z), far)


def simdkalman(size: Size) -> Iterator[Contest]:
    """One series, and many at once, for which it is made; the smoother is off."""
    library: Any = importlib.import_module("simdkalman")
    one, many = size(3_000)[None], np.random.default_rng(2).standard_normal((200, len(size(100_000)) // 50))
    columns, peer = np.ascontiguousarray(many.T), library.KalmanFilter(np.eye(1), [[Q]], np.ones((1, 1)), R)

    def filtered(rows: Array) -> Array:
        start = {"initial_value": rows[:, :1, None], "initial_covariance": np.array([[R + Q]])}
        result = peer.compute(rows[:, 1:], 0, **start, smoothed=False, filtered=True, observations=False)
        return np.concatenate((rows[:, :1], result.filtered.states.mean[..., 0]), axis=1)

    yield Contest("simdkalman", "kalman_filter", one.size, lambda: filtered(one)[0], filtered_by(one[0]), far)
    yield Contest(
        "simdkalman, 200 series",
        "kalman_filter",
        many.size,
        lambda: filtered(many),
        lambda: kalman_filter(columns, PARAMS).x.T,
        far,
    )


def statsmodels(size: Size) -> Iterator[Contest]:
    """Its local level with the exact diffuse start, built outside the measured time, and its fit."""
    library: Any = importlib.import_module("statsmodels.api")
    z = size(100_000)
    model = library.tsa.UnobservedComponents(z, "llevel", use_exact_diffuse=True)
    model.tolerance = 1e-30  # at its usual 1e-19 the result is off by 4e-7 and no faster

    def filtered() -> Array:
        return model.filter([R, Q], return_ssm=True).filtered_state[0]

    def loglik() -> float:  # it scores the sample that sets the start; Kalscope does not
        return model.loglike([R, Q]) + 0.5 * math.log(2.0 * math.pi)

    def fit() -> float:
        r, q = library.tsa.UnobservedComponents(z, "llevel").fit(disp=0).params
        return float(kalman_filter(z, FilterParams(float(q), float(r))).loglik)

    yield Contest("statsmodels filter", "kalman_filter", len(z), filtered, filtered_by(z), far)
    yield Contest(
        "statsmodels loglike", "kalman_filter", len(z), loglik, lambda: kalman_filter(z, PARAMS).loglik, far
    )
    yield Contest(
        "statsmodels llevel fit",
        "estimate(momentum=0)",
        len(z),
        fit,
        lambda: estimate(z, momentum=0.0).loglik,
        far,
        tolerance=FOUND,
    )


def many(size: Size) -> Iterator[Contest]:
    """`estimate_many` on one core against `estimate` one by one."""
    rows = size(500_000).reshape(-1, 500)

    def together() -> Array:
        table = estimate_many(series_of(rows), robust=False)
        return np.array([table.q, table.r])

    def one_by_one() -> Array:
        found = [estimate(z, momentum=0.0, robust=False) for z in rows]
        return np.array([[one.q for one in found], [one.r for one in found]])

    yield Contest("estimate_many", "estimate", rows.size, together, one_by_one, far)


def momentum(size: Size) -> Iterator[Contest]:
    """What momentum costs the filter, and its fit against those of statsmodels, which score the start otherwise."""
    z = size(10_000_000)
    out = np.empty_like(z)
    yield Contest(
        "denoise, momentum",
        "denoise",
        len(z),
        lambda: denoise(z, MOVING, out=out),
        lambda: denoise(z, PARAMS, out=out),
        target=(0.0, 3.0),
    )
    library: Any = importlib.import_module("statsmodels.api").tsa
    short = size(100_000)
    peers: dict[str, tuple[Run, float]] = {
        "damped trend, state space": (
            lambda: library.statespace.ExponentialSmoothing(short, trend=True, damped_trend=True).fit(disp=0),
            50.0,
        ),
        "ARIMA(1, 1, 2)": (lambda: library.SARIMAX(short, order=(1, 1, 2)).fit(disp=0), 0.0),
    }
    for name, (fit, least) in peers.items():
        yield Contest(name, "estimate", len(short), fit, lambda: estimate(short), target=(least, math.inf))


def fusion(size: Size) -> Iterator[Contest]:
    """`fuse` of k sensors against k runs of `kalman_filter` on the same readings."""
    rng = np.random.default_rng(1)
    for k in (2, 3, 8):
        walk = size(1_000_000 // k)
        z = walk[:, None] + rng.normal(size=(len(walk), k))
        gaps, dt = np.where(rng.random(z.shape) < 0.2, np.nan, z), rng.exponential(1.0, len(z))
        r, offset = np.linspace(1.0, 2.0, k), np.linspace(0.0, 1.0, k)
        cases: dict[str, tuple[Array, Array | None, dict[str, Any]]] = {
            "regular": (z, None, {}),
            "a gate": (z, None, {"gate": 9.0}),
            "a fifth missing": (gaps, None, {}),
            "uneven times": (z, dt, {}),
            "momentum": (z, None, {"momentum": 20.0}),
            "momentum, uneven times": (z, dt, {"momentum": 20.0}),
        }
        for name, (readings, steps, more) in cases.items():
            columns = [np.ascontiguousarray(column) for column in readings.T]
            together = FilterParams(0.09, r, offset=offset, **more)
            alone = [FilterParams(0.09, float(one), **more) for one in r]

            yield Contest(
                f"fuse, {name}",
                f"{k} × kalman_filter",
                z.size,
                partial(fuse, readings, together, steps),
                partial(one_by_one, columns, alone, steps),
                target=(0.0, 1.5),
            )


def one_by_one(columns: list[Array], params: list[FilterParams], dt: Array | None) -> None:
    for column, one in zip(columns, params, strict=True):
        kalman_filter(column, one, dt)


if __name__ == "__main__":
    sys.exit(main())
