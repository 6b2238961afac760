"""What is left in the residuals at the best q and r, and whether momentum describes it."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from kalscope.analysis.advice import Record, refilter, structure_sentence, variance_sentence
from kalscope.common.array import Array
from kalscope.common.text import number
from kalscope.filtering.steady_state import ratio_for

MOMENTA = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
"""Momenta that are tried, in sample periods."""

NEARER = (0.6, 1.0, 1.7)
"""Factors of the best of them that are tried next: advice needs no digits, the estimate gives them."""

LOGITS = np.arange(-5.0, 8.0)
"""Settled gains at which each is tried, as ln K/(1 - K): 0.007 … 0.999; next in steps of a quarter."""

QUARTERS = np.linspace(-1.0, 1.0, 9)

MIN_LOGLIK_GAIN = 6.0
"""Least gain in log-likelihood: the information criterion then wins by 10."""

MIN_GAIN_A_SAMPLE = 0.02
"""Least gain in log-likelihood a sample: 2 % of the error in predicting the next one."""


def misfit_sentence(record: Record, e: Array, lags: int, momentum: bool) -> str | None:
    """The structure in the residuals e, else a change of their variance, in words; None where there is neither.

    Args:
        record: the samples of the channel.
        e: residuals of the best q and r; with momentum those of the filter itself.
        lags: of the Ljung-Box test.
        momentum: whether the filter has momentum; else it is tried.
    """
    structure = structure_sentence(e, lags, momentum)
    if structure is None:
        return variance_sentence(e)
    return structure if momentum else structure + _momentum_words(record, lags)


def _momentum_words(record: Record, lags: int) -> str:
    """The end of the sentence where momentum describes the structure or part of it; else ""."""
    plain, at, _ = _best(record, (0.0,), LOGITS)
    plain, _, _ = _best(record, (0.0,), at + QUARTERS)
    _, at, momentum = _best(record, MOMENTA, LOGITS)
    best, at, momentum = _best(record, [momentum * factor for factor in NEARER], at + QUARTERS)
    _, chi2, m, e = _at(record, momentum, at)
    if best - plain <= max(MIN_LOGLIK_GAIN, MIN_GAIN_A_SAMPLE * m):
        return ""
    size = f"a momentum of about {number(momentum, 1)} samples"
    rest = structure_sentence(e / math.sqrt(chi2 / m), lags, momentum=True)
    return f"; try {size}" if rest is None else f"; {size} explains part of it"


def _best(record: Record, momenta: Iterable[float], logits: Array) -> tuple[float, float, float]:
    """The largest log-likelihood with the scale solved for, less a constant; the logit and the momentum it has."""
    return max((_loglik(*_at(record, tau, at)), at, tau) for tau in momenta for at in logits.tolist())


def _at(record: Record, momentum: float, logit: float) -> tuple[float, float, int, Array]:
    """The record filtered with a momentum and a settled gain."""
    return refilter(record, ratio_for(gain=1.0 / (1.0 + math.exp(-logit)), momentum=momentum), 1.0, momentum)


def _loglik(logdet: float, chi2: float, m: int, _: Array) -> float:
    return -0.5 * (logdet + m * math.log(chi2)) if chi2 > 0.0 else -math.inf
