"""The compiled loops of the likelihood and of the other methods, nothing else."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import GATE_LIMIT as FILTERING_GATE_LIMIT
from kalscope.filtering.kernels import MISSING as FILTERING_MISSING
from kalscope.filtering.kernels import REJECTED as FILTERING_REJECTED
from kalscope.filtering.kernels import START as FILTERING_START
from kalscope.filtering.kernels import step as filtering_step
from kalscope.filtering.kernels import transition as filter_kernels

# The compiled loops of the likelihood profile, nothing else: many ratios λ = q/r over one channel at once.
#
# Each ratio is a lane with r = 1 and the exact diffuse start. The filter is carried in its innovations: from
# z − x and x' = x + k v follows v' = Δz + (1 − k) v, and with r = 1 the kept share 1 − k is 1/f, where f is the
# innovation variance. So a lane is v and p; missing samples are gaps between the finite ones (a random walk
# over g periods adds λ g), and nothing here meets a NaN.
#
# A lane whose variance has come back to its fixed point K (p' = p holds for p = K, f = 1/(1 − K)) is settled: no
# division is left, only v = d + v/f and Σ v². Lanes are in order of descending λ, the order in which they settle,
# so the settled ones are always the first.


Array = NDArray[np.float64]
Whole = NDArray[np.int64]

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


@compiled()
def scan_ratios(d: Array, gap: Array, starts: Whole, rows: Whole, ratio: Array, chi2: Array, logdet: Array) -> None:
    """Write Σ v²/f and Σ ln f of every lane of some records into `chi2` and `logdet`, shape (rows, lanes).

    `d` holds the differences of neighbouring finite samples, `gap` the periods between them (empty: 1 each), both
    of one record after the other, `ratio` λ ≥ 0 in descending order, a multiple of LANES. Source: Durbin & Koopman
    (2012), section 2.10.
    """
    for i in range(rows.shape[0]):
        first, stop = starts[rows[i]], starts[rows[i] + 1]
        own = gap[first:stop] if gap.shape[0] else gap
        scan_record(d[first:stop], gap[:0] if all_ones(own) else own, ratio[i], chi2[i], logdet[i])


@compiled(error_model="numpy")
def scan_record(d: Array, gap: Array, ratio: Array, chi2: Array, logdet: Array) -> None:
    """`scan_ratios` of one record."""
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


GOOD, TOO_FEW, CONSTANT, HOLDS_INF, BAD_STEPS = range(5)
"""The defect of a record: none; fewer finite samples than MIN_SAMPLES; all are equal; one is
infinite; a step is negative or not finite."""

MIN_SAMPLES = 8
"""Finite samples that an estimate needs."""

MAX_GAP = 1e150
"""Periods; a longer gap changes nothing, and its product with λ must fit a double."""


@compiled(error_model="numpy")
def take_apart(  # noqa: PLR0912
    values: Array, steps: Array, firsts: Whole, stops: Whole, whole: bool, d: Array, gap: Array, starts: Whole,
    scale: Array, counts: Whole,
) -> bool:  # fmt: skip
    """Write `d`, `gap`, `starts` and `scale` of `Records`, and return whether all gaps are 1.

    The rows of `counts` are the finite samples, those that differ from the one before, and the defect of each.
    """
    m, even, has_steps = 0, True, steps.shape[0] > 0
    for k in range(firsts.shape[0]):
        begin, finite, changes, waited, last, largest, defect = m, 0, 0, 0.0, 0.0, 0.0, GOOD
        for i in range(firsts[k], stops[k]):
            z = values[i]
            if has_steps and not 0.0 <= steps[i] < math.inf:
                defect = BAD_STEPS
                break
            waited += steps[i] if has_steps else 1.0
            if not math.isfinite(z):
                if math.isnan(z):
                    continue
                defect = HOLDS_INF
                break
            half = 0.5 * z - 0.5 * last  # halved: they may lie two of the largest doubles apart
            if finite == 0:
                finite = 1
            elif whole or waited > 0.0 or half != 0.0:
                if even and waited != 1.0:
                    even = False
                    gap[:m] = 1.0
                if not even:
                    gap[m] = min(waited, MAX_GAP)
                d[m] = half
                largest = max(largest, abs(half))
                if half != 0.0:
                    changes += 1
                finite += 1
                m += 1
            last, waited = z, 0.0
        if defect != GOOD:
            finite = 0
        elif finite < MIN_SAMPLES or changes == 0:
            defect = TOO_FEW if finite < MIN_SAMPLES else CONSTANT
        if defect != GOOD and not whole:
            m = begin
        exponent = min(math.frexp(largest)[1], 1022) if changes > 0 else -1
        factor, rest = math.ldexp(1.0, -(exponent // 2)), math.ldexp(1.0, exponent // 2 - exponent)
        for i in range(begin, m):
            d[i] = d[i] * factor * rest  # one factor alone may exceed a double
        scale[k], starts[k + 1] = math.ldexp(1.0, exponent + 1), m
        counts[0, k], counts[1, k], counts[2, k] = finite, changes, defect
    return even


@compiled(error_model="numpy", fastmath={"contract"})
def squares_since(d: Array, gap: Array, starts: Whole, since: Whole, ratio: Array, errors: Array) -> None:
    """Write the root mean square of v from the difference `since` on, at each λ of each record, r = 1.

    `errors` are of shape (rows, lanes), in units of the scale, NaN where there is no such difference.
    """
    lanes = ratio.shape[1]
    state = np.empty(4 * lanes)  # v, p, 1 − k, Σv²: in one array the compiler puts several lanes into a vector
    for k in range(ratio.shape[0]):
        first, stop = starts[k] + since[k], starts[k + 1]
        for j in range(lanes):
            state[j], state[lanes + j], state[2 * lanes + j], state[3 * lanes + j] = 0.0, 1.0, 0.0, 0.0
        for i in range(starts[k] if first < stop else stop, stop):
            g, counted = gap[i] if gap.shape[0] else 1.0, 1.0 if i >= first else 0.0
            for j in range(lanes):
                v = d[i] + state[2 * lanes + j] * state[j]
                predicted = state[lanes + j] + ratio[k, j] * g
                kept = 1.0 / (predicted + 1.0)
                state[j], state[lanes + j], state[2 * lanes + j] = v, predicted * kept, kept
                state[3 * lanes + j] += counted * v * v
        for j in range(lanes):
            errors[k, j] = math.sqrt(state[3 * lanes + j] / (stop - first)) if first < stop else math.nan


# The compiled loops of the likelihood with momentum, nothing else: many triples (q, r, τ) over one channel.
#
# Each triple is a lane of the filter with momentum, with the exact diffuse start. As without momentum it is carried
# in its innovations: v' = d + (1 - k) v - f u, where d is the difference of two neighbouring samples and u the
# velocity. LANES lanes advance together. All that they hold is in one array, quantity after quantity: only then
# does the compiler see that no two quantities share memory, and put the lanes into vectors. Where the gains of all
# have settled no division is left, until the next gap.


MOMENTUM_LANES = 16
"""Lanes that advance together: two AVX-512 registers of doubles, so that the processor need not wait for either."""

MOMENTUM_BLOCK = 4
"""Samples between two checks of the lanes; the product of this many variances stays within a double."""

SETTLED_BLOCK = 8
"""Samples that a settled lane processes before the next lane: its state stays in registers."""

SETTLED_WITHIN = 1e-13
"""Relative change of the variances a block below which the gains are taken as settled."""

MOMENTUM_FULL = 1e30
"""A product of variances beyond this, or below its inverse, is turned into its logarithm."""

# Where each quantity of the lanes begins: innovation, velocity, variances, share kept, sums, parameters, steps.
V, U, P, G, W, KEPT, SUM, PRODUCT, Q, R, E, F, A, B, C = (MOMENTUM_LANES * i for i in range(15))
STEP_SIZE = 5 * MOMENTUM_LANES
ROOM = 15 * MOMENTUM_LANES

Lane = tuple[float, float, float, float, float, float, float, float]
"""v, u, p, g, w, 1 - k, Σv²/s and Πs of one lane."""


@compiled(error_model="numpy")
def scan_lanes(d: Array, gap: Array, q: Array, r: Array, tau: Array, chi2: Array, logdet: Array) -> None:
    """Write Σ v²/s and Σ ln s of every lane into `chi2` and `logdet`.

    `d` holds the differences of neighbouring finite samples, `gap` the periods between them (empty: 1 each); `q`,
    `r`, not both 0, and `tau` > 0 the lanes, a multiple of LANES long. Lanes of one τ should be adjacent.
    """
    lanes, even = np.empty(ROOM), np.empty(STEP_SIZE)
    for first in range(0, q.shape[0], MOMENTUM_LANES):
        lanes[:] = 0.0
        for j in range(MOMENTUM_LANES):
            lanes[Q + j], lanes[R + j], lanes[P + j] = q[first + j], r[first + j], r[first + j]
            lanes[W + j] = 0.5 * q[first + j] / tau[first + j]
            lanes[PRODUCT + j] = 1.0
            logdet[first + j] = 0.0
        scan_group(d, gap, tau[first : first + MOMENTUM_LANES], lanes, even, logdet[first : first + MOMENTUM_LANES])
        for j in range(MOMENTUM_LANES):
            chi2[first + j] = lanes[SUM + j]


@compiled(error_model="numpy")
def scan_group(d: Array, gap: Array, tau: Array, lanes: Array, even: Array, logdet: Array) -> None:
    """`scan_lanes` of LANES lanes that hold their start; `even` is room for the transition over one period."""
    n, regular = d.shape[0], gap.shape[0] == 0
    before = np.empty(3 * MOMENTUM_LANES)
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
            fold_with_momentum(lanes, logdet)
            i += 1
            continue
        if last != 1.0:
            last = 1.0
            for j in range(STEP_SIZE):
                lanes[E + j] = even[j]
        stop = n if regular else end_of_ones(gap, i)
        settled = False
        while i + MOMENTUM_BLOCK <= stop and not settled:
            for j in range(
                3 * MOMENTUM_LANES
            ):  # an assignment between slices takes seconds to compile, for its error message
                before[j] = lanes[P + j]
            advance_block(d[i : i + MOMENTUM_BLOCK], lanes)
            fold_with_momentum(lanes, logdet)
            i += MOMENTUM_BLOCK
            settled = has_settled(before, lanes)
        if settled:
            advance_settled_with_momentum(d[i:stop], lanes, logdet)
            i = stop
        while i < stop:
            advance_one(d[i], lanes)
            i += 1
        fold_with_momentum(lanes, logdet)
    for j in range(MOMENTUM_LANES):
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
    over = filter_kernels(gap, 1.0, tau[0])
    for j in range(MOMENTUM_LANES):
        if j > 0 and tau[j] != tau[j - 1]:
            over = filter_kernels(gap, 1.0, tau[j])
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
def momentum_advance_lane(d: float, r: float, over: tuple[float, float, float, float, float], lane: Lane) -> Lane:
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
    for j in range(MOMENTUM_LANES):
        over = lanes[E + j], lanes[F + j], lanes[A + j], lanes[B + j], lanes[C + j]
        put_lane(lanes, j, momentum_advance_lane(d, lanes[R + j], over, lane_at(lanes, j)))


@compiled(error_model="numpy", fastmath={"contract"})
def advance_block(d: Array, lanes: Array) -> None:
    """BLOCK differences of every lane, one period apart."""
    d0, d1, d2, d3 = d[0], d[1], d[2], d[3]
    for j in range(MOMENTUM_LANES):
        r, over = lanes[R + j], (lanes[E + j], lanes[F + j], lanes[A + j], lanes[B + j], lanes[C + j])
        lane = momentum_advance_lane(d0, r, over, lane_at(lanes, j))
        lane = momentum_advance_lane(d1, r, over, lane)
        lane = momentum_advance_lane(d2, r, over, lane)
        put_lane(lanes, j, momentum_advance_lane(d3, r, over, lane))


@compiled(forceinline=True)
def fold_with_momentum(lanes: Array, logdet: Array) -> None:
    """Take the logarithm of the products that have grown or shrunk far."""
    within = True
    for j in range(MOMENTUM_LANES):
        within = within and 1.0 / MOMENTUM_FULL < lanes[PRODUCT + j] < MOMENTUM_FULL
    if not within:
        for j in range(MOMENTUM_LANES):
            logdet[j] += math.log(lanes[PRODUCT + j])
            lanes[PRODUCT + j] = 1.0


@compiled()
def has_settled(before: Array, lanes: Array) -> bool:
    """True where no variance of x and of v changed by more than rounding."""
    for j in range(MOMENTUM_LANES):
        if abs(lanes[P + j] - before[j]) > SETTLED_WITHIN * lanes[P + j]:
            return False
        if abs(lanes[W + j] - before[2 * MOMENTUM_LANES + j]) > SETTLED_WITHIN * lanes[W + j]:
            return False
    return True


@compiled(error_model="numpy")
def advance_settled_with_momentum(d: Array, lanes: Array, logdet: Array) -> None:
    """Further differences of all lanes with the gains that they keep."""
    kept = np.empty(ROOM)
    for j in range(MOMENTUM_LANES):
        e, f, g, w, r = lanes[E + j], lanes[F + j], lanes[G + j], lanes[W + j], lanes[R + j]
        shared = g + f * w
        s = lanes[P + j] + f * (g + shared) + lanes[A + j] + r
        ell = (e * shared + lanes[B + j]) / s
        lanes[KEPT + j] = r / s
        kept[V + j], kept[U + j], kept[SUM + j] = lanes[V + j], lanes[U + j] - ell * lanes[V + j], 0.0
        kept[A + j], kept[B + j], kept[E + j], kept[F + j] = r / s - f * ell, e * ell, e, f
        kept[P + j], kept[Q + j] = s, ell
    run_settled(d, kept)
    for j in range(MOMENTUM_LANES):
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
        for j in range(MOMENTUM_LANES):
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
        for j in range(MOMENTUM_LANES):
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


# The compiled loops of the spike-proof fit, nothing else: which samples neither the past nor the future predicts.
#
# One run of the filter over a record, in which the samples beyond the gate change nothing. A spike, or a few side
# by side, is refused, and the sample after it is predicted well again. Where more than LONGEST adjacent samples are
# refused, the signal has moved: the filter starts again at the first of them, and they count as predicted.


SIGMAS = 4.0
"""Standard deviations from what both sides together predict, beyond which a sample is set aside."""
SIDE_SIGMAS = 3.5
"""Standard deviations from what either side alone predicts: the sample must be beyond that on both."""
LONGEST = FILTERING_GATE_LIMIT
"""Spikes side by side that are recognised, as many as the gate rejects in a row; more of them are a movement."""
AT_END = 2
"""Adjacent spikes that are recognised at either end of the record."""
NEAR = 15
"""Samples on either side of one that show how lively the signal is there."""
MOST = 25.0
"""Limit on the v²/s of one neighbour: a single missed spike does not make the signal lively."""
VERY_LIVELY, CROWDED = 2.0, 0.1
"""Mean v²/s around a sample, and share of the samples there, beyond which it takes SIGMAS times as much again:
what looks like several spikes may be movement."""
MIN_RUNS = 6
"""Number of runs of spikes, of any length, from which those of more than two samples are accepted."""
LIVELY = 1.5
"""Mean v²/s of the samples around one from which the signal counts as lively; of normal noise it is 1 or less."""
START_SIGMAS = 3.0
"""Distance from the centred median, in standard deviations of the noise, at which the search starts."""
WINDOW = 2 * LONGEST + 1
"""Samples of the centred median: spikes side by side are fewer than half of them."""
FALSE_ALARM = 1e-3
"""Share of records of normal noise in which a spike is found."""
NORMAL = 1.8
"""Standard deviation of white normal noise over the median of its distances from the centred median. It is not
1.48: a sample that is the median itself has the distance 0. Where the signal moves fast it is larger."""
EQUAL_SHARE = 0.2
"""Share of readings equal to the one before from which the record is called quantised."""


@compiled()
def judge_samples(
    z: Array,
    dt: Array,
    q: float,
    r: float,
    tau: float | None,
    start: tuple[float, float],
    error: Array,
    variance: Array,
    refused: NDArray[np.bool_],
) -> None:
    """Write v and s of each sample, and whether it is refused; LONGEST may be refused side by side.

    `z` holds NaN where missing, `dt` may be empty, `tau` None is the filter without momentum, and `start` the level
    before the first sample and its variance. Samples refused before one is taken have no past to be predicted from:
    s = inf. More than AT_END rejected samples at the end may be a step, and count as predicted.
    """
    n, regular = z.shape[0], dt.shape[0] == 0
    last = 1.0
    over = filter_kernels(last, q, tau)
    w = 0.0
    if tau is not None:
        w = 0.5 * q / tau
    state = (start[0], 0.0, start[1], 0.0, w)
    first = run = taken = i = 0
    while i < n:
        if not regular and dt[i] != last:
            last = dt[i]
            over = filter_kernels(last, q, tau)
        state, _, _, v, s, done = filtering_step(z[i], over, r, SIDE_SIGMAS**2, state, 0, tau)
        refused[i] = done == FILTERING_REJECTED
        if done == FILTERING_REJECTED:
            first = i if run == 0 else first
            run += 1
        elif done != FILTERING_MISSING:
            run = 0
            taken += 1
        if done != FILTERING_START:
            error[i], variance[i] = (
                0.0 if done == FILTERING_MISSING else v,
                math.inf if refused[i] and taken == 0 else s,
            )
        if run > LONGEST:
            refused[first : i + 1] = False
            state, run, i = (math.nan, 0.0, math.inf, 0.0, w), 0, first
            continue
        i += 1
    if run > AT_END:
        refused[first:] = False


@compiled()
def suspect_each(
    values: Array,
    steps: Array,
    starts: Whole,
    q: Array,
    r: Array,
    suspect: NDArray[np.bool_],
) -> None:
    """Write whether each series with q and r, unit², may have spikes; those whose q and r are both 0 do not."""
    for i in range(q.shape[0]):
        here = slice(starts[i], starts[i + 1])
        suspect[i] = q[i] + r[i] > 0.0 and is_suspect(
            values[here], steps[here] if len(steps) else steps, q[i], r[i]
        )


@compiled()
def is_suspect(z: Array, steps: Array, q: float, r: float) -> bool:
    """Whether one series may have spikes."""
    samples = z[np.isfinite(z)]
    if repeats(samples):
        return True
    away, scale = distances_from_median(samples)
    if scale == 0.0:
        return bool(away.any())
    return beyond_chance(away / scale, START_SIGMAS) or beyond_chance(
        np.sqrt(unpredicted(z, steps, q, r, None)), SIGMAS
    )


@compiled()
def repeats(samples: Array) -> bool:
    """Whether so many readings equal the one before that steps of the readings count too."""
    equal = 0
    for i in range(1, samples.shape[0]):
        equal += samples[i] == samples[i - 1]
    return equal > EQUAL_SHARE * (samples.shape[0] - 1)


@compiled()
def beyond_chance(distances: Array, least: float) -> bool:
    """Whether more distances, in standard deviations, exceed `least` than by chance, or one exceeds it by far."""
    n = distances.shape[0]
    expected = n * math.erfc(least / math.sqrt(2.0))
    many, largest = 0, 0.0
    for distance in distances:
        many += distance > least
        largest = max(largest, distance)
    far = n * math.erfc(largest / math.sqrt(2.0)) < FALSE_ALARM * (1.0 + 1e-9)
    return far or many > expected + 4.0 * math.sqrt(expected) + 2.0


@compiled()
def distances_from_median(samples: Array) -> tuple[Array, float]:
    """|sample − median of the WINDOW around it|, shape (n,), and the noise that they show.

    The ends are continued with their last value.
    """
    n, half = samples.shape[0], WINDOW // 2
    window, away = np.empty(WINDOW), np.empty(n)
    for j in range(WINDOW):
        insert(window, j, samples[min(max(j - half, 0), n - 1)])
    for i in range(n):
        away[i] = abs(samples[i] - window[half])
        leaving, coming = samples[max(i - half, 0)], samples[min(i + half + 1, n - 1)]
        j = 0
        while window[j] != leaving:
            j += 1
        while j < WINDOW - 1 and window[j + 1] < coming:
            window[j] = window[j + 1]
            j += 1
        while j > 0 and window[j - 1] > coming:
            window[j] = window[j - 1]
            j -= 1
        window[j] = coming
    return away, NORMAL * np.median(away)


@compiled(error_model="numpy")
def unpredicted(z: Array, steps: Array, q: float, r: float, tau: float | None) -> Array:
    """e²/s of each sample that neither side predicts, by both sides together, shape (n,); 0 for all others."""
    n = z.shape[0]
    v, s, refused = np.empty((2, n)), np.empty((2, n)), np.empty((2, n), np.bool_)
    found, any_found = np.zeros(n), False
    judge_samples(z, steps, q, r, tau, start_of(z, steps, q, r), v[0], s[0], refused[0])
    if not refused[0].any():
        return found
    back, turned = np.empty(steps.shape[0]), np.empty(n)
    for i in range(steps.shape[0]):
        back[i] = 1.0 if i == 0 else steps[n - i]
    for i in range(n):
        turned[i] = z[n - 1 - i]
    judge_samples(turned, back, q, r, tau, start_of(turned, back, q, r), v[1], s[1], refused[1])
    for i in range(n):
        j = n - 1 - i
        if not math.isnan(z[i]) and refused[0, i] and refused[1, j]:
            p, other = s[0, i] - r, s[1, j] - r
            least, most = min(p, other), max(p, other)
            share = 0.5 if least == most else 1.0 / (1.0 + least / most)  # of the side that knows more
            first = share if p == least else 1.0 - share
            found[i] = (first * v[0, i] + (1.0 - first) * v[1, j]) ** 2 / (r + share * least)
            any_found = any_found or found[i] > SIGMAS**2
    if any_found:
        clear_lively(z, v, s, refused, found)
    return found


@compiled(error_model="numpy")
def clear_lively(z: Array, v: Array, s: Array, refused: NDArray[np.bool_], found: Array) -> None:
    """Set what may be movement to 0 in `found`: in a lively or crowded neighbourhood, or a lone pulse."""
    n = z.shape[0]
    squares, spikes, counted = np.zeros(n), np.zeros(n), np.zeros(n, np.bool_)
    present, kept = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    for i in range(n):
        j = n - 1 - i
        counted[i] = not (math.isnan(z[i]) or (refused[0, i] and refused[1, j]))
        if counted[i]:
            squares[i] = min(v[0, i] * v[0, i] / s[0, i], v[1, j] * v[1, j] / s[1, j], MOST)
    for i in range(n):
        lively = mean_near(squares, counted, i) if found[i] > 0.0 else 0.0
        kept[i] = found[i] > SIGMAS**2 * (lively if lively > LIVELY else 1.0)
    for i in range(n):
        spikes[i], present[i] = 1.0 if kept[i] else 0.0, not math.isnan(z[i])
    for i in range(n):
        if kept[i]:
            lively = mean_near(squares, counted, i)
            if lively > VERY_LIVELY and mean_near(spikes, present, i) > CROWDED:
                kept[i] = found[i] > SIGMAS**4 * lively
    clear_pulses(present, kept)
    for i in range(n):
        if not kept[i]:
            found[i] = 0.0


@compiled()
def mean_near(values: Array, counted: NDArray[np.bool_], at: int) -> float:
    """Mean of the values that count within NEAR samples of one; 0 where there are none."""
    total, count = 0.0, 0
    for i in range(max(at - NEAR, 0), min(at + NEAR + 1, values.shape[0])):
        if counted[i]:
            total += values[i]
            count += 1
    return total / max(count, 1)


@compiled()
def clear_pulses(present: NDArray[np.bool_], kept: NDArray[np.bool_]) -> None:
    """Drop the runs of more than two samples where there are few runs: the signal has moved, and come back."""
    runs, before = 0, False
    for i in range(kept.shape[0]):
        if present[i]:
            runs += kept[i] and not before
            before = kept[i]
    if runs >= MIN_RUNS:
        return
    first = length = 0
    for i in range(kept.shape[0] + 1):
        if i < kept.shape[0] and (kept[i] or not present[i]):
            first = i if length == 0 else first
            length += kept[i]
            continue
        if length > 2:
            for j in range(first, i):
                kept[j] = False
        length = 0


@compiled()
def start_of(z: Array, steps: Array, q: float, r: float) -> tuple[float, float]:
    """A level for the first sample, and its variance: the sample itself may be a spike."""
    near, count, first, last = np.empty(WINDOW), 0, 0, 0
    for i in range(z.shape[0]):
        if count < WINDOW and not math.isnan(z[i]):
            insert(near, count, z[i])
            first = i if count == 0 else first
            last = i
            count += 1
    span = float(last - first)
    if steps.shape[0]:
        span = 0.0
        for i in range(first + 1, last + 1):
            span += steps[i]
    return 0.5 * (near[(count - 1) // 2] + near[count // 2]), r + q * span


@compiled()
def insert(values: Array, count: int, value: float) -> None:
    """Put a value into its place among the first `count`, which rise; to sort takes seconds to compile."""
    i = count
    while i > 0 and values[i - 1] > value:
        values[i] = values[i - 1]
        i -= 1
    values[i] = value


# The compiled loops of the likelihood of several sensors of one quantity, nothing else.
#
# A record is a list of readings: the value, which sensor it comes from, and the periods since the reading before
# it, 0 within a row. Reading j of sensor i is b_i + c_i x plus noise of variance r_i; x moves as in
# `filtering.momentum`, for τ = 0 as a random walk. Each reading is one scalar update; the first one sets the exact
# diffuse start and is not scored. Source: Durbin & Koopman (2012), section 6.4; the scores: Koopman & Shephard
# (1992), Biometrika 79, 823.


Transition = tuple[float, float, float, float, float]

FUSION_FULL = 1e100
"""A product of variances beyond this, or below its inverse, is turned into its logarithm."""

TAU_STEP = 1e-4
"""Relative step in τ for the derivatives of the transition."""

# What `filter_readings` keeps of each reading: its innovation over the variance s of it, s, the gains of position
# and velocity, and the state after it with its variances.
ERROR, S, KX, KV, FUSION_X, FUSION_V, FUSION_P, FUSION_G, FUSION_W = 0, 1, 2, 3, 4, 5, 6, 7, 8
SEARCH_KEPT = 9


@compiled(inline="always")
def over_gap(gap: float, q: float, tau: float) -> Transition:
    """What `gap` periods do to the state: e, f, a, b, c of `filtering.momentum`."""
    return filter_kernels(gap, q, tau) if tau > 0.0 else (0.0, 0.0, q * gap, 0.0, 0.0)


@compiled(error_model="numpy")
def filter_readings(  # noqa: PLR0912 - one loop for three purposes
    value: Array,
    sensor: Whole,
    gap: Array,
    q: float,
    tau: float,
    r: Array,
    c: Array,
    offset: Array,
    kept: Array | None,
    matrix: Array | None,
    right: Array | None,
) -> tuple[float, float]:
    """Filter the readings, keep what the scores need in `kept`, (readings, SEARCH_KEPT); returns Σ v²/s and Σ ln s.

    With `matrix` and `right` in place of `kept` it adds up the normal equations, matrix b = right, of the most
    likely offsets b: the innovations are linear in b, v = v(0) + Σ d_l b_l, and the filters of v(0) and of the d_l
    share their gains.
    """
    sensors = r.shape[0]
    place, speed, d = np.zeros(sensors), np.zeros(sensors), np.zeros(sensors)
    i = int(sensor[0])
    x, v, p, g = (value[0] - offset[i]) / c[i], 0.0, r[i] / (c[i] * c[i]), 0.0
    w = 0.5 * q / tau if tau > 0.0 else 0.0
    place[i] = -1.0 / c[i]
    if kept is not None:
        kept[0, FUSION_V], kept[0, FUSION_G], kept[0, FUSION_W] = v, g, w
    chi2, logdet, product, last = 0.0, 0.0, 1.0, 1.0
    e, f, a, b, grown = over_gap(last, q, tau)
    for j in range(1, value.shape[0]):
        if gap[j] > 0.0:
            if gap[j] != last:
                last = gap[j]
                e, f, a, b, grown = over_gap(last, q, tau)
            if tau > 0.0:
                x, v = x + f * v, e * v
                p, g, w = p + f * (2.0 * g + f * w) + a, e * (g + f * w) + b, e * e * w + grown
                if matrix is not None:
                    for k in range(sensors):
                        place[k] += f * speed[k]
                        speed[k] *= e
            else:
                p += a
        i = int(sensor[j])
        s = c[i] * c[i] * p + r[i]
        part = 1.0 / s
        kx, kv = c[i] * p * part, c[i] * g * part
        innovation = value[j] - offset[i] - c[i] * x
        x, v = x + kx * innovation, v + kv * innovation
        w -= kv * c[i] * g
        p, g = p * r[i] * part, g * r[i] * part
        if kept is not None:
            chi2 += innovation * innovation * part
            product *= s
            if not 1.0 / FUSION_FULL < product < FUSION_FULL:
                logdet += math.log(product)
                product = 1.0
            kept[j, ERROR], kept[j, S], kept[j, KX], kept[j, KV] = innovation * part, s, kx, kv
            kept[j, FUSION_X], kept[j, FUSION_V] = x, v
            kept[j, FUSION_P], kept[j, FUSION_G], kept[j, FUSION_W] = p, g, w
        if matrix is not None and right is not None:
            for k in range(sensors):
                d[k] = -c[i] * place[k]
            d[i] -= 1.0
            for k in range(sensors):
                right[k] -= d[k] * innovation * part
                for m in range(k + 1):
                    matrix[k, m] += d[k] * d[m] * part
            for k in range(sensors):
                place[k] += kx * d[k]
                speed[k] += kv * d[k]
    if matrix is not None:
        for k in range(sensors):
            for m in range(k):
                matrix[m, k] = matrix[k, m]
    return chi2, logdet + math.log(product)


@compiled(error_model="numpy")
def score_readings(
    value: Array,
    sensor: Whole,
    gap: Array,
    q: float,
    tau: float,
    r: Array,
    c: Array,
    offset: Array,
    kept: Array,
    by_r: Array,
    by_c: Array,
) -> tuple[float, float]:
    """Derivatives of the log-likelihood by q and τ, and by r and c of each sensor (into `by_r` and `by_c`).

    Backwards over what `filter_readings` kept: (y, u) is the score of the state, n its information.
    """
    by_q = by_tau = y = speed = n11 = n12 = n22 = 0.0
    last = 1.0
    over, change = over_gap(last, 1.0, tau), change_with_tau(last, tau)
    for j in range(value.shape[0] - 1, 0, -1):
        i = int(sensor[j])
        part, kx, kv, p, g = 1.0 / kept[j, S], kept[j, KX], kept[j, KV], kept[j, FUSION_P], kept[j, FUSION_G]
        u = kept[j, ERROR] - kx * y - kv * speed
        by_r[i] += 0.5 * (u * u - part - kx * kx * n11 - 2.0 * kx * kv * n12 - kv * kv * n22)
        smoothed = kept[j, FUSION_X] + p * y + g * speed
        by_c[i] += u * smoothed - kx + kx * (n11 * p + n12 * g) + kv * (n12 * p + n22 * g)
        y += c[i] * u
        left, turned = 1.0 - kx * c[i], kv * c[i]
        n11 = left * left * n11 - 2.0 * left * turned * n12 + turned * turned * n22 + c[i] * c[i] * part
        n12 = left * n12 - turned * n22
        if not gap[j] > 0.0:
            continue
        if gap[j] != last:
            last = gap[j]
            over, change = over_gap(last, 1.0, tau), change_with_tau(last, tau)
        e, f, a, b, grown = over
        yy, yu, uu = y * y - n11, y * speed - n12, speed * speed - n22
        by_q += 0.5 * (a * yy + 2.0 * b * yu + grown * uu)
        if tau > 0.0:
            de, df, da, db, dc = change
            by_tau += 0.5 * q * (da * yy + 2.0 * db * yu + dc * uu)
            g, w = kept[j - 1, FUSION_G], kept[j - 1, FUSION_W]
            ahead = kept[j - 1, FUSION_V] + g * y + w * (f * y + e * speed)
            by_tau += df * (y * ahead - n11 * (g + f * w) - n12 * e * w)
            by_tau += de * (speed * ahead - n12 * (g + f * w) - n22 * e * w)
        speed = f * y + e * speed
        n22 = f * f * n11 + 2.0 * f * e * n12 + e * e * n22
        n12 = f * n11 + e * n12
    i = int(sensor[0])
    by_r[i] += 0.5 * (y * y - n11) / (c[i] * c[i])
    by_c[i] -= y * (value[0] - offset[i]) / (c[i] * c[i]) + (y * y - n11) * r[i] / (c[i] * c[i] * c[i])
    if tau > 0.0:
        by_q += 0.25 * (speed * speed - n22) / tau
        by_tau -= 0.25 * (speed * speed - n22) * q / (tau * tau)
    return by_q, by_tau


@compiled()
def change_with_tau(gap: float, tau: float) -> Transition:
    """Derivatives of the transition for q = 1 by τ; 0 without momentum."""
    if not tau > 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    h = TAU_STEP * tau
    more, less = filter_kernels(gap, 1.0, tau + h), filter_kernels(gap, 1.0, tau - h)
    half = 0.5 / h
    return (
        half * (more[0] - less[0]),
        half * (more[1] - less[1]),
        half * (more[2] - less[2]),
        half * (more[3] - less[3]),
        half * (more[4] - less[4]),
    )
