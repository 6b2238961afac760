"""The noise that the 4 σ rule takes away from good samples: its closed form against the rule itself."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope.estimation.spikes import kept_variance


@pytest.mark.parametrize("sigmas", [1.5, 2.5])
@pytest.mark.parametrize("gain", [0.0, 0.1, 0.7])
def test_the_share_is_that_of_drawn_samples(gain, sigmas):
    g = np.random.default_rng(0)
    noise = np.sqrt(1.0 - gain) * g.normal(size=400_000)
    error = noise + np.sqrt(0.5 * gain) * g.normal(size=400_000)
    kept = noise[np.abs(error) <= sigmas * np.sqrt(1.0 - 0.5 * gain)]
    assert kept_variance(gain, sigmas) == pytest.approx(np.mean(kept**2) / (1.0 - gain), rel=0.01)
