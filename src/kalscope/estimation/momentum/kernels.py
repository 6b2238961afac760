"""The compiled loops of the likelihood with momentum, nothing else: many triples (q, r, τ) over one channel.

Each triple is a lane of the filter of `filtering.momentum`, with the exact diffuse start. Eight lanes advance
together. All that they hold is in one array, quantity after quantity: only then does the compiler see that no two
quantities share memory, and put the eight into one vector. Once the gains of all eight have settled no division is
left.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import transition

Array = NDArray[np.float64]

LANES = 8
"""Lanes that advance together: one AVX-512 register of doubles."""

BLOCK = 4
"""Samples between two checks of the lanes; the product of this many variances stays within a double."""

SETTLED_WITHIN = 1e-13
"""Relative change of the variances a block below which the gains are taken as settled."""

FULL = 1e30
"""A product of variances beyond this, or below its inverse, is turned into its logarithm."""

# Where each quantity of the lanes begins: the state, its variances, the sums, the parameters and the step.
X, V, P, G, W = 0, 8, 16, 24, 32
SUM, PRODUCT = 40, 48
Q, R, E, F, A, B, C = 56, 64, 72, 80, 88, 96, 104
K, ELL = 112, 120
ROOM = 128


@compiled(error_model="numpy")
def scan_lanes(z: Array, gap: Array, q: Array, r: Array, tau: Array, chi2: Array, logdet: Array) -> None:
    """Write Σ v²/s and Σ ln s of every lane into `chi2` and `logdet`.

    `z` holds the finite samples, `gap` the periods before each but the first (empty: 1 each); `q`, `r`, not both 0,
    and `tau` > 0 the lanes, a multiple of LANES long. Lanes of one τ should be adjacent where gaps differ.
    """
    lanes = np.empty(ROOM)
    for first in range(0, q.shape[0], LANES):
        lanes[:] = 0.0
        for j in range(LANES):
            lanes[X + j], lanes[P + j] = z[0], r[first + j]
            lanes[Q + j], lanes[R + j] = q[first + j], r[first + j]
            lanes[W + j] = 0.5 * q[first + j] / tau[first + j]
            lanes[PRODUCT + j] = 1.0
        scan_eight(z, gap, tau[first : first + LANES], lanes, logdet[first : first + LANES])
        for j in range(LANES):
            chi2[first + j] = lanes[SUM + j]


@compiled(error_model="numpy")
def scan_eight(z: Array, gap: Array, tau: Array, lanes: Array, logdet: Array) -> None:
    """`scan_lanes` of eight lanes that hold their start."""
    n, regular = z.shape[0], gap.shape[0] == 0
    even_from = 0 if regular else after_last_gap(gap)
    before = np.empty(3 * LANES)
    logdet[:] = 0.0
    last = 1.0
    set_step(last, tau, lanes)
    i = 1
    while i < n:
        end = min(i + BLOCK, n)
        for j in range(3 * LANES):  # an assignment between slices takes seconds to compile, for its error message
            before[j] = lanes[P + j]
        while i < end:
            if not regular and gap[i - 1] != last:
                last = gap[i - 1]
                set_step(last, tau, lanes)
            advance(z[i], lanes)
            i += 1
        fold(lanes, logdet)
        if i >= even_from and has_settled(before, lanes):
            set_gains(lanes)
            advance_settled(z[i:], lanes)
            for j in range(LANES):
                logdet[j] += (n - i) * np.log(lanes[C + j])
            i = n
    for j in range(LANES):
        logdet[j] += np.log(lanes[PRODUCT + j])


@compiled()
def after_last_gap(gap: Array) -> int:
    """The first block from which on every step is one period, with a block before it in which the step was set."""
    for i in range(gap.shape[0] - 1, -1, -1):
        if gap[i] != 1.0:
            return i + 2 + BLOCK
    return 0


@compiled()
def set_step(gap: float, tau: Array, lanes: Array) -> None:
    """The transition of every lane over `gap` periods, for q = 1."""
    over = transition(gap, 1.0, tau[0])
    for j in range(LANES):
        if j > 0 and tau[j] != tau[j - 1]:
            over = transition(gap, 1.0, tau[j])
        lanes[E + j], lanes[F + j] = over[0], over[1]
        lanes[A + j], lanes[B + j], lanes[C + j] = (
            over[2] * lanes[Q + j],
            over[3] * lanes[Q + j],
            over[4] * lanes[Q + j],
        )


@compiled(error_model="numpy", fastmath={"contract"})
def advance(z: float, lanes: Array) -> None:
    """One sample of eight lanes."""
    for j in range(LANES):
        e, f, r, v = lanes[E + j], lanes[F + j], lanes[R + j], lanes[V + j]
        g, w = lanes[G + j], lanes[W + j]
        ahead = lanes[X + j] + f * v
        shared = g + f * w
        grown = lanes[P + j] + f * (g + shared) + lanes[A + j]
        joint = e * shared + lanes[B + j]
        s = grown + r
        part = 1.0 / s
        innovation = z - ahead
        k, ell, kept = grown * part, joint * part, r * part
        lanes[X + j] = ahead + k * innovation
        lanes[V + j] = e * v + ell * innovation
        lanes[SUM + j] += innovation * innovation * part
        lanes[PRODUCT + j] *= s
        lanes[P + j] = kept * grown
        lanes[G + j] = kept * joint
        lanes[W + j] = e * e * w + lanes[C + j] - ell * joint


@compiled(inline="always", error_model="numpy")
def fold(lanes: Array, logdet: Array) -> None:
    """Take the logarithm of the products that have grown or shrunk far."""
    for j in range(LANES):
        if not 1.0 / FULL < lanes[PRODUCT + j] < FULL:
            logdet[j] += np.log(lanes[PRODUCT + j])
            lanes[PRODUCT + j] = 1.0


@compiled()
def has_settled(before: Array, lanes: Array) -> bool:
    """True where no variance of x and of v of the eight lanes changed by more than rounding."""
    for j in range(LANES):
        if abs(lanes[P + j] - before[j]) > SETTLED_WITHIN * lanes[P + j]:
            return False
        if abs(lanes[W + j] - before[2 * LANES + j]) > SETTLED_WITHIN * lanes[W + j]:
            return False
    return True


@compiled(error_model="numpy")
def set_gains(lanes: Array) -> None:
    """The gains that the lanes keep; s takes the place of c, which is no longer needed."""
    for j in range(LANES):
        e, f, g, w = lanes[E + j], lanes[F + j], lanes[G + j], lanes[W + j]
        shared = g + f * w
        grown = lanes[P + j] + f * (g + shared) + lanes[A + j]
        s = grown + lanes[R + j]
        lanes[K + j], lanes[ELL + j] = grown / s, (e * shared + lanes[B + j]) / s
        lanes[C + j] = s


@compiled(error_model="numpy", fastmath={"contract"})
def advance_settled(z: Array, lanes: Array) -> None:
    """All further samples of eight lanes with the gains that they keep."""
    squares = np.zeros(3 * LANES)
    for j in range(LANES):
        squares[LANES + j], squares[2 * LANES + j] = lanes[X + j], lanes[V + j]
    for i in range(z.shape[0]):
        for j in range(LANES):
            ahead = squares[LANES + j] + lanes[F + j] * squares[2 * LANES + j]
            innovation = z[i] - ahead
            squares[LANES + j] = ahead + lanes[K + j] * innovation
            squares[2 * LANES + j] = lanes[E + j] * squares[2 * LANES + j] + lanes[ELL + j] * innovation
            squares[j] += innovation * innovation
    for j in range(LANES):
        lanes[SUM + j] += squares[j] / lanes[C + j]
