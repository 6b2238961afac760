"""A median of a few samples before the present filter, or before the best other one, where that lowers the error.

It takes out spikes before a filter smears them, for a sample or two more lag. So it is compared as it is, not at
equal lag, and only where the recording has something for it to take out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from kalscope.analysis.alternatives.rows import Alternative, Stretch, decibels_of
from kalscope.analysis.alternatives.verdict import difference, interval_words, percent_of
from kalscope.common.array import Array
from kalscope.common.text import plural
from kalscope.filtering.classic.bench import Bench
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.chain_filter import ChainFilter
from kalscope.filtering.classic.stages import Median

WINDOWS = (3, 5)
"""Windows of the median that are tried, samples."""

MIN_GAIN = 1e-3
"""A median that lowers the error by less is not worth a row; errors in predicting are mostly noise of the next."""

BEFORE_PRESENT, BEFORE_BEST = "Median, then Kalman", "Median, then the best"
"""Names of the rows: before the present filter, and before the best other one."""


@dataclass(frozen=True)
class HelpfulMedian:
    """A median before a filter that it helps."""

    row: Alternative
    """Both, over the stretch."""
    words: str = ""
    """What the verdict says of it, with a blank before it."""


def helpful_medians(others: tuple[Alternative, ...], stretch: Stretch, bench: Bench) -> tuple[HelpfulMedian, ...]:
    """The medians that help: before the present filter, and before the best of the others if that does better.

    Args:
        others: The candidates.
        stretch: What is compared.
        bench: Noise and speed of the recording.
    """
    better = [one for one in others if one.matched and one.chain and one.against and one.against.better]
    best = min(better, key=lambda one: one.against.ratio if one.against else 1.0, default=None)
    bases = [(BEFORE_PRESENT, stretch.present)] + ([] if best is None else [(BEFORE_BEST, best)])
    tried = (_median_before(name, one, stretch, bench) for name, one in bases)
    return tuple(one for one in tried if one is not None)


def _median_before(name: str, base: Alternative, stretch: Stretch, bench: Bench) -> HelpfulMedian | None:
    """The better of the medians before `base`, or None where none helps it."""
    then = base.chain.then if base.chain else None
    errors, best = stretch.errors, None
    own = errors.squared(base.curve)
    for chain in () if isinstance(then, Median) else (Chain(window, then) for window in WINDOWS):
        curve = stretch.run(chain)
        found = difference(errors.squared(curve), own, stretch.memory, 2 * len(WINDOWS))
        if found.better and found.ratio < (best[0].ratio if best else 1.0 - MIN_GAIN):
            best = found, chain, curve
    if best is None:
        return None
    found, chain, curve = best
    row = _row(name, base, chain, curve, stretch, bench)
    less = f"{percent_of(found.ratio)} smaller ({interval_words(found)})"
    later = added_lag(row, base)
    said = (
        f" With a median of {chain.median} before your filter its {errors.words} is {less}, for {later} more lag."
    )
    return HelpfulMedian(row, said if base is stretch.present else "")


def _row(name: str, base: Alternative, chain: Chain, curve: Array, stretch: Stretch, bench: Bench) -> Alternative:
    errors, window, then = stretch.errors, chain.median, chain.then
    run = ChainFilter(chain, stretch.params).denoise
    spikes = "one sample" if window == WINDOWS[0] else f"up to {window // 2} samples"
    row = replace(
        base,
        name=name,
        parameters=f"window of {window}"
        + (f", {then.name[:1].lower()}{then.name[1:]}: {then.words}" if then else ""),
        chain=chain,
        curve=curve,
        lag_samples=bench.lag(run),
        noise_reduction_db=decibels_of(bench.noise_gain(run)),
        rmse=errors.rmse(curve),
        prediction=errors.prediction(curve),
        roughness=errors.roughness(curve),
        start_samples=base.start_samples + window,
        memory=base.memory + Median(window).memory,
        against=difference(
            errors.squared(curve), errors.squared(stretch.present.curve), stretch.memory, 2 * len(WINDOWS)
        ),
    )
    sentence = (
        f"The median takes out spikes of {spikes} before the filter sees them, for {added_lag(row, base)} more lag."
    )
    return replace(row, sentence=sentence)


def added_lag(row: Alternative, base: Alternative) -> str:
    """How much the median adds, in words."""
    return plural(float(f"{row.lag_samples - base.lag_samples:.2g}"), "sample")
