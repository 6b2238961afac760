"""The contests against other Kalman libraries: each is asked for what it does best at, one scalar filter.

The libraries are not required; a missing one is a row that says so. All start where ours starts: the first
sample sets x = z and p = r. Those without a diffuse start get that as their prior and the samples after it.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from kalscope.cli.bench.contest import Contest, Row, Sizes, Work, compared_with, missing
from kalscope.common.array import Array
from kalscope.filtering.batch import kalman_filter
from kalscope.filtering.streaming import KalmanFilter

OURS = "kalman_filter"

SAME_DIGITS = 1e-30
"""Where statsmodels takes its variance for settled: at its own 1e-19 the result is off by 4e-7 and no faster."""

Build = Callable[[Any, Work, Sizes], Iterator[Contest]]


def peer_contests(work: Work, sizes: Sizes) -> Iterator[Contest | Row]:
    """The contests of every installed library, and a row for each that is not."""
    for name, module, build in PEERS:
        try:
            library = importlib.import_module(module)
        except ImportError:
            yield missing(name, OURS)
            continue
        yield from build(library, work, sizes)


def against_ours(name: str, work: Work, run: Callable[[], Array], note: str) -> Contest:
    """A peer's x against `kalman_filter` on the same samples: both give x and p and make their output."""
    return Contest(
        name,
        OURS,
        len(work.z),
        run,
        lambda: kalman_filter(work.z, work.params),
        compared_with(work.x, float(np.abs(work.z).max())),
        note,
    )


def filterpy_contests(library: Any, work: Work, sizes: Sizes) -> Iterator[Contest]:
    """FilterPy over a record, and sample by sample."""
    some = work.first(sizes.at_most(10_000))
    z = some.z

    def start() -> Any:
        peer = library.KalmanFilter(dim_x=1, dim_z=1)
        peer.x = np.array([[z[0]]])
        peer.P, peer.Q, peer.R = np.array([[some.r]]), np.array([[some.q]]), np.array([[some.r]])
        peer.H = np.ones((1, 1))
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

    def ours_one_by_one() -> Array:
        stream = KalmanFilter(some.params)
        return np.array([stream.update(value) for value in z.tolist()])

    yield against_ours("filterpy batch_filter", some, batch, "")
    yield Contest(
        "filterpy predict, update",
        "KalmanFilter.update",
        len(z),
        one_by_one,
        ours_one_by_one,
        compared_with(some.x, float(np.abs(z).max())),
        "sample by sample on both sides",
    )


def pykalman_contests(library: Any, work: Work, sizes: Sizes) -> Iterator[Contest]:
    """Pykalman's prior is that of the first observed state, so it has taken one predict already."""
    some = work.first(sizes.at_most(3_000))
    z = some.z

    def run() -> Array:
        peer = library.KalmanFilter(
            transition_matrices=[[1.0]],
            observation_matrices=[[1.0]],
            transition_covariance=[[some.q]],
            observation_covariance=[[some.r]],
            initial_state_mean=[z[0]],
            initial_state_covariance=[[some.r + some.q]],
        )
        return np.concatenate((z[:1], np.asarray(peer.filter(z[1:])[0]).reshape(-1)))

    yield against_ours("pykalman filter", some, run, "")


def simdkalman_contests(library: Any, work: Work, sizes: Sizes) -> Iterator[Contest]:
    """Simdkalman on one series, and on many at once, which is what it is made for."""

    def filtered(rows: Array, first: Array, some: Work) -> Array:
        peer = library.KalmanFilter(
            state_transition=np.eye(1),
            process_noise=np.array([[some.q]]),
            observation_model=np.ones((1, 1)),
            observation_noise=some.r,
        )
        result = peer.compute(
            rows,
            0,
            initial_value=first,
            initial_covariance=np.array([[some.r + some.q]]),
            smoothed=False,
            filtered=True,
            observations=False,
        )
        return result.filtered.states.mean[..., 0]

    some = work.first(sizes.at_most(3_000))

    def one() -> Array:
        return np.concatenate((some.z[:1], filtered(some.z[1:], some.z[:1].reshape(1, 1), some)))

    yield against_ours("simdkalman compute", some, one, "one series; smoother and observations off")
    series, length = 200, sizes.at_most(2_000)
    columns = np.random.default_rng(2).standard_normal((length, series))
    rows = np.ascontiguousarray(columns.T)
    ours = kalman_filter(columns, work.params).x.T

    def many() -> Array:
        first = rows[:, :1]
        return np.concatenate((first, filtered(rows[:, 1:], first[:, :, None], work)), axis=1)

    yield Contest(
        "simdkalman compute",
        OURS,
        series * length,
        many,
        lambda: kalman_filter(columns, work.params),
        compared_with(ours, float(np.abs(columns).max())),
        f"{series} series of {length:,} at once, each side in its own order of axes",
    )


def statsmodels_contests(library: Any, work: Work, sizes: Sizes) -> Iterator[Contest]:
    """UnobservedComponents with its exact diffuse start; the model is built outside the clock."""
    some = work.first(sizes.at_most(100_000))
    model = library.tsa.UnobservedComponents(some.z, "llevel", use_exact_diffuse=True)
    model.tolerance = SAME_DIGITS
    values = [some.r, some.q]
    told = f"tolerance {SAME_DIGITS:g}"

    def run() -> Array:
        return model.filter(values, return_ssm=True).filtered_state[0]

    yield against_ours("statsmodels filter", some, run, f"its plain result, not wrapped in tables; {told}")
    ours = float(kalman_filter(some.z, some.params).loglik)

    def difference(result: object) -> float:
        # It scores the sample that sets the start with −½ ln 2π; we do not score it.
        return abs(float(str(result)) + 0.5 * math.log(2.0 * math.pi) - ours) / abs(ours)

    yield Contest(
        "statsmodels loglike",
        OURS,
        len(some.z),
        lambda: model.loglike(values),
        lambda: kalman_filter(some.z, some.params),
        difference,
        "it keeps the sum alone, we keep x, p, k, v, s too; difference: relative, of the two sums",
    )


PEERS: tuple[tuple[str, str, Build], ...] = (
    ("filterpy", "filterpy.kalman", filterpy_contests),
    ("pykalman", "pykalman", pykalman_contests),
    ("simdkalman", "simdkalman", simdkalman_contests),
    ("statsmodels", "statsmodels.api", statsmodels_contests),
)
"""Name, module to import and contests of each library."""
