from __future__ import annotations

import numpy as np
import pytest

from kalscope.estimation.methods import not_negative


@pytest.mark.parametrize("scale", [1e-60, 1.0, 1e60])
def test_the_pair_without_negative_parts_is_that_of_scipy(scale):
    from scipy.optimize import nnls

    rng, seen = np.random.default_rng(5), set()
    for _ in range(300):
        a = rng.normal(size=(rng.integers(2, 40), 2))
        b = a @ rng.normal(size=2) + rng.choice([0.0, 0.3, 10.0]) * rng.normal(size=len(a))
        wanted, _ = nnls(a, b)
        found = np.multiply(not_negative(scale * a, b), scale)
        assert found == pytest.approx(wanted, rel=1e-9, abs=1e-12)
        seen.add(tuple(found > 0.0))
    assert len(seen) == 4  # both, either, none


def test_a_column_of_zeros_has_no_part():
    assert not_negative(np.array([[0.0, 1.0], [0.0, 1.0]]), np.array([2.0, 4.0])) == pytest.approx((0.0, 3.0))
