"""The likelihood over λ for a given momentum: against the filter run alone, and against the random walk."""

from __future__ import annotations

import math

import numpy as np
import pytest
from signals import moving

from kalscope import FilterParams
from kalscope.estimation.likelihood import log_likelihood
from kalscope.estimation.momentum import likelihood_profile


def uneven(n, seed=1):
    return np.random.default_rng(seed).choice([0.5, 1.0, 7.0], n)


@pytest.mark.parametrize("momentum", [0.01, 3.0, 200.0, 1e5])
@pytest.mark.parametrize(("missing", "dt"), [(0.0, None), (0.1, None), (0.1, uneven(700))])
def test_every_point_of_a_profile_equals_the_filter_run_alone(momentum, missing, dt):
    z = moving(700, 20.0, 0.3, missing=missing)
    profile = likelihood_profile(z, dt=dt, momentum=momentum)
    for j in range(0, len(profile.loglik), 10):
        r = profile.r[j]
        params = FilterParams(math.exp(profile.log_ratios[j]) * r, r, momentum=momentum)
        assert profile.loglik[j] == pytest.approx(log_likelihood(z, params, dt), rel=1e-7, abs=1e-5)
