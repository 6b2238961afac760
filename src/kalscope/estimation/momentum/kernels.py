"""The compiled loops of the likelihood with momentum, nothing else: many triples (q, r, τ) over one channel.

Each triple is a lane of the filter with momentum, with the exact diffuse start. As without momentum it is carried
in its innovations: v' = d + (1 - k) v - f u, where d is the difference of two neighbouring samples and u the
velocity. LANES lanes advance together. All that they hold is in one array, quantity after quantity: only then does
the compiler see that no two quantities share memory, and put the lanes into vectors. Where the gains of all have
settled no division is left, until the next gap.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import transition

Array = NDArray[np.float64]

LANES = 16
"""Lanes that advance together: two AVX-512 registers of doubles, so that the processor need not wait for either."""

BLOCK = 4
"""Samples between two checks of the lanes; the product of this many variances stays within a double."""

SETTLED_BLOCK = 8
"""Samples that a settled lane processes before the next lane: its state stays in registers."""

SETTLED_WITHIN = 1e-13
"""Relative change of the variances a block below which the gains are taken as settled."""

FULL = 1e30
"""A product of variances beyond this, or below its inverse, is turned into its logarithm."""

# Where each quantity of the lanes begins: innovation, velocity, variances, share kept, sums, parameters, steps.
V, U, P, G, W, KEPT, SUM, PRODUCT, Q, R, E, F, A, B, C = (LANES * i for i in range(15))
STEP_SIZE = 5 * LANES
ROOM = 15 * LANES

Lane = tuple[float, float, float, float, float, float, float, float]
"""v, u, p, g, w, 1 - k, Σv²/s and Πs of one lane."""


@compiled(error_model="numpy")
def scan_lanes(d: Array, gap: Array, q: Array, r: Array, tau: Array, chi2: Array, logdet: Array) -> None:
    """Write Σ v²/s and Σ ln s of every lane into `chi2` and `logdet`.

    `d` holds the differences of neighbouring finite samples, `gap` the periods between them (empty: 1 each); `q`,
    `r`, not both 0, and `tau` > 0 the lanes, a multiple of LANES long. Lanes of one τ should be adjacent.
    """
    lanes, even = np.empty(ROOM), np.empty(STEP_SIZE)
    for first in range(0, q.shape[0], LANES):
        lanes[:] = 0.0
        for j in range(LANES):
            lanes[Q + j], lanes[R + j], lanes[P + j] = q[first + j], r[first + j], r[first + j]
            lanes[W + j] = 0.5 * q[first + j] / tau[first + j]
            lanes[PRODUCT + j] = 1.0
            logdet[first + j] = 0.0
        scan_group(d, gap, tau[first : first + LANES], lanes, even, logdet[first : first + LANES])
        for j in range(LANES):
            chi2[first + j] = lanes[SUM + j]


@compiled(error_model="numpy")
def scan_group(d: Array, gap: Array, tau: Array, lanes: Array, even: Array, logdet: Array) -> None:
    """`scan_lanes` of LANES lanes that hold their start; `even` is room for the transition over one period."""
    n, regular = d.shape[0], gap.shape[0] == 0
    before = np.empty(3 * LANES)
    set_step(1.0, tau, lanes)
    for j in range(STEP_SIZE):
        even[j] = lanes[E + j]
    last = 1.0
    i = 0
    while i < n:
        if not regular and gap[i] != 1.0:
            if gap[i] != last:
                last = gap[i]
                set_step(last, tau, lanes)
            advance_one(d[i], lanes)
            fold(lanes, logdet)
            i += 1
            continue
        if last != 1.0:
            last = 1.0
            for j in range(STEP_SIZE):
                lanes[E + j] = even[j]
        stop = n if regular else end_of_ones(gap, i)
        settled = False
        while i + BLOCK <= stop and not settled:
            for j in range(
                3 * LANES
            ):  # an assignment between slices takes seconds to compile, for its error message
                before[j] = lanes[P + j]
            advance_block(d[i : i + BLOCK], lanes)
            fold(lanes, logdet)
            i += BLOCK
            settled = has_settled(before, lanes)
        if settled:
            advance_settled(d[i:stop], lanes, logdet)
            i = stop
        while i < stop:
            advance_one(d[i], lanes)
            i += 1
        fold(lanes, logdet)
    for j in range(LANES):
        logdet[j] += math.log(lanes[PRODUCT + j])


@compiled()
def end_of_ones(gap: Array, first: int) -> int:
    """The first index from `first` on at which a step is not one period."""
    for i in range(first, gap.shape[0]):
        if gap[i] != 1.0:
            return i
    return gap.shape[0]


@compiled()
def set_step(gap: float, tau: Array, lanes: Array) -> None:
    """The transition of every lane over `gap` periods."""
    over = transition(gap, 1.0, tau[0])
    for j in range(LANES):
        if j > 0 and tau[j] != tau[j - 1]:
            over = transition(gap, 1.0, tau[j])
        q = lanes[Q + j]
        lanes[E + j], lanes[F + j] = over[0], over[1]
        lanes[A + j], lanes[B + j], lanes[C + j] = over[2] * q, over[3] * q, over[4] * q


@compiled(forceinline=True)
def lane_at(lanes: Array, j: int) -> Lane:
    """The state of one lane."""
    return (
        lanes[V + j], lanes[U + j], lanes[P + j], lanes[G + j], lanes[W + j], lanes[KEPT + j], lanes[SUM + j],
        lanes[PRODUCT + j],
    )  # fmt: skip


@compiled(forceinline=True)
def put_lane(lanes: Array, j: int, lane: Lane) -> None:
    """Store the state of one lane."""
    lanes[V + j], lanes[U + j], lanes[P + j], lanes[G + j] = lane[0], lane[1], lane[2], lane[3]
    lanes[W + j], lanes[KEPT + j], lanes[SUM + j], lanes[PRODUCT + j] = lane[4], lane[5], lane[6], lane[7]


@compiled(forceinline=True, error_model="numpy", fastmath={"contract"})
def advance_lane(d: float, r: float, over: tuple[float, float, float, float, float], lane: Lane) -> Lane:
    """One difference of one lane."""
    e, f, a, b, c = over
    v, u, p, g, w, kept, total, product = lane
    shared = g + f * w
    grown = p + f * (g + shared) + a
    joint = e * shared + b
    s = grown + r
    part = 1.0 / s
    v = d + kept * v - f * u
    kept, ell = r * part, joint * part
    return (
        v,
        e * u + ell * v,
        kept * grown,
        kept * joint,
        e * e * w + c - ell * joint,
        kept,
        total + v * v * part,
        product * s,
    )


@compiled(error_model="numpy", fastmath={"contract"})
def advance_one(d: float, lanes: Array) -> None:
    """One difference of every lane."""
    for j in range(LANES):
        over = lanes[E + j], lanes[F + j], lanes[A + j], lanes[B + j], lanes[C + j]
        put_lane(lanes, j, advance_lane(d, lanes[R + j], over, lane_at(lanes, j)))


@compiled(error_model="numpy", fastmath={"contract"})
def advance_block(d: Array, lanes: Array) -> None:
    """BLOCK differences of every lane, one period apart."""
    d0, d1, d2, d3 = d[0], d[1], d[2], d[3]
    for j in range(LANES):
        r, over = lanes[R + j], (lanes[E + j], lanes[F + j], lanes[A + j], lanes[B + j], lanes[C + j])
        lane = advance_lane(d0, r, over, lane_at(lanes, j))
        lane = advance_lane(d1, r, over, lane)
        lane = advance_lane(d2, r, over, lane)
        put_lane(lanes, j, advance_lane(d3, r, over, lane))


@compiled(forceinline=True)
def fold(lanes: Array, logdet: Array) -> None:
    """Take the logarithm of the products that have grown or shrunk far."""
    within = True
    for j in range(LANES):
        within = within and 1.0 / FULL < lanes[PRODUCT + j] < FULL
    if not within:
        for j in range(LANES):
            logdet[j] += math.log(lanes[PRODUCT + j])
            lanes[PRODUCT + j] = 1.0


@compiled()
def has_settled(before: Array, lanes: Array) -> bool:
    """True where no variance of x and of v changed by more than rounding."""
    for j in range(LANES):
        if abs(lanes[P + j] - before[j]) > SETTLED_WITHIN * lanes[P + j]:
            return False
        if abs(lanes[W + j] - before[2 * LANES + j]) > SETTLED_WITHIN * lanes[W + j]:
            return False
    return True


@compiled(error_model="numpy")
def advance_settled(d: Array, lanes: Array, logdet: Array) -> None:
    """Further differences of all lanes with the gains that they keep."""
    kept = np.empty(ROOM)
    for j in range(LANES):
        e, f, g, w, r = lanes[E + j], lanes[F + j], lanes[G + j], lanes[W + j], lanes[R + j]
        shared = g + f * w
        s = lanes[P + j] + f * (g + shared) + lanes[A + j] + r
        ell = (e * shared + lanes[B + j]) / s
        lanes[KEPT + j] = r / s
        kept[V + j], kept[U + j], kept[SUM + j] = lanes[V + j], lanes[U + j] - ell * lanes[V + j], 0.0
        kept[A + j], kept[B + j], kept[E + j], kept[F + j] = r / s - f * ell, e * ell, e, f
        kept[P + j], kept[Q + j] = s, ell
    run_settled(d, kept)
    for j in range(LANES):
        s, ell = kept[P + j], kept[Q + j]
        lanes[V + j], lanes[U + j] = kept[V + j], kept[U + j] + ell * kept[V + j]
        lanes[SUM + j] += kept[SUM + j] / s
        logdet[j] += d.shape[0] * math.log(s)


@compiled(error_model="numpy", fastmath={"contract"})
def run_settled(d: Array, kept: Array) -> None:
    """V and Σv² of settled lanes, one multiply-add deep a sample.

    With y = u - ℓ v the recursion is v' = d - f y + (1 - k - f ℓ) v and y' = e y + e ℓ v.
    """
    n = d.shape[0]
    whole = n - n % SETTLED_BLOCK
    for t in range(0, whole, SETTLED_BLOCK):
        d0, d1, d2, d3, d4, d5, d6, d7 = d[t], d[t + 1], d[t + 2], d[t + 3], d[t + 4], d[t + 5], d[t + 6], d[t + 7]
        for j in range(LANES):
            v, y, total = kept[V + j], kept[U + j], kept[SUM + j]
            a, b, e, f = kept[A + j], kept[B + j], kept[E + j], kept[F + j]
            v, y, total = settled_lane(d0, a, b, e, f, v, y, total)
            v, y, total = settled_lane(d1, a, b, e, f, v, y, total)
            v, y, total = settled_lane(d2, a, b, e, f, v, y, total)
            v, y, total = settled_lane(d3, a, b, e, f, v, y, total)
            v, y, total = settled_lane(d4, a, b, e, f, v, y, total)
            v, y, total = settled_lane(d5, a, b, e, f, v, y, total)
            v, y, total = settled_lane(d6, a, b, e, f, v, y, total)
            v, y, total = settled_lane(d7, a, b, e, f, v, y, total)
            kept[V + j], kept[U + j], kept[SUM + j] = v, y, total
    for t in range(whole, n):
        for j in range(LANES):
            a, b, e, f = kept[A + j], kept[B + j], kept[E + j], kept[F + j]
            v, y, total = settled_lane(d[t], a, b, e, f, kept[V + j], kept[U + j], kept[SUM + j])
            kept[V + j], kept[U + j], kept[SUM + j] = v, y, total


@compiled(forceinline=True, error_model="numpy", fastmath={"contract"})
def settled_lane(
    d: float, a: float, b: float, e: float, f: float, v: float, y: float, total: float
) -> tuple[float, float, float]:
    """One difference of one settled lane: v, y and Σv² after it."""
    before = v
    v = d - f * y + a * v
    return v, e * y + b * before, total + v * v
