"""The compiled loops of the likelihood profile, nothing else: many ratios λ = q/r over one channel at once.

Each ratio is a lane with r = 1 and the exact diffuse start. The filter is carried in its innovations: from
z − x and x' = x + k v follows v' = Δz + (1 − k) v, and with r = 1 the kept share 1 − k is 1/f, where f is the
innovation variance. So a lane is v and p; missing samples are gaps between the finite ones (a random walk
over g periods adds λ g), and nothing here meets a NaN.

A lane whose variance has come back to its fixed point K (p' = p holds for p = K, f = 1/(1 − K)) is settled:
no division is left, only v = d + v/f and Σ v². Lanes are in order of descending λ, the order in which they settle,
so the settled ones are always the first.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Array = NDArray[np.float64]

BLOCK = 8
"""Samples that a lane processes before the next lane: its state stays in registers."""

LANES = 8
"""Lanes settle, and are filled up, in groups of this many: one AVX-512 register of doubles."""

MAX_FACTOR = 1e18
"""Where no f exceeds this, BLOCK of them times FULL stay far from overflow."""

STRETCH = 4
"""Blocks in a row, where the sampling is regular and no λ above 1 is left to settle: Π f stays below 3^32."""

FULL = 1e150
"""A product of f beyond this is turned into its logarithm, so that a logarithm a sample is not needed."""


@compiled(error_model="numpy")
def scan_ratios(d: Array, gap: Array, ratio: Array, chi2: Array, logdet: Array) -> None:
    """Write Σ v²/f and Σ ln f of every lane into `chi2` and `logdet`.

    `d` holds the differences of neighbouring finite samples, `gap` the periods between them (empty: 1 each),
    `ratio` λ ≥ 0 in descending order, a multiple of LANES long. Source: Durbin & Koopman (2012), section 2.10.
    """
    n, lanes, regular = d.shape[0], ratio.shape[0], gap.shape[0] == 0
    v, p, kept = np.zeros(lanes), np.ones(lanes), np.zeros(lanes)
    product, squares, since = np.ones(lanes), np.zeros(lanes), np.zeros(lanes, np.int64)
    gain, steady = fixed_points(ratio)
    chi2[:] = 0.0
    logdet[:] = 0.0
    ones = np.ones(BLOCK)
    bounded = ratio[0] * (1.0 if regular else gap.max()) < MAX_FACTOR
    i = settled = 0
    while i < n:
        if not bounded or (i == 0 and n % BLOCK > 0):
            for t in range(i, n if not bounded else n % BLOCK):
                step_lanes(d[t], 1.0 if regular else gap[t], ratio, v, p, kept, chi2, logdet)
                i += 1
            continue
        end = i + BLOCK
        if regular and settled == lanes:
            end = n
        elif regular and ratio[settled] <= 1.0 and i + STRETCH * BLOCK <= n:
            end = i + STRETCH * BLOCK
        here = ones if regular else gap[i:end]
        if not regular and settled > 0 and not all_ones(here):
            for j in range(settled):
                logdet[j] -= (i - since[j]) * math.log(steady[j])
            settled = 0
        advance_settled(d[i:end], kept[:settled], v[:settled], squares[:settled])
        advance(
            d[i:end], here, ratio[settled:], v[settled:], p[settled:], kept[settled:],
            chi2[settled:], product[settled:],
        )  # fmt: skip
        i = end
        fold(product[settled:], logdet[settled:])
        while settled < lanes and near_steady(p, gain, settled):
            for j in range(settled, settled + LANES):
                p[j], kept[j], since[j] = gain[j], steady[j], i
            settled += LANES
    for j in range(settled):
        logdet[j] -= (n - since[j]) * math.log(steady[j])
    for j in range(lanes):
        chi2[j] += squares[j] * steady[j]
        logdet[j] += math.log(product[j])


@compiled()
def fixed_points(ratio: Array) -> tuple[Array, Array]:
    """Steady gain K of every λ, and 1 − K = K²/λ without its cancellation."""
    root, wide = np.sqrt(ratio), np.sqrt(ratio + 4.0)
    return 2.0 * root / (root + wide), (2.0 / (root + wide)) ** 2


@compiled(inline="always")
def fold(product: Array, logdet: Array) -> None:
    """Take the logarithm of the products that have grown (or shrunk) far."""
    for j in range(product.shape[0]):
        if not 1.0 / FULL < product[j] < FULL:
            logdet[j] += math.log(product[j])
            product[j] = 1.0


@compiled(inline="always")
def all_ones(gap: Array) -> bool:
    """Whether every step of the block is one nominal period."""
    whole = True
    for g in gap:
        whole = whole and g == 1.0
    return whole


@compiled(inline="always")
def near_steady(p: Array, gain: Array, first: int) -> bool:
    """Whether the group of lanes from `first` on has settled, as closely as rounding lets the variance come.

    Where the gain K is small the recursion forgets slowly, and its rounding piles up to about 1e-16/K.
    """
    near = True
    for j in range(first, first + LANES):
        near = near and abs(p[j] - gain[j]) <= 1e-12 * gain[j] + 4e-16
    return near


@compiled(error_model="numpy", fastmath={"contract"})
def step_lanes(
    d: float, gap: float, ratio: Array, v: Array, p: Array, kept: Array, chi2: Array, logdet: Array
) -> None:
    """One sample of every lane, however large f is."""
    for j in range(ratio.shape[0]):
        innovation = d + kept[j] * v[j]
        predicted = p[j] + ratio[j] * gap
        f = predicted + 1.0
        kept[j] = 1.0 / f
        p[j] = predicted * kept[j]
        v[j] = innovation
        chi2[j] += innovation * innovation * kept[j]
        logdet[j] += math.log(f)


@compiled(error_model="numpy", fastmath={"contract"})
def advance(
    d: Array, gap: Array, ratio: Array, v: Array, p: Array, kept: Array, chi2: Array, product: Array
) -> None:
    """Some blocks of samples of the lanes not yet settled, the steps of each in `gap`; Π f goes to `product`."""
    g0, g1, g2, g3, g4, g5, g6, g7 = gap[0], gap[1], gap[2], gap[3], gap[4], gap[5], gap[6], gap[7]
    for t in range(0, d.shape[0], BLOCK):
        d0, d1, d2, d3, d4, d5, d6, d7 = d[t], d[t + 1], d[t + 2], d[t + 3], d[t + 4], d[t + 5], d[t + 6], d[t + 7]
        for j in range(ratio.shape[0]):
            lam, vj, pj, w, total, f_all = ratio[j], v[j], p[j], kept[j], chi2[j], product[j]
            vj, pj, w, total, f_all = advance_lane(d0, g0, lam, vj, pj, w, total, f_all)
            vj, pj, w, total, f_all = advance_lane(d1, g1, lam, vj, pj, w, total, f_all)
            vj, pj, w, total, f_all = advance_lane(d2, g2, lam, vj, pj, w, total, f_all)
            vj, pj, w, total, f_all = advance_lane(d3, g3, lam, vj, pj, w, total, f_all)
            vj, pj, w, total, f_all = advance_lane(d4, g4, lam, vj, pj, w, total, f_all)
            vj, pj, w, total, f_all = advance_lane(d5, g5, lam, vj, pj, w, total, f_all)
            vj, pj, w, total, f_all = advance_lane(d6, g6, lam, vj, pj, w, total, f_all)
            vj, pj, w, total, f_all = advance_lane(d7, g7, lam, vj, pj, w, total, f_all)
            v[j], p[j], kept[j], chi2[j], product[j] = vj, pj, w, total, f_all


@compiled(inline="always", error_model="numpy", fastmath={"contract"})
def advance_lane(
    d: float, gap: float, lam: float, v: float, p: float, kept: float, chi2: float, product: float
) -> tuple[float, float, float, float, float]:
    """One sample of one lane: v, p, 1 − k, Σ v²/f and Π f after it."""
    v = d + kept * v
    p = p + lam * gap
    f = p + 1.0
    kept = 1.0 / f
    return v, p * kept, kept, chi2 + v * v * kept, product * f


@compiled(error_model="numpy", fastmath={"contract"})
def advance_settled(d: Array, kept: Array, v: Array, squares: Array) -> None:
    """Some blocks of samples of the settled lanes: two fused multiply-adds a sample."""
    for t in range(0, d.shape[0], BLOCK):
        d0, d1, d2, d3, d4, d5, d6, d7 = d[t], d[t + 1], d[t + 2], d[t + 3], d[t + 4], d[t + 5], d[t + 6], d[t + 7]
        for j in range(kept.shape[0]):
            w, vj, total = kept[j], v[j], squares[j]
            vj = d0 + w * vj
            total += vj * vj
            vj = d1 + w * vj
            total += vj * vj
            vj = d2 + w * vj
            total += vj * vj
            vj = d3 + w * vj
            total += vj * vj
            vj = d4 + w * vj
            total += vj * vj
            vj = d5 + w * vj
            total += vj * vj
            vj = d6 + w * vj
            total += vj * vj
            vj = d7 + w * vj
            total += vj * vj
            v[j], squares[j] = vj, total
