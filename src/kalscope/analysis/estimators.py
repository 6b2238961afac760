"""The methods that estimate q and r, side by side, and which lie within the interval of maximum likelihood."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from numpy.typing import ArrayLike

from kalscope.common.progress import Progress
from kalscope.estimation.fit import estimate
from kalscope.estimation.methods import METHODS
from kalscope.estimation.request import METHOD_NAMES
from kalscope.estimation.result import Estimate

WITHOUT_NUMBERS = ("too_few", "constant", "bad_unit", "irregular")
"""Verdicts of a method that finds no numbers."""


def compare_methods(
    z: ArrayLike,
    dt: ArrayLike | None = None,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> tuple[Estimate, ...]:
    """All methods on one record, in the order of METHODS, without momentum and on all samples.

    Args:
        z: measurements, shape (n,); NaN is a missing sample.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        progress: called with the fraction done and a few words.
        cancelled: whether to stop.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z.
        Cancelled: `cancelled()` was true.
    """
    whole = Progress(progress, cancelled)
    return tuple(
        estimate(z, method, dt, whole.part(i / len(METHODS), (i + 1) / len(METHODS)), momentum=0.0, robust=False)
        for i, method in enumerate(METHODS)
    )


def is_within(one: Estimate, best: Estimate) -> bool | None:
    """Whether the q/r of a method lies in the 95 % interval of maximum likelihood; None where either has none."""
    if {one.verdict, best.verdict} & {*WITHOUT_NUMBERS}:
        return None
    low, high = best.ratio_interval
    return bool(low <= one.ratio <= high)


def comparison(estimates: Sequence[Estimate], momentum: float = 0.0) -> str:
    """How the methods compare, as sentences; "" where the record has no numbers to compare.

    Args:
        estimates: what `compare_methods` gave.
        momentum: of the filter that was chosen.
    """
    best, *others = estimates
    if momentum > 0.0:
        return "They need not agree here: all of them look for a signal without momentum."
    if best.verdict == "below_resolution":
        return "They need not agree here: the sensor rounds its readings to steps larger than the noise."
    within = {METHOD_NAMES[one.method]: is_within(one, best) for one in others}
    outside = ", ".join(name for name, inside in within.items() if inside is False)
    if outside:
        return (
            f"Outside the 95 % interval of maximum likelihood: {outside}. These use less of the record, so "
            "chance may explain it; so may a trend, an oscillation, spikes or slow noise, which the model lacks."
        )
    agree = "The q/r of every method lies within the 95 % interval of maximum likelihood."
    return agree if True in within.values() else ""
