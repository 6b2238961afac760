"""A median of a few samples before the present filter, or before the best other one, where that lowers the error.

It takes out spikes before a filter smears them, for a sample or two more lag. So it is compared as it is, not at
equal lag, and only where it does more than a smaller q would, which costs the same lag.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from kalscope.analysis.alternatives.rows import Alternative, Stretch
from kalscope.analysis.alternatives.verdict import Difference, difference, interval_words, percent_of
from kalscope.common.array import Array
from kalscope.common.text import plural
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.response import chain_response
from kalscope.filtering.classic.stages import Median
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.steady_state import SteadyState, ratio_for

WINDOWS = (3, 5)
"""Windows of the median that are tried, samples."""

MIN_GAIN = 1e-3
"""A median that lowers the error by less is not worth a row; prediction errors are mostly the noise of the next
sample."""

BEFORE_PRESENT, BEFORE_BEST = "Median, then Kalman", "Median, then the best"
"""Names of the rows: before the present filter, and before the best other one."""


@dataclass(frozen=True)
class HelpfulMedian:
    """A median before a filter that it helps."""

    row: Alternative
    """Both, over the stretch."""
    words: str = ""
    """What the verdict says of it, with a leading space."""


def helpful_medians(others: tuple[Alternative, ...], stretch: Stretch) -> tuple[HelpfulMedian, ...]:
    """The medians that help: before the present filter, and before the best of the others if that does better.

    Args:
        others: The candidates.
        stretch: What is compared.
    """
    better = [one for one in others if one.matched and one.chain and one.against and one.against.better]
    best = min(better, key=lambda one: one.against.ratio if one.against else 1.0, default=None)
    bases = [(BEFORE_PRESENT, stretch.present)] + ([] if best is None else [(BEFORE_BEST, best)])
    tried = (_median_before(name, one, stretch) for name, one in bases)
    return tuple(one for one in tried if one is not None)


def _median_before(name: str, base: Alternative, stretch: Stretch) -> HelpfulMedian | None:
    """The better of the medians before `base`, or None where none helps it."""
    then = base.chain.then if base.chain else None
    errors, best = stretch.errors, None
    own = errors.squared(base.curve)
    for chain in () if isinstance(then, Median) else (Chain(window, then) for window in WINDOWS):
        curve = stretch.run(chain)
        found = _better(errors.squared(curve), own, stretch)
        if found is None or (best and best[0].ratio < found.ratio):
            continue
        steady = chain_response(chain, stretch.params, (errors.z, base.curve))
        if _better(errors.squared(curve), errors.squared(_as_slow(steady.lag_samples, stretch)), stretch):
            best = found, chain, curve, steady
    if best is None:
        return None
    found, chain, curve, steady = best
    later = plural(float(f"{steady.lag_samples - base.lag_samples:.2g}"), "sample")
    row = replace(_row(base, chain, curve, steady, stretch), name=name, sentence=_sentence(chain, later))
    less = f"{percent_of(found.ratio)} smaller ({interval_words(found)})"
    said = (
        f" With a median of {chain.median} before your filter its {errors.words} is {less}, for {later} more lag."
    )
    return HelpfulMedian(row, said if base is stretch.present else "")


def _better(error: Array, than: Array, stretch: Stretch) -> Difference | None:
    """The difference of squared errors where it is significantly for the better and worth a row."""
    found = difference(error, than, stretch.memory, 2 * len(WINDOWS))
    return found if found.better and found.ratio < 1.0 - MIN_GAIN else None


def _as_slow(lag: float, stretch: Stretch) -> Array:
    """The present filter with a smaller q, so that it lags as much: a median must do more than slow it down."""
    params = stretch.params
    ratio = ratio_for(lag_samples=lag, momentum=params.momentum)
    return kalman_filter(stretch.errors.z, replace(params, q=ratio * float(params.r)), stretch.steps).x


def _sentence(chain: Chain, later: str) -> str:
    spikes = "one sample" if chain.median == WINDOWS[0] else f"up to {chain.median // 2} samples"
    return f"The median takes out spikes of {spikes} before the filter sees them, for {later} more lag."


def _row(base: Alternative, chain: Chain, curve: Array, steady: SteadyState, stretch: Stretch) -> Alternative:
    """The row of `base`, as the median changes it."""
    errors, window, then = stretch.errors, chain.median, chain.then
    return replace(
        base,
        parameters=f"window of {window}"
        + (f", {then.name[:1].lower()}{then.name[1:]}: {then.words}" if then else ""),
        chain=chain,
        curve=curve,
        lag_samples=steady.lag_samples,
        noise_reduction_db=steady.noise_reduction_db,
        rmse=errors.rmse(curve),
        prediction=errors.prediction(curve),
        roughness=errors.roughness(curve),
        start_samples=base.start_samples + window,
        memory=base.memory + Median(window).memory,
        against=difference(
            errors.squared(curve), errors.squared(stretch.present.curve), stretch.memory, 2 * len(WINDOWS)
        ),
    )
