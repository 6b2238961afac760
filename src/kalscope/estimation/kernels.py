"""The compiled loops of the likelihood and of the other methods, nothing else."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import GATE_LIMIT, MISSING, REJECTED, START, step, transition

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


@compiled(error_model="numpy")
def scan_ratios(  # noqa: PLR0912 - one loop over the samples, with what a block needs done in its place
    d: Array, gap: Array, starts: Whole, rows: Whole, ratio: Array, chi2: Array, logdet: Array
) -> None:
    """Write Σ v²/f and Σ ln f of every lane of some records into `chi2` and `logdet`, shape (rows, lanes).

    `d` holds the differences of neighbouring finite samples, `gap` the periods between them (empty: 1 each), both
    of one record after the other, `ratio` λ ≥ 0 in descending order, a multiple of LANES. Source: Durbin & Koopman
    (2012), section 2.10.
    """
    lanes = ratio.shape[1]
    v, p, kept, gain, steady = np.empty(lanes), np.empty(lanes), np.empty(lanes), np.empty(lanes), np.empty(lanes)
    product, squares, since = np.empty(lanes), np.empty(lanes), np.empty(lanes, np.int64)
    for row in range(rows.shape[0]):
        i, stop = int(starts[int(rows[row])]), int(starts[int(rows[row]) + 1])
        settled, even, widest = 0 * lanes, stop > i, 1.0  # no literals: numba would compile what they go to twice
        for j in range(lanes):
            v[j] = kept[j] = squares[j] = chi2[row, j] = logdet[row, j] = 0.0
            p[j] = product[j] = 1.0
            root, wide = math.sqrt(ratio[row, j]), math.sqrt(ratio[row, j] + 4.0)
            gain[j] = 2.0 * root / (root + wide)
            steady[j] = (2.0 / (root + wide)) ** 2  # 1 − K = K²/λ without its cancellation
        for t in range(i, stop if gap.shape[0] else i):
            even = even and float(gap[t]) == 1.0
            widest = max(widest, gap[t])
        regular, bounded = even, ratio[row, 0] * widest < MAX_FACTOR
        for t in range(i, i + (stop - i) % BLOCK if bounded else stop):
            step_lanes(d[t], 1.0 if regular else gap[t], ratio[row], v, p, kept, chi2[row], logdet[row])
            i += 1
        while i < stop:
            end = i + BLOCK
            if not regular:
                even = True
                for t in range(i, end):
                    even = even and float(gap[t]) == 1.0
                if not even:
                    for j in range(settled):
                        logdet[row, j] -= (i - since[j]) * math.log(steady[j])
                    settled = 0 * lanes
            elif settled == lanes:
                end = stop
            elif ratio[row, settled] <= 1.0 and i + STRETCH * BLOCK <= stop:
                end = i + STRETCH * BLOCK
            advance_settled(d, i, end, settled, kept, v, squares)
            advance(d, gap, even, i, end, settled, ratio[row], v, p, kept, chi2[row], product)
            i = end
            for j in range(settled, lanes):
                if not 1.0 / FULL < product[j] < FULL:
                    logdet[row, j] += math.log(product[j])
                    product[j] = 1.0
            near = settled < lanes
            while near:  # as closely as rounding lets the variance come: at a small gain K it piles up to 1e-16/K
                for j in range(settled, settled + LANES):
                    near = near and abs(p[j] - gain[j]) <= 1e-12 * gain[j] + 4e-16
                if near:
                    for j in range(settled, settled + LANES):
                        p[j], kept[j], since[j] = gain[j], steady[j], i
                    settled += LANES
                    near = settled < lanes
        for j in range(settled):
            logdet[row, j] -= (stop - since[j]) * math.log(steady[j])
        for j in range(lanes):
            chi2[row, j] += squares[j] * steady[j]
            logdet[row, j] += math.log(product[j])


@compiled(inner=True, error_model="numpy", fastmath={"contract"})
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


# In the two loops below an unsigned `j` spares the test for a negative index, and with the samples of a block in
# names of their own the compiler sees that no lane changes them: only so does it put the lanes into vectors.


@compiled(inner=True, error_model="numpy", fastmath={"contract"})
def advance(
    d: Array, gap: Array, even: bool, first: int, stop: int, settled: int, ratio: Array, v: Array, p: Array,
    kept: Array, chi2: Array, product: Array,
) -> None:  # fmt: skip
    """Some blocks of samples of the lanes from `settled` on, one where it is not `even`; Π f goes to `product`."""
    t, g0, g1, g2, g3, g4, g5, g6, g7 = first, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0
    if not even:
        g0, g1, g2, g3 = gap[t], gap[t + 1], gap[t + 2], gap[t + 3]
        g4, g5, g6, g7 = gap[t + 4], gap[t + 5], gap[t + 6], gap[t + 7]
    for t in range(first, stop, BLOCK):
        d0, d1, d2, d3, d4, d5, d6, d7 = d[t], d[t + 1], d[t + 2], d[t + 3], d[t + 4], d[t + 5], d[t + 6], d[t + 7]
        for j in range(np.uint64(settled), np.uint64(ratio.shape[0])):
            lam, vj, pj, w, total, f_all = ratio[j], v[j], p[j], kept[j], chi2[j], product[j]
            for z, g in ((d0, g0), (d1, g1), (d2, g2), (d3, g3), (d4, g4), (d5, g5), (d6, g6), (d7, g7)):
                vj = z + w * vj
                pj += lam * g
                f = pj + 1.0
                w = 1.0 / f
                pj *= w
                total += vj * vj * w
                f_all *= f
            v[j], p[j], kept[j], chi2[j], product[j] = vj, pj, w, total, f_all


@compiled(inner=True, error_model="numpy", fastmath={"contract"})
def advance_settled(d: Array, first: int, stop: int, settled: int, kept: Array, v: Array, squares: Array) -> None:
    """Some blocks of samples of the settled lanes: two fused multiply-adds a sample."""
    for t in range(first, stop, BLOCK):
        d0, d1, d2, d3, d4, d5, d6, d7 = d[t], d[t + 1], d[t + 2], d[t + 3], d[t + 4], d[t + 5], d[t + 6], d[t + 7]
        for j in range(np.uint64(settled)):
            w, vj, total = kept[j], v[j], squares[j]
            for z in (d0, d1, d2, d3, d4, d5, d6, d7):
                vj = z + w * vj
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
                    for j in range(m):
                        gap[j] = 1.0
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

# Where each quantity of the lanes begins: innovation, velocity, variances, share kept, sums, parameters, steps, the
# variances a block before; and of settled lanes Σv², s, the gain of u and two factors.
(
    V, U, P, G, W, KEPT, SUM, PRODUCT, Q, R, E, F, A, B, C, P_BEFORE, W_BEFORE, SQUARES, S_KEPT, ELL, VV, YV,
) = (MOMENTUM_LANES * i for i in range(22))  # fmt: skip
ROOM = 22 * MOMENTUM_LANES


@compiled(error_model="numpy", fastmath={"contract"})
def scan_lanes(  # noqa: PLR0912 - as `scan_ratios`
    d: Array, gap: Array, q: Array, r: Array, tau: Array, chi2: Array, logdet: Array
) -> None:
    """Write Σ v²/s and Σ ln s of every lane into `chi2` and `logdet`.

    `d` holds the differences of neighbouring finite samples, `gap` the periods between them (empty: 1 each); `q`,
    `r`, not both 0, and `tau` > 0 the lanes, a multiple of MOMENTUM_LANES long. Lanes of one τ should be adjacent.
    """
    lanes, n = np.empty(ROOM), d.shape[0]
    for first in range(0, q.shape[0], MOMENTUM_LANES):
        for j in range(MOMENTUM_LANES):
            lanes[V + j] = lanes[U + j] = lanes[G + j] = lanes[KEPT + j] = lanes[SUM + j] = logdet[first + j] = 0.0
            lanes[Q + j], lanes[R + j], lanes[P + j] = q[first + j], r[first + j], r[first + j]
            lanes[W + j], lanes[PRODUCT + j] = 0.5 * q[first + j] / tau[first + j], 1.0
        i, last = 0 * n, math.nan
        while i < n:
            size, stop = float(gap[i]) if gap.shape[0] else 1.0, i + 1 if gap.shape[0] else n
            while stop < n and gap[stop] == size:
                stop += 1
            if size != last:
                set_step(size, tau, first, lanes)
                last = size
            settled = False
            while i < stop and not settled:
                end = min(i + MOMENTUM_BLOCK, stop)
                settled = end == i + MOMENTUM_BLOCK
                if settled:
                    for j in range(MOMENTUM_LANES):
                        lanes[P_BEFORE + j], lanes[W_BEFORE + j] = lanes[P + j], lanes[W + j]
                momentum_advance(d, i, end, lanes)
                if settled:
                    for j in range(MOMENTUM_LANES):
                        p, w = lanes[P + j], lanes[W + j]
                        settled = settled and abs(p - lanes[P_BEFORE + j]) <= SETTLED_WITHIN * p
                        settled = settled and abs(w - lanes[W_BEFORE + j]) <= SETTLED_WITHIN * w
                i, within = end, True
                for j in range(MOMENTUM_LANES):
                    within = within and 1.0 / MOMENTUM_FULL < lanes[PRODUCT + j] < MOMENTUM_FULL
                if not within:
                    for j in range(MOMENTUM_LANES):
                        logdet[first + j] += math.log(lanes[PRODUCT + j])
                        lanes[PRODUCT + j] = 1.0
            if settled:
                end = i + (stop - i) % SETTLED_BLOCK
                momentum_advance(d, i, end, lanes)
                momentum_advance_settled(d, end, stop, lanes, first, logdet)
                i = stop
        for j in range(MOMENTUM_LANES):
            chi2[first + j] = lanes[SUM + j]
            logdet[first + j] += math.log(lanes[PRODUCT + j])


@compiled(inner=True, error_model="numpy", fastmath={"contract"})
def set_step(gap: float, tau: Array, first: int, lanes: Array) -> None:
    """The transition of every lane, `tau` from `first` on, over `gap` periods."""
    last, over = tau[first], transition(gap, 1.0, tau[first])
    for j in range(MOMENTUM_LANES):
        if tau[first + j] != last:
            last = tau[first + j]
            over = transition(gap, 1.0, last)
        q = lanes[Q + j]
        lanes[E + j], lanes[F + j] = over[0], over[1]
        lanes[A + j], lanes[B + j], lanes[C + j] = over[2] * q, over[3] * q, over[4] * q


@compiled(inner=True, error_model="numpy", fastmath={"contract"})
def momentum_advance(d: Array, first: int, stop: int, lanes: Array) -> None:
    """Some differences of every lane, equal steps apart."""
    for t in range(first, stop):
        for j in range(MOMENTUM_LANES):
            e, f = lanes[E + j], lanes[F + j]
            shared = lanes[G + j] + f * lanes[W + j]
            grown = lanes[P + j] + f * (lanes[G + j] + shared) + lanes[A + j]
            joint = e * shared + lanes[B + j]
            s = grown + lanes[R + j]
            part = 1.0 / s
            v = d[t] + lanes[KEPT + j] * lanes[V + j] - f * lanes[U + j]
            kept, ell = lanes[R + j] * part, joint * part
            lanes[V + j], lanes[U + j] = v, e * lanes[U + j] + ell * v
            lanes[P + j], lanes[G + j], lanes[KEPT + j] = kept * grown, kept * joint, kept
            lanes[W + j] = e * e * lanes[W + j] + lanes[C + j] - ell * joint
            lanes[SUM + j] += v * v * part
            lanes[PRODUCT + j] *= s


@compiled(inner=True, error_model="numpy", fastmath={"contract"})
def momentum_advance_settled(d: Array, first: int, stop: int, lanes: Array, group: int, logdet: Array) -> None:
    """Blocks of differences of all lanes with the gains that they keep, one multiply-add deep a sample.

    With y = u - ℓ v the recursion is v' = d - f y + (1 - k - f ℓ) v and y' = e y + e ℓ v.
    """
    for j in range(MOMENTUM_LANES):
        e, f, g, r = lanes[E + j], lanes[F + j], lanes[G + j], lanes[R + j]
        shared = g + f * lanes[W + j]
        s = lanes[P + j] + f * (g + shared) + lanes[A + j] + r
        ell = (e * shared + lanes[B + j]) / s
        lanes[KEPT + j], lanes[S_KEPT + j], lanes[ELL + j], lanes[SQUARES + j] = r / s, s, ell, 0.0
        lanes[VV + j], lanes[YV + j] = r / s - f * ell, e * ell
        lanes[U + j] -= ell * lanes[V + j]
    for t in range(first, stop, SETTLED_BLOCK):
        d0, d1, d2, d3, d4, d5, d6, d7 = d[t], d[t + 1], d[t + 2], d[t + 3], d[t + 4], d[t + 5], d[t + 6], d[t + 7]
        for j in range(MOMENTUM_LANES):
            v, y, total = lanes[V + j], lanes[U + j], lanes[SQUARES + j]
            e, f, vv, yv = lanes[E + j], lanes[F + j], lanes[VV + j], lanes[YV + j]
            for z in (d0, d1, d2, d3, d4, d5, d6, d7):
                before = v
                v = z - f * y + vv * v
                y = e * y + yv * before
                total += v * v
            lanes[V + j], lanes[U + j], lanes[SQUARES + j] = v, y, total
    for j in range(MOMENTUM_LANES):
        lanes[U + j] += lanes[ELL + j] * lanes[V + j]
        lanes[SUM + j] += lanes[SQUARES + j] / lanes[S_KEPT + j]
        logdet[group + j] += (stop - first) * math.log(lanes[S_KEPT + j])


SIDE_SIGMAS = 3.5
"""Standard deviations from what either side alone predicts: a spike must be beyond that on both."""
AT_END = 2
"""Adjacent spikes that are recognised at either end of the record."""


MEDIAN_BLOCK = 128
"""Windows that are sorted side by side, so that the compiler puts them into vectors."""


@compiled()
def median_distances(samples: Array, size: int, distances: Array) -> None:
    """Write |sample − median of the `size`, an odd number, around it|; the ends are continued as they are."""
    n, half = samples.shape[0], size // 2
    rows = np.empty((size, MEDIAN_BLOCK))
    for first in range(0, n, MEDIAN_BLOCK):
        width = min(MEDIAN_BLOCK, n - first)
        for k in range(size):
            for i in range(width):
                rows[k, i] = samples[min(max(first + i + k - half, 0), n - 1)]
        for last in range(size - 1, half - 1, -1):  # the largest of those that remain goes to the end
            for k in range(last):
                for i in range(width):
                    a, b = rows[k, i], rows[k + 1, i]
                    rows[k, i], rows[k + 1, i] = (a, b) if a < b else (b, a)
        for i in range(width):
            distances[first + i] = abs(samples[first + i] - rows[half, i])


@compiled(plain=True)
def refuse(
    z: Array, dt: Array, starts: Whole, q: Array, r: Array, tau: float | None, backwards: bool, near: Array,
    wanted: NDArray[np.bool_], error: Array, variance: Array, refused: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Write v and s of each sample, and whether it is refused; GATE_LIMIT may be refused side by side.

    One run of the filter over each record that is `wanted`, in which samples beyond the gate change nothing. A
    spike, or a few side by side, is refused, and the sample after it is predicted well again. Where more adjacent
    samples are refused, the signal has moved: the filter starts again at the first of them, and they count as
    predicted. Records of which none is refused are `wanted` no more.

    `z` holds NaN where missing, record k from `starts[k]` on; `dt` may be empty, `tau` None is the filter without
    momentum; `near` is room for the samples that give the start. Samples refused before one is taken have no past
    to be predicted from: s = inf. More than AT_END rejected samples at the end may be a step, and count as
    predicted.
    """
    towards = -1 if backwards else 1
    for row in range(wanted.shape[0]):
        n, origin = starts[row + 1] - starts[row], starts[row + 1] - 1 if backwards else starts[row]
        if not wanted[row]:
            continue
        last, w = 1.0, 0.0
        over = transition(last, q[row], tau)
        if tau is not None:
            w = 0.5 * q[row] / tau
        level, periods = start_level(z, dt, origin, towards, n, near)
        state = (level, 0.0, r[row] + q[row] * periods, 0.0, w)
        first = run = taken = i = 0
        wanted[row] = False
        while i < n:
            at = origin + towards * i
            gap = step_before(dt, at, towards, i)
            if gap != last:
                last = gap
                over = transition(last, q[row], tau)
            state, _, _, v, s, done = step(float(z[at]), over, r[row], SIDE_SIGMAS**2, state, 0, tau)
            refused[at] = done == REJECTED
            if done == REJECTED:
                first = i if run == 0 else first
                run += 1
            elif done != MISSING:
                run = 0
                taken += 1
            if done != START:
                error[at] = 0.0 if done == MISSING else v
                variance[at] = math.inf if refused[at] and taken == 0 else s
            i += 1
            if run > GATE_LIMIT:
                for j in range(first, i):
                    refused[origin + towards * j] = False
                state, run, i = (math.nan, 0.0, math.inf, 0.0, w), 0, first
        for j in range(first if run > AT_END else n, n):
            refused[origin + towards * j] = False
        for j in range(starts[row], starts[row + 1]):
            wanted[row] = wanted[row] or refused[j]


