"""`compare_methods`: all methods on one record, side by side, and what each second opinion is worth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from numpy.typing import ArrayLike

from kalscope.analysis.alternatives.agreement.weighing import spikes_in, weigh
from kalscope.analysis.alternatives.agreement.words import disagreement
from kalscope.common.progress import Progress
from kalscope.estimation.known import above_rounding
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.likelihood.search import Peak
from kalscope.estimation.methods import by_name
from kalscope.estimation.methods import maximum_likelihood as ml
from kalscope.estimation.methods.by_name import METHODS
from kalscope.estimation.methods.pair import Pair
from kalscope.estimation.result import Estimate
from kalscope.estimation.verdict.conclude import channel_fit, conclude, fit_record

_REASON = (
    "It contains more than a random walk and white noise: a trend, an oscillation, spikes or slow noise. "
    "Choose the filter by lag or cut-off rather than by estimation."
)


def compare_methods(
    z: ArrayLike,
    dt: ArrayLike | None = None,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> tuple[Estimate, ...]:
    """All methods on one record, in the order of METHODS; where they disagree, the first message says so.

    All fit the five-line filter, without momentum. Under that model they estimate the same two numbers. Where
    they differ by more than in records simulated under the first pair, the model does not describe the signal, and
    no pair can be trusted: `agreement` of each estimate says how likely its distance is, and `not_counted` why one
    that spikes or gaps mislead does not count.

    Args:
        z: measurements, shape (n,); NaN is a missing sample.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        progress: called with the fraction done and a few words.
        cancelled: whether to stop.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z.
        Cancelled: `cancelled()` was true.
    """
    others: dict[str, Estimate] = {}

    def fit(data: Differences, progress: Progress) -> Estimate:
        peak = ml.search(data, progress.part(0.0, 0.1))
        best, second = _opinions(data, peak, progress.part(0.1, 1.0))
        for one in second:
            others[one.method] = one
        found = disagreement([conclude("ml", data, best, peak), *second])
        reason = best.note or (_REASON if found else "")
        return conclude("ml", data, replace(best, note=f"{found} {reason}".strip()), peak)

    first = fit_record(z, dt, Progress(progress, cancelled), above_rounding(channel_fit("ml", fit)))
    return first, *(others.get(method) or replace(first, method=method) for method in METHODS[1:])


def _opinions(data: Differences, peak: Peak, progress: Progress) -> tuple[Pair, list[Estimate]]:
    """The maximum-likelihood pair of one channel, and what the other methods find, each weighed."""
    best = by_name.fit("ml", data, peak, progress)
    broken, second = spikes_in(data, best), list[Estimate]()
    for i, method in enumerate(METHODS[1:]):
        # EM's passes take most of the time.
        part = progress.part(*((0.0, 0.6) if method == "em" else (0.5 + 0.1 * i, 0.6 + 0.1 * i)))
        pair = by_name.fit(method, data, peak, part.part(0.0, 0.5))
        opinion = weigh(method, data, best, pair, broken, part.part(0.5, 1.0))
        one = conclude(method, data, pair, peak)
        second.append(replace(one, agreement=opinion.agreement, not_counted=opinion.not_counted))
    return best, second
