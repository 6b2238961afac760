from __future__ import annotations

import numpy as np
import pytest

from kalscope.common import numbers
from kalscope.common.numbers import centred_median


@pytest.mark.parametrize("window", [1, 3, 5, 11])
@pytest.mark.parametrize("n", [1, 2, 4, 100, 1000])
def test_it_is_that_of_scipy(n, window, monkeypatch):
    from scipy.ndimage import median_filter

    monkeypatch.setattr(numbers, "_ROWS", 64)  # several portions
    rng = np.random.default_rng(n + window)
    for values in (rng.normal(size=n), rng.integers(0, 3, n).astype(float)):
        assert np.array_equal(centred_median(values, window), median_filter(values, window, mode="nearest"))


def test_of_nothing_it_is_nothing():
    assert centred_median(np.empty(0), 5).shape == (0,)