@compiled(plain=True, inner=True)
def step_before(dt: Array, at: int, towards: int, i: int) -> float:
    """Nominal sample periods before the sample that is the i-th on the way."""
    if dt.shape[0] == 0 or (towards < 0 and i == 0):
        return 1.0
    return dt[at] if towards > 0 else dt[at + 1]


@compiled(plain=True, inner=True)
def start_level(z: Array, dt: Array, origin: int, towards: int, n: int, near: Array) -> tuple[float, float]:
    """The median of the first samples, as the first itself may be a spike, and the periods that they take."""
    i, count, periods, span = 0, 0, 0.0, 0.0
    while i < n and count < near.shape[0]:
        at = origin + towards * i
        if count > 0:
            periods += step_before(dt, at, towards, i)
        if not math.isnan(z[at]):
            j = count
            while j > 0 and near[j - 1] > z[at]:
                near[j] = near[j - 1]
                j -= 1
            near[j] = z[at]
            count, span = count + 1, periods
        i += 1
    return 0.5 * (near[(count - 1) // 2] + near[count // 2]), span


# The compiled loops of the likelihood of several sensors of one quantity, nothing else.
#
# A record is a list of readings: the value, which sensor it comes from, and the periods since the reading before
# it, 0 within a row. Reading j of sensor i is b_i + c_i x plus noise of variance r_i; x moves as in
# `filtering.kernels`, for τ = 0 as a random walk. Each reading is one scalar update; the first one sets the exact
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


@compiled(inner=True, inline="always")
def over_gap(gap: float, q: float, tau: float) -> Transition:
    """What `gap` periods do to the state: e, f, a, b, c of `filtering.kernels.transition`."""
    return transition(gap, q, tau) if tau > 0.0 else (0.0, 0.0, q * gap, 0.0, 0.0)


@compiled(inner=True, inline="always")
def add_innovation(
    i: int, c: float, place: Array, v: float, part: float, d: Array, matrix: Array, right: Array
) -> None:
    """Add the innovation v = v(0) + Σ d_l b_l of sensor i, variance 1/`part`, to the equations; `d` is filled."""
    for k in range(d.shape[0]):
        d[k] = -c * place[k]
    d[i] -= 1.0
    for k in range(d.shape[0]):
        right[k] -= d[k] * v * part
        for m in range(d.shape[0]):
            matrix[k, m] += d[k] * d[m] * part


@compiled(error_model="numpy")
def filter_readings(
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
            add_innovation(i, c[i], place, innovation, part, d, matrix, right)
            for k in range(sensors):
                place[k] += kx * d[k]
                speed[k] += kv * d[k]
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
        rest, turned = 1.0 - kx * c[i], kv * c[i]
        n11 = rest * rest * n11 - 2.0 * rest * turned * n12 + turned * turned * n22 + c[i] * c[i] * part
        n12 = rest * n12 - turned * n22
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


@compiled(inner=True)
def change_with_tau(gap: float, tau: float) -> Transition:
    """Derivatives of the transition for q = 1 by τ; 0 without momentum."""
    if not tau > 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    h = TAU_STEP * tau
    more, less = transition(gap, 1.0, tau + h), transition(gap, 1.0, tau - h)
    half = 0.5 / h
    return (
        half * (more[0] - less[0]),
        half * (more[1] - less[1]),
        half * (more[2] - less[2]),
        half * (more[3] - less[3]),
        half * (more[4] - less[4]),
    )
