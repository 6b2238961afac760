from __future__ import annotations

import numpy as np
import pytest

from kalscope.estimation.kernels import median_distances


@pytest.mark.parametrize("window", [1, 3, 5, 11])
@pytest.mark.parametrize("n", [0, 1, 2, 4, 100, 1000])
def test_distances_are_those_from_the_median_filter_of_scipy(n, window):
    from scipy.ndimage import median_filter

    rng, away = np.random.default_rng(n + window), np.empty(n)
    for values in (rng.normal(size=n), rng.integers(0, 3, n).astype(float)):
        median_distances(values, window, away)
        assert np.array_equal(away, np.abs(values - median_filter(values, window, mode="nearest")) if n else away)
