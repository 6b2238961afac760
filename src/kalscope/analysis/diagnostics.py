"""Diagnostics: does the filter fit the record, and what to change if it does not?

If q and r are right, the standardised innovations e = v/√s are independent draws from N(0, 1). Everything
here tests for deviations from that, and says the most important one in words.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.analysis import residuals as tests
from kalscope.analysis.correction import MIN_SAMPLES, finite
from kalscope.analysis.findings import Evidence, Known, advice_text, find_evidence, findings_of
from kalscope.analysis.residuals import Columns, Run, Spikes
from kalscope.common.numbers import Array, Indices, ShortRepr
from kalscope.common.text import correlation, count, number, p_value, percent
from kalscope.errors import BadSetting
from kalscope.filtering.filter import FilterResult, was_rejected
from kalscope.filtering.params import FilterParams, samples_of

Fit = Callable[[Array, Array | None], FilterParams]

MAX_RESIDUAL = 1e60
"""Residuals are clipped here, so that their fourth powers stay finite."""


ANY_NIS = 1e12
"""Upper end of the band of the mean NIS where too few innovations are scored to expect anything."""


@dataclass(frozen=True, repr=False)
class Diagnostics(ShortRepr):
    """How one channel's innovations differ from white noise N(0, 1). No number is ever NaN.

    With too few samples every statistic has the value that a perfect filter would show.
    """

    e: Array
    """Standardised innovations v/√s, shape (n,) as z; NaN where none was scored (missing, refused, start)."""
    n: int
    """Scored innovations, N below."""
    advice: str
    """One or two sentences: what to change, "no misfit worth correcting", or "too few samples to judge …"."""
    correlation: Array = field(default_factory=lambda: np.zeros(1))
    """Autocorrelation r_1 … r_h of e, shape (h,); pairs across a gap are left out."""
    r1: float = 0.0
    """Lag-1 autocorrelation, −1 … 1; above 0 the filter is too slow, below 0 too fast."""
    r1_bound: float = 1.0
    """95 % bound on |r1|, 1.96/√N."""
    ljung_box: float = 0.0
    """Ljung-Box Q(h) of the h lags, ≥ 0."""
    ljung_box_p: float = 1.0
    """Its p value, 0 … 1."""
    nis: float = 1.0
    """Mean of e² (normalised innovation squared): above 1 the errors are larger than q and r predict. 1 by
    construction on the record that q and r were fitted to; see `diagnose_held_out`."""
    nis_low: float = 0.0
    """Lower end of the 95 % band of `nis`."""
    nis_high: float = ANY_NIS
    """Upper end of it."""
    spikes: int = 0
    """Scored innovations beyond 4 local σ (1.4826 · median |e|), jumps included; not the tail after one. A signal
    that comes back within 8 samples is one spike."""
    spikes_expected: float = 0.0
    """How many of N white ones are expected there, 6.3e-5 N."""
    spike_indices: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Sample numbers of the largest spikes, at most 20, largest first."""
    jumps: int = 0
    """Those of `spikes` after which the signal stayed at its new level."""
    variance_ratio: float = 1.0
    """H(h): Σ e² of the last third over that of the first, > 0."""
    variance_ratio_p: float = 1.0
    """Its two-sided p value, from F(h, h)."""
    skewness: float = 0.0
    """Skewness of e."""
    excess_kurtosis: float = 0.0
    """Kurtosis of e, less 3."""
    slow_share: float = 0.0
    """Low-frequency share of the variance of e, beyond that of white noise, 0 … 1."""
    slow_p: float = 1.0
    """Its p value."""
    q_factor: float = 1.0
    """Advised factor for q, by likelihood; 1 = keep."""
    r_factor: float = 1.0
    """Advised factor for r; 1 = keep."""
    nis_before: float = 1.0
    """Of `diagnose_held_out`: the mean of e² on the first half; 1 where that is not known."""
    evidence: Evidence = field(default_factory=lambda: Evidence(0))
    """The evidence against the filter, for `analysis.judge`; found in all samples."""


