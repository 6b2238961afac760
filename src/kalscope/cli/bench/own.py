"""The contests against memory, scipy's steady filter, the plain loop of five lines, and fits one by one."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from kalscope.cli.bench.contest import PARAMS, Contest, Q, R, Work
from kalscope.common.array import Array
from kalscope.common.compiled import compiled
from kalscope.estimation.estimate import estimate
from kalscope.estimation.fleet.many.estimate_many import estimate_many
from kalscope.estimation.fleet.many.table import EstimateTable
from kalscope.estimation.momentum.profile import likelihood_profile
from kalscope.estimation.result import Estimate
from kalscope.filtering.filter import denoise, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state

SETTLED = 5_000
"""Samples after which a filter of constant gain has forgotten its start: (1 − K)^5000 is 2e-22 at λ = 1e-4."""
STRETCH = 1_000
"""Samples of each of many series."""
SAME_MEMORY = "both write to an existing array"


@compiled()
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


def five_lines_in_python(z: Array, q: float, r: float) -> Array:
    """The same without a compiler, over a list, which Python walks faster than an array."""
    values = z.tolist()
    x, p = values[0], r
    out = [x]
    for value in values[1:]:
        p = p + q
        k = p / (p + r)
        x = x + k * (value - x)
        p = (1.0 - k) * p
        out.append(x)
    return np.array(out)


def denoise_contests(work: Work) -> Iterator[Contest]:
    """`denoise` with and without its own output, against memory, scipy's steady filter and the plain loop."""
    z, n = work.z, len(work.z)
    out, other = np.empty_like(z), np.empty_like(z)

    def existing() -> Array:
        return denoise(z, PARAMS, out=out)

    def new() -> Array:
        return denoise(z, PARAMS)

    def copy() -> None:
        np.copyto(other, z)

    yield Contest("denoise(out=)", "np.copyto", n, existing, copy, work.difference, SAME_MEMORY)
    yield Contest("denoise", "z.copy()", n, new, z.copy, work.difference, "both make their output")

    gain, lfilter = steady_state(PARAMS).gain, importlib.import_module("scipy.signal").lfilter
    note = f"constant gain; compared from sample {SETTLED:,} on; "

    def steady() -> Array:
        return lfilter([gain], [1.0, gain - 1.0], z, zi=[(1.0 - gain) * z[0]])[0]

    def difference(result: Array) -> float:
        return work.difference(result, since=SETTLED)

    yield Contest("scipy lfilter", "denoise", n, steady, new, difference, note + "both make their output")
    yield Contest("scipy lfilter", "denoise(out=)", n, steady, existing, difference, note + "lfilter takes no out")

    def loop() -> Array:
        return five_lines(z, Q, R, other)

    yield Contest("five lines, numba", "denoise(out=)", n, loop, existing, work.difference, SAME_MEMORY)


def kalman_filter_contest(work: Work) -> Contest:
    """`kalman_filter` against the plain loop."""
    return Contest(
        "kalman_filter",
        "five lines, numba",
        len(work.z),
        lambda: kalman_filter(work.z, PARAMS).x,
        lambda: five_lines(work.z, Q, R, np.empty_like(work.z)),
        work.difference,
        "kalman_filter also keeps p, k, innovation, s and sums the likelihood",
    )


def python_contest(work: Work) -> Contest:
    """The plain loop without a compiler against `denoise`."""
    return Contest(
        "five lines, Python",
        "denoise",
        len(work.z),
        lambda: five_lines_in_python(work.z, Q, R),
        lambda: denoise(work.z, PARAMS),
        work.difference,
        "over a list of floats",
    )


def profile_contest(work: Work) -> Contest:
    """The profile over λ against one pass at one λ."""
    out = np.empty_like(work.z)

    def difference(profile: Any) -> float:
        at = np.linspace(0, len(profile.log_ratios) - 1, 7).astype(int)
        pairs = [FilterParams(float(np.exp(profile.log_ratios[i]) * profile.r[i]), profile.r[i]) for i in at]
        exact = np.array([kalman_filter(work.z, params).loglik for params in pairs])
        return float(np.max(np.abs(profile.loglik[at] - exact) / np.abs(exact)))

    return Contest(
        "likelihood_profile, 121 λ",
        "five lines, numba",
        len(work.z),
        lambda: likelihood_profile(work.z),
        lambda: five_lines(work.z, Q, R, out),
        difference,
        "against a single pass at one λ; difference: relative to kalman_filter's log-likelihood at 7 of the λ",
    )


def many_contest(work: Work) -> Contest:
    """`estimate_many` on stretches of the record against `estimate` one by one."""
    series = work.z[: len(work.z) // STRETCH * STRETCH].reshape(-1, STRETCH)

    def one_by_one() -> list[Estimate]:
        return [estimate(z, momentum=0.0, robust=False) for z in series]

    def difference(table: EstimateTable) -> float:
        alone = np.array([(one.q, one.r, one.loglik) for one in one_by_one()])
        together = np.stack([table.q, table.r, table.loglik], axis=1)
        return float(np.max(np.abs(together - alone) / np.maximum(np.abs(alone), 1e-300)))

    return Contest(
        "estimate_many",
        "estimate",
        series.size,
        lambda: estimate_many(series, robust=False),
        one_by_one,
        difference,
        f"series of {STRETCH:,} samples, one core, no search for spikes; difference: relative, of q, r, likelihood",
    )
