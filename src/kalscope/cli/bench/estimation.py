"""The contests of estimation: the fit against statsmodels' fit, the profile over λ against one pass at one λ."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np

from kalscope.cli.bench.contest import Contest, Row, Sizes, Work, missing
from kalscope.cli.bench.own import five_lines
from kalscope.filtering.batch import kalman_filter
from kalscope.filtering.params import FilterParams

FIT = "statsmodels llevel fit"


def estimation_contests(work: Work, sizes: Sizes) -> Iterator[Contest | Row]:
    """Both on 100,000 samples."""
    some = work.first(sizes.at_most(100_000))
    for name, module, build in PARTS:
        part = getattr(importlib.import_module(module), name, None) if find_spec(module) else None
        if part is not None:
            yield build(part, some)


def _fit_contest(estimate: Any, work: Work) -> Contest | Row:
    ours_name = 'estimate(method="ml")'
    try:
        components = importlib.import_module("statsmodels.api").tsa.UnobservedComponents
    except ImportError:
        return missing(FIT, ours_name)
    best = float(estimate(work.z, method="ml").loglik)

    def their_fit() -> FilterParams:
        r, q = components(work.z, "llevel").fit(disp=0).params
        return FilterParams(q=float(q), r=float(r))

    def lost(result: Any) -> float:
        return (best - float(kalman_filter(work.z, result).loglik)) / abs(best)

    return Contest(
        FIT,
        ours_name,
        len(work.z),
        their_fit,
        lambda: estimate(work.z, method="ml"),
        lost,
        "difference: what their q and r lose of the exact log-likelihood, relative",
        repetitions=3,
    )


def _profile_contest(likelihood_profile: Any, work: Work) -> Contest:
    out = np.empty_like(work.z)

    def difference(profile: Any) -> float:
        at = np.linspace(0, len(profile.log_ratios) - 1, 7).astype(int)
        pairs = [(float(np.exp(profile.log_ratios[i]) * profile.r[i]), float(profile.r[i])) for i in at]
        exact = np.array([kalman_filter(work.z, FilterParams(q=q, r=r)).loglik for q, r in pairs])
        return float(np.max(np.abs(profile.loglik[at] - exact) / np.abs(exact)))

    return Contest(
        "likelihood_profile, 121 λ",
        "five lines, numba",
        len(work.z),
        lambda: likelihood_profile(work.z),
        lambda: five_lines(work.z, work.q, work.r, out),
        difference,
        "against a single pass at one λ; difference: relative to kalman_filter's log-likelihood at 7 of the λ",
    )


PARTS = (
    ("estimate", "kalscope.estimation", _fit_contest),
    ("likelihood_profile", "kalscope.estimation.likelihood.profile", _profile_contest),
)
"""What is timed, where it is defined, and its contest; a part that is not there has no row."""