def diagnose(
    result: FilterResult, lags: int | None = None, fitted: bool = False
) -> Diagnostics | tuple[Diagnostics, ...]:
    """Judge a filter by its innovations.

    Args:
        result: what `kalman_filter` gave.
        lags: h of the Ljung-Box test, ≥ 1; None = √N rounded, 4 to 20.
        fitted: q and r were estimated from this record: the Ljung-Box test then has h − 1 degrees of
            freedom, and `nis` is 1 by construction.

    Returns:
        Diagnostics of the channel; for a 2-D z a tuple of one a channel.

    Raises:
        BadSetting: lags is below 1.

    Source: Durbin & Koopman (2012), section 2.12; Bar-Shalom et al. (2001), section 5.4; Mehra (1970).
    """
    if result.x.ndim == 1:
        return diagnose_run(Run.of_result(result), lags, fitted)
    return tuple(diagnose_run(Run.of_result(result, c), lags, fitted) for c in range(result.x.shape[1]))


def diagnose_held_out(z: ArrayLike, fit: FilterParams | Fit, dt: ArrayLike | None = None) -> Diagnostics:
    """Judge q and r on the second half of a record, which the fit has not seen.

    On the samples that q and r were fitted to, the mean of e² is 1 whatever the record; on the second half it
    is a test.

    Args:
        z: measurements, shape (n,); NaN is a missing sample.
        fit: the parameters, or a function of (z, dt of the first half) that gives them, such as
            `lambda z, dt: estimate(z, dt=dt).params`.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.

    Returns:
        Diagnostics of the second half; `e` has the shape of that half and `spike_indices` count in z.

    Raises:
        BadSetting: z is not 1-D or holds inf; dt does not fit z; whatever `fit` raises.
    """
    samples = samples_of(z)
    if samples.ndim != 1:
        raise BadSetting(f"z must have shape (n,) (got {samples.shape})")
    steps = None if dt is None else np.asarray(dt, dtype=np.float64)
    half = len(samples) // 2
    params = fit if isinstance(fit, FilterParams) else fit(samples[:half], None if steps is None else steps[:half])
    whole = Run.of_samples(samples, params, steps)
    judged = diagnose_run(whole.part(half, whole.n), first=half)
    before = finite(_scores(whole.part(0, half))[0])
    return replace(judged, nis_before=tests.dot(before, before) / len(before)) if before.any() else judged


def diagnose_run(run: Run, lags: int | None = None, fitted: bool = False, *, first: int = 0) -> Diagnostics:
    """`diagnose` of one channel, whose filter output need not be stored.

    Args:
        run: the filter over the channel.
        lags: as for `diagnose`.
        fitted: as for `diagnose`.
        first: index of its first sample in the record; 0 = it is the first, and may follow a given start.
    """
    if lags is not None and not (isinstance(lags, int) and lags >= 1):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise BadSetting(f"lags must be a whole number of at least 1 (got {lags})")
    e, (k, v, s), refusals, prior = _scores(run)
    seen = np.flatnonzero(np.isfinite(e))
    n, scored = len(seen), _values_at(e, seen)
    known = Known(estimated=fitted, momentum_searched=fitted and run.momentum > 0.0)
    if n < MIN_SAMPLES:
        few = Evidence(n, momentum=run.momentum > 0.0)
        return Diagnostics(e=e, n=n, advice=advice_text(findings_of(few, known)), evidence=few)
    spikes = Spikes.among(scored, k, v, s, prior and not first)
    del k, v, s
    h = lags or min(max(round(math.sqrt(n)), 4), 20)
    white = tests.correlation(e, h, fitted)
    nis_low, nis_high = tests.nis_band(n)
    variance_ratio, variance_ratio_p = tests.variance_change(scored)
    skewness, excess = tests.shape_of(scored)
    slow_share, slow_p = tests.low_frequency_share(scored)
    evidence = find_evidence(run, seen, scored, spikes, refusals, h)
    return Diagnostics(
        e=e,
        n=n,
        advice=advice_text(findings_of(evidence, known)),
        correlation=white.r,
        r1=float(white.r[0]),
        r1_bound=white.bound,
        ljung_box=white.q,
        ljung_box_p=white.p,
        nis=tests.dot(scored, scored) / n,
        nis_low=nis_low,
        nis_high=nis_high,
        spikes=len(spikes.at),
        spikes_expected=tests.spike_chance(0, n)[0],
        spike_indices=seen[spikes.at[:20]] + first,
        jumps=spikes.jumps,
        variance_ratio=variance_ratio,
        variance_ratio_p=variance_ratio_p,
        skewness=skewness,
        excess_kurtosis=excess,
        slow_share=slow_share,
        slow_p=slow_p,
        q_factor=evidence.correction.q_factor,
        r_factor=evidence.correction.r_factor,
        evidence=evidence,
    )


