"""The parameters of the filter as options of `kalscope filter`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

from kalscope.cli.options import SensorNumbers, number, number_option, number_or, number_or_each, text_option

if TYPE_CHECKING:
    from kalscope.tuning.choose import Given


@dataclass(frozen=True)
class GivenParams:
    """Parameters that options give, in place of those of the tuning file."""

    values: Given = field(default_factory=dict[str, Any])
    """By name, those that were given; None is an automatic start, or no chain."""
    r_of_each: dict[str, float] = field(default_factory=dict[str, float])
    """r of each of several fused sensors, in place of the one for all."""


NOTHING = GivenParams()


def params_options(
    q: Annotated[float | None, number_option("Process-noise variance per sample, unit².", number)] = None,
    r: Annotated[
        SensorNumbers | None,
        number_option(
            "Measurement-noise variance, unit²; of fused sensors also each: a=4,b=9.", number_or_each(number)
        ),
    ] = None,
    p0: Annotated[
        float | None, number_option('Initial variance, unit², or "diffuse".', number_or("diffuse"))
    ] = None,
    x0: Annotated[
        float | None, number_option('Initial value, or "first": the first sample.', number_or("first"))
    ] = None,
    gate: Annotated[
        float | None, number_option('Outlier gate on v²/s, such as 9, or "off".', number_or("off"))
    ] = None,
    momentum: Annotated[
        float | None, number_option("How long the signal keeps its direction, in sample periods.", number)
    ] = None,
    chain: Annotated[
        str | None, text_option("FILTERS", 'Filters to run, such as "median 5, kalman" or "one-euro 0.02 0.7 0.1".')
    ] = None,
) -> GivenParams:
    """The options in place of the parameter `given` of the command; see `with_options`."""
    each = r.each if r is not None and isinstance(r.each, dict) else {}
    for_all = r.each if r is not None and isinstance(r.each, float) else None
    options = {"q": q, "r": for_all, "p0": p0, "x0": x0, "gate": gate, "momentum": momentum}
    # NaN is the word for an automatic start, which the filter's parameters write as None.
    given: Given = {name: None if math.isnan(one) else one for name, one in options.items() if one is not None}
    if chain is not None:
        from kalscope.tuning.chain_text import typed_chain

        given["chain"] = typed_chain(chain)
    return GivenParams(given, each)
