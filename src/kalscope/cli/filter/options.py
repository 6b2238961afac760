"""The parameters of the filter as options of `kalscope filter`."""

from __future__ import annotations

import math
from typing import Annotated, Any

from kalscope.cli.options import SensorNumbers, number, number_option, number_or, number_or_each, text_option


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
) -> dict[str, Any]:
    """The options in place of the parameter `given` of the command; see `with_options`."""
    options = {"q": q, "p0": p0, "x0": x0, "gate": gate, "momentum": momentum}
    # NaN is the word for an automatic start, which the filter's parameters write as None.
    given: dict[str, Any] = {
        name: None if math.isnan(one) else one for name, one in options.items() if one is not None
    }
    if r is not None:
        given["r"] = r.each
    if chain is not None:
        from kalscope.tuning.chain_text import typed_chain

        given["chain"] = typed_chain(chain)
    return given
