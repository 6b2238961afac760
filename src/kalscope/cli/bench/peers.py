"""The contests against other Kalman libraries: each does what it does best, with one scalar filter.

The libraries are optional; a missing one is a row that says so. All start as Kalscope does: the first sample sets
x = z and p = r. Those without a diffuse start get that as their prior and the samples after it.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from kalscope.cli.bench.contest import PARAMS, Contest, Q, R, Row, Work
from kalscope.common.array import Array
from kalscope.estimation.estimate import estimate
from kalscope.filtering.filter import KalmanFilter, kalman_filter
from kalscope.filtering.params import FilterParams

SAME_DIGITS = 1e-30
"""When statsmodels takes its variance as settled: at its own 1e-19 the result is off by 4e-7 and no faster."""

Size = Callable[[int], Work]
"""The work of this many samples, fewer in a quick run."""


def peer_contests(size: Size) -> Iterator[Contest | Row]:
    """The contests of every installed library, and a row for each that is not."""
    for name, module, against, contests in PEERS:
        try:
            library = importlib.import_module(module)
        except ImportError:
            yield Row(name, 0, None, None, against, None, "not installed")
            continue
        yield from contests(library, size)


def _filter_contest(name: str, work: Work, run: Callable[[], Array], note: str = "") -> Contest:
    """A peer's x against `kalman_filter` on the same samples: both give x and p and make their output."""

    def opponent() -> object:
        return kalman_filter(work.z, PARAMS)

    return Contest(name, "kalman_filter", len(work.z), run, opponent, work.difference, note)


def filterpy_contests(library: Any, size: Size) -> Iterator[Contest]:
    """FilterPy over a record, and sample by sample."""
    work = size(10_000)
    z = work.z

    def start() -> Any:
        peer = library.KalmanFilter(dim_x=1, dim_z=1)
        peer.x, peer.H = np.array([[z[0]]]), np.ones((1, 1))
        peer.P, peer.Q, peer.R = np.array([[R]]), np.array([[Q]]), np.array([[R]])
        return peer

    def batch() -> Array:
        return np.concatenate((z[:1], start().batch_filter(z[1:])[0].reshape(-1)))

    def one_by_one() -> Array:
        peer, out = start(), [z[0]]
        for value in z[1:].tolist():
            peer.predict()
            peer.update(value)
            out.append(peer.x[0, 0])
        return np.array(out)

    def streaming() -> Array:
        stream = KalmanFilter(PARAMS)
        return np.array([stream.update(value) for value in z.tolist()])

    yield _filter_contest("filterpy batch_filter", work, batch)
    name, against, note = "filterpy predict, update", "KalmanFilter.update", "sample by sample on both sides"
    yield Contest(name, against, len(z), one_by_one, streaming, work.difference, note)


def pykalman_contests(library: Any, size: Size) -> Iterator[Contest]:
    """Pykalman's prior is that of the first observed state, after one predict."""
    work = size(3_000)
    z = work.z

    def run() -> Array:
        peer = library.KalmanFilter(
            transition_matrices=[[1.0]],
            observation_matrices=[[1.0]],
            transition_covariance=[[Q]],
            observation_covariance=[[R]],
            initial_state_mean=[z[0]],
            initial_state_covariance=[[R + Q]],
        )
        return np.concatenate((z[:1], np.asarray(peer.filter(z[1:])[0]).reshape(-1)))

    yield _filter_contest("pykalman filter", work, run)


def simdkalman_contests(library: Any, size: Size) -> Iterator[Contest]:
    """Simdkalman on one series, and on many at once, for which it is made."""

    def filtered(rows: Array) -> Array:
        """Each row filtered, its first sample being the start."""
        peer = library.KalmanFilter(
            state_transition=np.eye(1),
            process_noise=np.array([[Q]]),
            observation_model=np.ones((1, 1)),
            observation_noise=R,
        )
        result = peer.compute(
            rows[:, 1:],
            0,
            initial_value=rows[:, :1, None],
            initial_covariance=np.array([[R + Q]]),
            smoothed=False,
            filtered=True,
            observations=False,
        )
        return np.concatenate((rows[:, :1], result.filtered.states.mean[..., 0]), axis=1)

    work = size(3_000)
    note = "one series; smoother and observations off"
    yield _filter_contest("simdkalman compute", work, lambda: filtered(work.z[None])[0], note)

    series, length = 200, len(size(2_000).z)
    columns = np.random.default_rng(2).standard_normal((length, series))
    rows = np.ascontiguousarray(columns.T)
    yield Contest(
        "simdkalman compute",
        "kalman_filter",
        columns.size,
        lambda: filtered(rows),
        lambda: kalman_filter(columns, PARAMS),
        Work(rows, kalman_filter(columns, PARAMS).x.T).difference,
        f"{series} series of {length:,} at once, each side in its own order of axes",
    )


def statsmodels_contests(library: Any, size: Size) -> Iterator[Contest]:
    """UnobservedComponents with its exact diffuse start; the model is built outside the measured time."""
    work = size(100_000)
    model = library.tsa.UnobservedComponents(work.z, "llevel", use_exact_diffuse=True)
    model.tolerance = SAME_DIGITS

    def run() -> Array:
        return model.filter([R, Q], return_ssm=True).filtered_state[0]

    note = f"its plain result, not wrapped in tables; tolerance {SAME_DIGITS:g}"
    yield _filter_contest("statsmodels filter", work, run, note)
    exact = float(kalman_filter(work.z, PARAMS).loglik)

    def difference(loglik: float) -> float:
        # It scores the sample that sets the start with −½ ln 2π; Kalscope does not score it.
        return abs(float(loglik) + 0.5 * math.log(2.0 * math.pi) - exact) / abs(exact)

    yield Contest(
        "statsmodels loglike",
        "kalman_filter",
        len(work.z),
        lambda: model.loglike([R, Q]),
        lambda: kalman_filter(work.z, PARAMS),
        difference,
        "it keeps the sum alone, kalman_filter x, p, k, v, s too; difference: relative, of the two sums",
    )


def fit_contest(library: Any, size: Size) -> Iterator[Contest]:
    """The fit of statsmodels against that of Kalscope, both of the random walk."""
    work = size(100_000)
    best = float(estimate(work.z, momentum=0.0).loglik)

    def run() -> FilterParams:
        r, q = library.tsa.UnobservedComponents(work.z, "llevel").fit(disp=0).params
        return FilterParams(q=float(q), r=float(r))

    def lost(params: FilterParams) -> float:
        return (best - float(kalman_filter(work.z, params).loglik)) / abs(best)

    yield Contest(
        FIT,
        ESTIMATE,
        len(work.z),
        run,
        lambda: estimate(work.z, momentum=0.0),
        lost,
        "difference: what their q and r lose of the exact log-likelihood, relative",
        repetitions=3,
    )


FIT, ESTIMATE = "statsmodels llevel fit", "estimate(momentum=0)"
PEERS: tuple[tuple[str, str, str, Callable[[Any, Size], Iterator[Contest]]], ...] = (
    ("filterpy", "filterpy.kalman", "kalman_filter", filterpy_contests),
    ("pykalman", "pykalman", "kalman_filter", pykalman_contests),
    ("simdkalman", "simdkalman", "kalman_filter", simdkalman_contests),
    ("statsmodels", "statsmodels.api", "kalman_filter", statsmodels_contests),
    (FIT, "statsmodels.api", ESTIMATE, fit_contest),
)
"""Name, module to import, what it is compared with, and contests of each library."""
