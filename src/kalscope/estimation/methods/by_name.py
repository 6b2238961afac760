"""The methods by their names, one way to call all of them."""

from __future__ import annotations

import math
from dataclasses import replace

from kalscope.common.progress import Progress
from kalscope.common.text import number
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.likelihood.search import Peak
from kalscope.estimation.methods import allan, expectation_maximization, innovation_correlations, moments
from kalscope.estimation.methods import maximum_likelihood as ml
from kalscope.estimation.methods.pair import Pair

METHODS = ("ml", "em", "moments", "als", "allan")
"""The methods of `estimate`, in the order in which `compare_methods` shows them."""

QUICK = {"moments": moments.fit, "als": innovation_correlations.fit, "allan": allan.fit}
"""The methods that use other properties of the record than its likelihood: from the record to a pair."""


def fit(method: str, data: Differences, peak: Peak, progress: Progress) -> Pair:
    """The pair that a method of METHODS finds; `peak` is that of the likelihood."""
    if method == "ml":
        return replace(ml.fit(data, peak), note=moments.what_differences_say(data))
    if method == "em":
        return _climbed(data, peak, progress)
    progress(0.0, method)
    return QUICK[method](data)


def _climbed(data: Differences, peak: Peak, progress: Progress) -> Pair:
    """EM's pair, with the errors of the likelihood that it climbs."""
    pair = expectation_maximization.fit(data, progress)
    top = ml.fit(data, peak)
    if math.isfinite(peak.log_ratio):
        return replace(pair, q_se=top.q_se, r_se=top.r_se)  # the same likelihood has the same curvature
    # EM approaches an edge but never reaches it.
    stopped = f"EM approaches this edge slowly and stopped at q/r = {number(pair.q / pair.r)}." if pair.r else ""
    return replace(top, note=stopped)
