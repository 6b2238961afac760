"""The parameters of the filter as options of `kalscope filter`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

from kalscope.cli.options import SensorNumbers, number, number_option, number_or, number_or_each


@dataclass(frozen=True)
class GivenParams:
    """Parameters that options give, in place of those of the tuning file."""

    values: dict[str, float | None] = field(default_factory=dict[str, float | None])
    """By name, those that were given; None is an automatic start."""
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
) -> GivenParams:
    """The options in place of the parameter `given` of the command; see `with_options`."""
    each = r.each if r is not None and isinstance(r.each, dict) else {}
    for_all = r.each if r is not None and isinstance(r.each, float) else None
    options = {"q": q, "r": for_all, "p0": p0, "x0": x0, "gate": gate, "momentum": momentum}
    # NaN is the word for an automatic start, which the filter's parameters write as None.
    given = {name: None if math.isnan(value) else value for name, value in options.items() if value is not None}
    return GivenParams(given, each)
