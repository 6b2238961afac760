"""The residuals of a filter over one channel: its rows piece by piece, the tests of them, and their spikes.

If the model holds, the standardised innovations e are independent draws from N(0, 1). The tests are pure functions
of e; none of them raises or returns NaN for finite e. Formulas: Durbin & Koopman (2012), section 2.12; Commandeur &
Koopman (2007), section 8.5; Bar-Shalom et al. (2001), section 5.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.compiled import compiled
from kalscope.common.numbers import Array, Indices, Mask
from kalscope.errors import BadSetting
from kalscope.filtering.filter import PIECE, FilterResult, filter_pieces
from kalscope.filtering.params import FilterParams, one_channel, steps_of

Columns = tuple[Array, ...]
"""x, p, k, innovation and s of one channel."""


@dataclass(frozen=True)
class Run:
    """The rows of a filter, as often as they are needed."""

    n: int
    """Samples."""
    q: float
    """Of the filter, as r, momentum, and whether it has two speeds."""
    r: float
    momentum: float
    two_speeds: bool
    dt: Array | None
    """Nominal sample periods before each sample, shape (n,); None = 1 each."""
    pieces: Callable[[], Iterator[tuple[int, Columns]]]
    """From the first to the last: the first sample of a piece, and its rows, which the next one may overwrite."""

    @staticmethod
    def of_result(result: FilterResult, channel: int | None = None) -> Run:
        """A run of `kalman_filter`; of several channels one."""
        params = result.params
        if params is None:
            raise BadSetting("result must be what kalman_filter gave (got that of another filter)")
        rows = (result.x, result.p, result.k, result.innovation, result.s)
        if channel is not None:
            rows = tuple(row[:, channel] for row in rows)
        n = len(rows[0])

        def pieces() -> Iterator[tuple[int, Columns]]:
            for first in range(0, n, PIECE):
                yield first, tuple(row[first : first + PIECE] for row in rows)

        two_speeds = params.fast is not None
        return Run(n, params.q, float(params.r), params.momentum, two_speeds, result.dt, pieces)

    @staticmethod
    def of_samples(z: Array, params: FilterParams, dt: ArrayLike | None = None) -> Run:
        """The run over z, shape (n,): filtered again whenever it is asked for, and never kept."""

        def pieces() -> Iterator[tuple[int, Columns]]:
            for first, one in filter_pieces(z, params, dt):
                yield first, (one.x, one.p, one.k, one.innovation, one.s)

        samples = one_channel(z, params)
        steps = None if dt is None else steps_of(dt, len(samples))
        two_speeds = params.fast is not None
        return Run(len(samples), params.q, float(params.r), params.momentum, two_speeds, steps, pieces)

    def part(self, first: int, last: int) -> Run:
        """The samples from `first` to before `last`, counted from 0 again."""

        def pieces() -> Iterator[tuple[int, Columns]]:
            for begin, rows in self.pieces():
                if begin >= last:
                    return
                low, high = max(first - begin, 0), min(last - begin, len(rows[0]))
                if low < high:
                    yield begin + low - first, tuple(row[low:high] for row in rows)

        return replace(self, n=last - first, dt=None if self.dt is None else self.dt[first:last], pieces=pieces)


SPIKE = 4.0
"""Size, in local standard deviations, beyond which a residual counts as a spike: 63 in a million by chance."""

MIN_PAIRS = 10
"""Pairs of samples that a lag needs for a correlation."""

MIN_BLOCK = 4
"""Samples in the shortest block whose mean counts as low-frequency."""


def dot(a: Array, b: Array) -> float:
    """Σ a b without BLAS, whose threads wait for each other: 0.1 ms became 200 ms on a busy machine."""
    return float(np.einsum("i,i", a, b))


@dataclass(frozen=True)
class Correlation:
    """Autocorrelation of e with the gaps left out: only pairs with both samples scored count."""

    r: Array
    """r_1 … r_h, shape (h,); 0 at a lag that has too few pairs."""
    bound: float
    """95 % bound on |r_1| of white noise, 1.96/√N where nothing is missing."""
    q: float
    """Ljung-Box statistic over the h lags."""
    p: float
    """Probability of a q this large if e is white."""


def correlation(e: Array, lags: int, fitted: bool = False) -> Correlation:
    """Autocorrelation at lags 1 … `lags` and the Ljung-Box test of it.

    r_k is the sum over the n_k pairs, scaled up to the N − k pairs of a record without gaps, and
    Q = N (N + 2) Σ r_k² n_k / (N − k)², which is Ljung & Box (1978) where nothing is missing.

    Args:
        e: standardised innovations in the order of time, shape (n,), NaN where none was scored.
        lags: h ≥ 1.
        fitted: λ was estimated from this record: one degree of freedom fewer.
    """
    from scipy.special import chdtrc

    seen = np.isfinite(e)
    n = int(np.count_nonzero(seen))
    r = np.zeros(lags)
    first_pairs, q, used = 0, 0.0, 0
    if n > 1:
        first, last = np.argmax(seen), len(e) - np.argmax(seen[::-1])
        e, seen = e[first:last], seen[first:last]
        whole = n == len(e)
        d = e - (e.mean() if whole else e[seen].mean())
        d[~seen] = 0.0
        total = dot(d, d)
        for k in range(1, min(lags, n - 1) + 1):
            pairs = n - k if whole else int(np.count_nonzero(seen[k:] & seen[:-k]))
            first_pairs = pairs if k == 1 else first_pairs
            if pairs >= MIN_PAIRS and total > 0.0:
                share = dot(d[k:], d[:-k]) / total
                r[k - 1] = share * (n - k) / pairs
                q += n * (n + 2.0) * share**2 / pairs
                used += 1
    p = float(chdtrc(max(used - fitted, 1), q)) if used else 1.0
    return Correlation(r, 1.96 / math.sqrt(first_pairs + 1.0), float(q), p)


def nis_band(n: int) -> tuple[float, float]:
    """95 % band of the mean of n values e², [χ²_n(0.025)/n, χ²_n(0.975)/n]."""
    from scipy.special import chdtri

    return float(chdtri(n, 0.975)) / n, float(chdtri(n, 0.025)) / n


def variance_change(e: Array) -> tuple[float, float]:
    """H(h) = Σ e² of the last third / Σ e² of the first, and its two-sided p value from F(h, h).

    Args:
        e: scored residuals only, shape (N,); h = N/3 rounded. H is kept within 1e-12 … 1e12.
    """
    from scipy.special import fdtr, fdtrc

    h = round(len(e) / 3)
    early, late = dot(e[:h], e[:h]), dot(e[len(e) - h :], e[len(e) - h :])
    if early == late:
        return 1.0, 1.0
    ratio = 1e12 if early == 0.0 else min(max(late / early, 1e-12), 1e12)
    return ratio, float(min(1.0, 2.0 * min(fdtr(h, h, ratio), fdtrc(h, h, ratio))))


def shape_of(e: Array) -> tuple[float, float]:
    """Skewness and excess kurtosis."""
    d = e - e.mean()
    largest = max(float(d.max()), -float(d.min()))
    if largest == 0.0:
        return 0.0, 0.0
    d /= largest  # fourth powers must neither overflow nor vanish
    d2 = d * d
    variance = float(d2.mean())
    return dot(d2, d) / len(e) / variance**1.5, dot(d2, d2) / len(e) / variance**2 - 3.0


def low_frequency_share(e: Array) -> tuple[float, float]:
    """Whether low frequencies are left: do means of blocks scatter more than those of white noise?

    One-way analysis of variance about 0 for blocks of 4, 8, 16 … samples; the block length with the smallest
    p value answers, and p is multiplied by the number of lengths tried (Bonferroni).

    Args:
        e: scored residuals only, shape (N,).

    Returns:
        Share of the variance of e between blocks, beyond that of white noise, 0 … 1; and p.
    """
    from scipy.special import fdtrc

    best, tried, length, means = (1.0, 0.0), 0, 1, e
    while True:
        pairs = len(means) // 2
        means = 0.5 * (means[: 2 * pairs : 2] + means[1 : 2 * pairs : 2])
        length *= 2
        blocks = len(means)
        if blocks < 4:
            break
        if length < MIN_BLOCK:
            continue
        tried += 1
        used = blocks * length
        total = dot(e[:used], e[:used])
        within = total - length * dot(means, means)
        if not 0.0 < within < total:
            continue
        noise = within / (used - blocks)
        p = float(fdtrc(blocks, used - blocks, (total - within) / blocks / noise))
        share = max(0.0, 1.0 - noise / (total / used))
        best = min(best, (p, -share))
    return -best[1], min(1.0, best[0] * max(tried, 1))


def spike_limits(e: Array) -> Array:
    """Size beyond which each residual is a spike, shape (N,): `SPIKE` local standard deviations.

    The scale is 1.4826 · median |e| in up to 16 stretches of at least 500 samples, so that neither a
    wrong r nor a slow change of the noise makes spikes.
    """
    limits = np.abs(e)
    for part in np.array_split(limits, min(max(len(e) // 500, 1), 16)):
        scale = 1.4826 * float(np.median(part)) if len(part) else 0.0
        rms = math.sqrt(dot(part, part) / max(len(part), 1))
        if scale <= 0.01 * rms:  # most of it is constant, or nearly
            scale = rms
        part.fill(SPIKE * scale or math.inf)
    return limits


def spike_chance(count: int, n: int) -> tuple[float, float]:
    """Expected spikes among n residuals of N(0, 1), and the probability of `count` or more (Poisson)."""
    from scipy.special import ndtr, pdtrc

    expected = 2.0 * n * float(ndtr(-SPIKE))
    return expected, float(pdtrc(count - 1, expected)) if count > 0 else 1.0


ALARM = 0.001
"""p-value below which a test reports a misfit."""

MAX_OUTLIERS = 0.1
"""Share of the residuals up to which spikes are outliers; more of them belong to the noise or to the signal. Spikes
widen the σ by which they are found: where 25 % are off by 60 σ, half of them are detected."""

MAX_REFUSED = 0.2
"""Share of the samples up to which those that a gate rejects are outliers."""

MIN_COUNT, CLEAR = 5, 5.0
"""Number of spikes that count whatever their size, and the size in σ from which fewer count."""

MAX_JOINED, SLOPE = 2, 50
"""Most jumps of one sign, each within this many samples of the one before, that may be steps; more are a slope."""

MAX_EXCURSION = 8
"""A signal that comes back within this many samples has not stepped: it was a longer spike."""


LONE, STAYS = 1, 2
"""What a spike was: the signal came back at once; or it stayed where it had gone."""


@compiled(plain=True)
def _find_spikes(v: Array, k: Array, limit: Array, kind: NDArray[np.int8], size: Array) -> None:
    """Mark in `kind` the innovations v beyond `limit` with LONE or STAYS, the rest with 0; steps go to `size`.

    A lone spike of size d leaves −k d in the next innovation, a jump that stays (1 − k) d; halfway between
    lies (½ − k) d. That tail dies away by 1 − k a sample and is taken off first, so it makes no new spikes.
    """
    n, tail = len(v), 0.0
    for i in range(n):
        d = v[i] - tail
        tail *= 1.0 - k[i]
        kind[i], size[i] = 0, d
        if abs(d) <= limit[i] + 0.25 * abs(tail):  # the tail is known only as well as k
            continue
        after = (v[i + 1] - tail) * math.copysign(1.0, d) if i + 1 < n else -math.inf
        if after > (0.5 - k[i]) * abs(d):
            kind[i] = STAYS
            tail += (1.0 - k[i]) * d
        else:
            kind[i] = LONE
            tail -= k[i] * d


@dataclass(frozen=True)
class Spikes:
    """Spikes among the N scored residuals."""

    at: Indices
    """Which residuals, largest first."""
    stays: Mask
    """Whether the signal stayed at its new level, one value a spike."""
    size: Array
    """Size in local σ, one value a spike."""
    off: Indices
    """Residuals of samples off the signal: the isolated spikes and all samples of the excursions, ascending."""
    start: float
    """Size in local σ of the first residual where a given start makes a spike of it, not among `at`; else 0."""

    @staticmethod
    def among(e: Array, k: Array, v: Array, s: Array, prior: bool) -> Spikes:
        """Spikes by `_find_spikes`; all arrays of shape (N,), scored samples only."""
        kind = np.empty(len(e), dtype=np.int8)
        limit = spike_limits(e)
        step = np.empty(len(e))
        reach = np.sqrt(s)
        reach *= limit
        _find_spikes(v, k, reach, kind, step)
        del reach
        start = SPIKE * abs(float(e[0])) / float(limit[0]) if prior and kind[0] else 0.0
        if start:
            kind[0] = 0
        within = _mark_excursions(kind, step)
        _unmark_slopes(kind, step)
        at = np.flatnonzero(kind)
        off = np.union1d(within, np.flatnonzero(kind == LONE))
        at = at[np.argsort(-np.abs(e[at]), kind="stable")]
        size = SPIKE * np.abs(e[at]) / limit[at]
        return Spikes(at, kind[at] == STAYS, size, off, start)

    @property
    def lone(self) -> int:
        """Spikes that did not stay."""
        return int(np.count_nonzero(~self.stays))

    @property
    def jumps(self) -> int:
        """Those that stayed."""
        return int(np.count_nonzero(self.stays))

    def too_many(self, n: int, lone: bool = False) -> bool:
        """Whether they, or the lone ones, are more than chance among n: by number, or one beyond 8 σ.

        A few just above the limit do not count: the local σ is known to a few percent only.
        """
        sizes = self.size[~self.stays] if lone else self.size
        expected, chance = spike_chance(len(sizes), n)
        many = chance < ALARM and len(sizes) > 3.0 * expected
        many = many and (len(sizes) >= MIN_COUNT or bool(sizes.max() > CLEAR))
        return many or bool(np.any(sizes > 2.0 * SPIKE))


def _mark_excursions(kind: NDArray[np.int8], step: Array) -> Indices:
    """Mark jumps that are soon undone as one lone spike; returns the samples off the signal, the first included."""
    marked = np.flatnonzero(kind)
    within: list[Indices] = []
    i = 0
    while i + 1 < len(marked):
        there, back = int(marked[i]), int(marked[i + 1])
        undone = step[there] * step[back] < 0.0 and abs(step[there] + step[back]) < 0.5 * abs(step[there])
        if kind[there] == STAYS and undone and back - there <= MAX_EXCURSION:
            kind[there], kind[back] = LONE, 0
            within.append(np.arange(there, back))
            i += 1
        i += 1
    return np.concatenate(within) if within else np.zeros(0, dtype=np.int64)


def _unmark_slopes(kind: NDArray[np.int8], step: Array) -> None:
    """Unmark three or more close jumps of one sign: the filter lags behind a slope, which is not a step."""
    jumps = np.flatnonzero(kind == STAYS)
    joined = (np.diff(jumps) <= SLOPE) & (np.diff(np.sign(step[jumps])) == 0.0)
    for run in np.split(jumps, np.flatnonzero(~joined) + 1):
        if len(run) > MAX_JOINED:
            kind[run] = 0
