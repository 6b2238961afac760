"""The contests against memory, against scipy's steady filter, and against the plain loop of five lines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numba import njit

from kalscope.cli.bench.contest import Contest, Sizes, Work, compared_with
from kalscope.common.array import Array
from kalscope.filtering.batch import denoise, kalman_filter
from kalscope.filtering.steady_state import steady_state

STARTED = 5_000
"""Samples after which a filter of constant gain has forgotten its start: (1 − K)^5000 is 2e-22 at λ = 1e-4."""


@njit(cache=True, nogil=True)
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


def own_contests(work: Work, sizes: Sizes) -> Iterator[Contest]:
    """Ours against memory, against scipy's steady filter and against the plain loop."""
    z, params, n = work.z, work.params, len(work.z)
    out, other = np.empty_like(z), np.empty_like(z)
    scale = float(np.abs(z).max())
    same = compared_with(work.x, scale)

    def into() -> Array:
        return denoise(z, params, out=out)

    def fresh() -> Array:
        return denoise(z, params)

    def copy() -> None:
        np.copyto(other, z)

    yield Contest("denoise(out=)", "np.copyto", n, into, copy, same, "both write to an array that is there")
    yield Contest("denoise", "z.copy()", n, fresh, z.copy, same, "both make their output")
    gain = float(steady_state(params).gain)
    late = compared_with(work.x, scale, since=STARTED)
    told = f"constant gain; compared from sample {STARTED:,} on; "

    def lfilter() -> Array:
        return _lfilter(z, gain)

    yield Contest("scipy lfilter", "denoise", n, lfilter, fresh, late, told + "both make their output")
    yield Contest("scipy lfilter", "denoise(out=)", n, lfilter, into, late, told + "lfilter takes no out")
    yield Contest(
        "five lines, numba",
        "denoise(out=)",
        n,
        lambda: five_lines(z, work.q, work.r, other),
        into,
        same,
        "both write to an array that is there",
    )
    some = work.first(sizes.at_most(1_000_000))
    yield Contest(
        "kalman_filter",
        "five lines, numba",
        len(some.z),
        lambda: kalman_filter(some.z, params).x,
        lambda: five_lines(some.z, work.q, work.r, np.empty_like(some.z)),
        compared_with(some.x, scale),
        "kalman_filter also keeps p, k, innovation, s and sums the likelihood",
    )
    few = work.first(sizes.at_most(200_000))
    yield Contest(
        "five lines, Python",
        "denoise",
        len(few.z),
        lambda: five_lines_in_python(few.z, work.q, work.r),
        lambda: denoise(few.z, params),
        compared_with(few.x, scale),
        "over a list of floats",
    )


def _lfilter(z: Array, gain: float) -> Array:
    from scipy.signal import lfilter

    return lfilter([gain], [1.0, gain - 1.0], z, zi=[(1.0 - gain) * z[0]])[0]
