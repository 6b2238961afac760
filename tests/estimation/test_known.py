"""q and r from a target, or from one of the two."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import FilterParams
from kalscope.estimation.fit import estimate, estimate_fixed_r, estimate_fixed_ratio
from kalscope.estimation.likelihood import log_likelihood

# --- a wish ---------------------------------------------------------------------------------------------


# --- one of the two is fixed ----------------------------------------------------------------------------


def test_fixed_r_finds_the_best_q_for_it(nile):
    found = estimate_fixed_r(nile, 10_000.0)
    assert (found.method, found.r) == ("fixed_r", pytest.approx(10_000.0))
    q = found.q * np.linspace(0.8, 1.2, 401)
    best = q[np.argmax([log_likelihood(nile, FilterParams(v, 10_000.0)) for v in q])]
    assert found.q == pytest.approx(best, rel=1.1e-3)
    assert found.loglik == pytest.approx(log_likelihood(nile, FilterParams(found.q, 10_000.0)), rel=1e-12)
    assert found.loglik < estimate(nile).loglik


def test_far_too_large_an_r_leaves_no_movement_and_far_too_small_an_r_takes_all_for_movement(nile):
    assert estimate_fixed_r(nile, 1e7).verdict == "no_movement"
    tiny = estimate_fixed_r(nile, 1e-30)
    assert tiny.verdict == "ok"
    assert tiny.q == pytest.approx(np.mean(np.diff(nile) ** 2), rel=1e-6)


def test_fixed_ratio_finds_the_best_r_for_it(nile):
    found = estimate_fixed_ratio(nile)
    assert found.ratio == pytest.approx(0.01)
    r = found.r * np.linspace(0.9, 1.1, 401)
    best = r[np.argmax([log_likelihood(nile, FilterParams(0.01 * v, v)) for v in r])]
    assert found.r == pytest.approx(best, rel=6e-4)
    assert "contradicts" in found.message  # 0.01 is outside the Nile's 0.0137 … 0.557
    assert "allows" in estimate_fixed_ratio(nile, 0.1).message
    assert found.params is not None
