"""Standard errors of q and r where momentum is estimated too; test_momentum_coverage.py counts what they cover."""

from __future__ import annotations

import math

import pytest

from kalscope.estimation.momentum import widened


def test_a_variance_that_does_not_depend_on_the_momentum_keeps_its_error():
    assert widened(4.0, 0.5, [4.0, 4.0]) == pytest.approx(0.5, rel=1e-12)


def test_a_variance_that_rises_with_the_momentum_is_less_certain():
    """Without an error of its own, from half to twice its size: one interval of ± ln 2."""
    assert widened(4.0, 0.0, [2.0, 8.0]) == pytest.approx(4.0 * math.log(2.0) / 1.959964, rel=1e-6)
    assert widened(4.0, 0.5, [2.0, 8.0]) > widened(4.0, 0.5, [3.0, 5.0]) > 0.5


@pytest.mark.parametrize(("value", "ends"), [(4.0, [0.0, 8.0]), (0.0, [0.0, 0.0])])
def test_a_variance_that_may_be_none_has_no_finite_error(value, ends):
    assert widened(value, 0.5, ends) == math.inf