def _values_at(e: Array, at: Indices) -> Array:
    """The residuals at ascending indices; a view where these are consecutive, which takes no memory."""
    in_a_row = len(at) > 0 and at[-1] - at[0] == len(at) - 1
    return e[at[0] : at[0] + len(at)] if in_a_row else e[at]


def without_residuals(one: Diagnostics) -> Diagnostics:
    """The same without its arrays of all samples, to be kept: no view shows each residual."""
    correction = replace(one.evidence.correction, e=None)
    return replace(one, e=np.empty(0), evidence=replace(one.evidence, correction=correction))


def _standardised(columns: Columns) -> Array:
    """Innovations over √s, NaN where none was scored: missing, the start, refused (k = 0 though p > 0)."""
    _, p, k, v, s = columns
    with np.errstate(all="ignore"):
        e = v / np.sqrt(s)
    e[~((s > 0.0) & np.isfinite(s) & ((k > 0.0) | (p == 0.0)))] = math.nan
    return np.clip(e, -MAX_RESIDUAL, MAX_RESIDUAL, out=e)


def _scores(run: Run) -> tuple[Array, Array, Indices, bool]:
    """The standardised innovations, and what the search for spikes needs of the scored ones, N of them.

    Returns:
        e, shape (n,); gain, innovation and its variance of the scored samples, shape (3, N); the samples that the
        gate rejected, ascending; whether the first sample was scored: x0 was given, and no sample set the start.
    """
    e, rows, count = np.empty(run.n), np.empty((3, run.n)), 0
    refused, prior = [np.zeros(0, dtype=np.int64)], None
    for first, columns in run.pieces():
        _, p, k, v, s = columns
        piece = _standardised(columns)
        e[first : first + len(piece)] = piece
        scored = np.isfinite(piece)
        end = count + int(np.count_nonzero(scored))
        for row, column in zip(rows, (k, v, s), strict=True):
            row[count:end] = column[scored]
        count = end
        refused.append(first + np.flatnonzero(was_rejected(k, p, v)))
        met = (k > 0.0) | np.isfinite(v)
        if prior is None and met.any():
            prior = bool(np.isfinite(v[np.argmax(met)]))
    return e, rows[:, :count], np.concatenate(refused), bool(prior)


def expected_nis(d: Diagnostics) -> str:
    """The 95 % band of the mean NIS in words."""
    return f"{number(d.nis_low)} to {number(d.nis_high)}" if d.nis_high < ANY_NIS else "any value: too few samples"


def residual_rows(d: Diagnostics) -> tuple[tuple[str, str, str], ...]:
    """Each test of the residuals: its name, what was measured, and what a filter that fits would show."""
    jumps = f", {count(d.jumps)} of them jumps" if d.jumps else ""
    shape, change = f"{number(d.skewness)}, {number(d.excess_kurtosis)}", f"variance × {number(d.variance_ratio)}"
    return (
        ("Size: mean of v²/s (NIS)", number(d.nis), expected_nis(d)),
        ("Lag‑1 autocorrelation", correlation(d.r1), f"within ±{correlation(d.r1_bound)}"),
        ("Ljung-Box over several lags", p_value(d.ljung_box_p), "p above 0.05"),
        ("Spikes beyond 4 σ", f"{count(d.spikes)}{jumps}", f"about {number(d.spikes_expected, 2)}"),
        ("Low-frequency share", f"{percent(d.slow_share)}, {p_value(d.slow_p)}", "p above 0.05"),
        ("Last third compared with first", f"{change}, {p_value(d.variance_ratio_p)}", "p above 0.05"),
        ("Skewness, excess kurtosis", shape, "0, 0"),
    )
