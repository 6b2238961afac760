"""What tests beyond the residuals of the whole record say: the second half, and what is too small to correct."""

from __future__ import annotations

import math

import numpy as np

from kalscope.analysis.diagnostics import Diagnostics
from kalscope.analysis.fit.correction import MIN_FACTOR
from kalscope.analysis.fit.spikes import ALARM
from kalscope.analysis.residual_tests import dot
from kalscope.common.text import correlation, number

CERTAIN = 4.0
"""Standard errors by which the second half must differ before this is reported."""

BLOCKS = 16
"""Blocks of the second half from whose scatter the standard error of its mean v²/s comes."""

BEYOND_CHANCE = 3.29
"""Standard errors that chance exceeds once in a thousand, as `ALARM`."""


def small_misfit(whole: Diagnostics, held_out: Diagnostics | None) -> str:
    """The first test that fails beyond chance though no misfit is worth correcting, as a clause; "" = none."""
    for what, one in (("squared errors are", whole), ("squared errors of the second half are", held_out)):
        if one is not None and abs(one.nis - 1.0) > BEYOND_CHANCE * math.sqrt(2.0 / max(one.n, 1)):
            return f"{what} {number(one.nis)} × what q and r predict"
    if whole.ljung_box_p < ALARM or abs(whole.r1) > BEYOND_CHANCE / 1.96 * whole.r1_bound or whole.slow_p < ALARM:
        return f"neighbouring residuals are slightly correlated ({correlation(whole.r1)})"
    if whole.variance_ratio_p < ALARM:
        return f"their variance in the last third is {number(whole.variance_ratio)} × that in the first"
    return ""


def held_out_clause(held_out: Diagnostics) -> str:
    """The size of the errors of the second half, without a verdict on it that the whole record could contradict."""
    if held_out.nis_low <= held_out.nis <= held_out.nis_high:
        return "squared errors are as large as q and r predict"
    size = f"squared errors are {number(held_out.nis)} × what q and r predict"
    if halves_differ(held_out):
        return f"{size}, on the first half {number(held_out.nis_before)} ×: the halves differ"
    if 1.0 / MIN_FACTOR < held_out.nis < MIN_FACTOR:
        return f"{size}, too little to matter"
    return f"{size}, {'as on the first half' if _is_alike(held_out) else 'but they scatter too much to tell why'}"


def _is_alike(held_out: Diagnostics) -> bool:
    """Whether the mean v²/s of both halves is the same within a factor that matters; both may be 0."""
    return held_out.nis_before / MIN_FACTOR <= held_out.nis <= held_out.nis_before * MIN_FACTOR


def halves_differ(held_out: Diagnostics) -> bool:
    """Whether the mean v²/s of the halves differs by a factor that matters and by more than its own scatter.

    The scatter is that of blocks, so heavy tails and changes within the half widen it; √2 because that of the first
    half is as uncertain.
    """
    e = held_out.e[np.isfinite(held_out.e)]
    if len(e) < 4 * BLOCKS or _is_alike(held_out):
        return False
    means = np.array([dot(part, part) / len(part) for part in np.array_split(e, BLOCKS)])
    error = math.sqrt(2.0 * float(means.var(ddof=1)) / BLOCKS)
    return abs(held_out.nis - held_out.nis_before) > CERTAIN * error
