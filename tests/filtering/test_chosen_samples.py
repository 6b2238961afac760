"""A run that keeps chosen samples gives what a whole run gives there, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from kalscope import BadSetting, FilterParams, kalman_filter
from kalscope.filtering.pieces.chosen import PIECE
from kalscope.filtering.chosen import filter_at, picked

PARAMS = (
    FilterParams(0.01, 1.0),
    FilterParams(0.01, 1.0, p0=4.0),
    FilterParams(0.0, 1.0, p0=0.5, x0=2.0),
    FilterParams(1e-4, 1.0, gate=9.0),
    FilterParams(0.01, 1.0, momentum=8.0),
    FilterParams(1e-3, 1.0, momentum=20.0, gate=9.0),
)
N = 2 * PIECE + 137


def record(*, missing=0.05):
    rng = np.random.default_rng(1)
    z = rng.normal(size=N)
    z[rng.random(N) < missing] = np.nan
    z[rng.random(N) < 0.02] += 30.0
    z[PIECE - 3 : PIECE + 6] += 50.0  # longer than the gate may refuse, across two pieces
    return z


@pytest.mark.slow
@each("params", PARAMS, ids=repr)
@each("timed", [False, True])
@each("missing", [0.0, 0.05])
def test_it_is_the_whole_run_at_these_samples(params, timed, missing):
    z, rng = record(missing=missing), np.random.default_rng(2)
    dt = rng.random(N) * 3 if timed else None
    whole = kalman_filter(z, params, dt)
    for indices in (np.arange(N), np.flatnonzero(rng.random(N) < 0.01), np.array([PIECE - 1, PIECE, N - 1])):
        kept, wanted = filter_at(z, params, indices, dt), whole.at(indices)
        for name in ("x", "p", "k", "innovation", "s", "velocity", "velocity_p"):
            assert (getattr(kept, name) is None) == (getattr(wanted, name) is None)
            np.testing.assert_array_equal(getattr(kept, name), getattr(wanted, name), err_msg=name)
        assert (kept.m, kept.rejected) == (whole.m, whole.rejected)
        assert kept.loglik == pytest.approx(whole.loglik, rel=1e-12)


def test_no_samples_can_be_kept_and_none_filtered():
    params = FilterParams(0.01, 1.0)
    assert filter_at(record(), params, np.empty(0, np.intp)).m > 0
    assert filter_at(np.empty(0), params, np.empty(0, np.intp)).m == 0


def test_an_infinite_sample_is_named_by_its_place_in_the_record():
    z = record()
    z[PIECE + 5] = np.inf
    with pytest.raises(BadSetting, match=f"inf at sample {PIECE + 5}"):
        filter_at(z, FilterParams(0.01, 1.0), np.array([3]))


@pytest.mark.parametrize("indices", [[-1, 3], [3, N]])
def test_samples_outside_are_refused(indices):
    with pytest.raises(BadSetting, match="indices must be of z"):
        filter_at(record(), FilterParams(0.01, 1.0), np.array(indices))
