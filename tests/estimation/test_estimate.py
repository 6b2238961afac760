"""The estimators compared, side by side; channels; progress and cancelling."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from effort import FUZZ
from hypothesis import given
from hypothesis import strategies as st
from signals import walk

from kalscope import BadSetting
from kalscope.estimation.fit import METHODS, estimate, estimate_fixed_r, estimate_fixed_ratio

# --- the instant ones -----------------------------------------------------------------------------------


def test_moments_of_the_nile_flows(nile):
    """r = −γ₁ and q = γ₀ + 2γ₁ of the differences, written out."""
    d = np.diff(nile)
    g0, g1 = np.mean(d * d), np.mean(d[1:] * d[:-1])
    found = estimate(nile, "moments")
    assert found.r == pytest.approx(-g1, rel=1e-12)
    assert found.q == pytest.approx(g0 + 2 * g1, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["moments", "allan", "ml"])
@pytest.mark.parametrize("ratio", [0.05, 0.5, 5.0])
def test_every_method_recovers_the_truth_from_a_long_record(method, ratio):
    found = estimate(walk(60_000, ratio, seed=11, r=4.0), method)
    assert found.q == pytest.approx(4.0 * ratio, rel=0.12)
    assert found.r == pytest.approx(4.0, rel=0.12)
    assert abs(found.q - 4.0 * ratio) < 5 * found.q_se
    assert abs(found.r - 4.0) < 5 * found.r_se


@pytest.mark.slow
@pytest.mark.parametrize("method", ["moments", "allan"])
def test_every_method_works_over_gaps(method):
    z = walk(60_000, 0.2, seed=4)
    z.reshape(-1, 500)[:, -9:] = np.nan
    found = estimate(z, method)
    assert found.q == pytest.approx(0.2, rel=0.2)
    assert found.r == pytest.approx(1.0, rel=0.1)


def test_moments_take_irregular_steps():
    g = np.random.default_rng(6)
    dt = g.uniform(0.2, 3.0, 50_000)
    z = np.cumsum(g.normal(0, 1, len(dt)) * np.sqrt(0.3 * dt)) + g.normal(0, 1, len(dt))
    found = estimate(z, "moments", dt=dt)
    assert found.q == pytest.approx(0.3, rel=0.1)
    assert found.r == pytest.approx(1.0, rel=0.1)


def test_allan_refuses_what_is_not_regular_or_changes_only_across_gaps():
    z, dt = walk(500, 0.1), np.random.default_rng(0).uniform(0.5, 1.5, 500)
    found = estimate(z, "allan", dt=dt)
    assert (found.verdict, found.params) == ("irregular", None)
    assert "regular" in found.message
    z = np.repeat([0.0, 0.0, 1.0, 1.0], 20)
    z[38:42] = np.nan
    assert (estimate(z, "allan").verdict, estimate(z).verdict) == ("too_few", "no_noise")


# --- any record -----------------------------------------------------------------------------------------


@st.composite
def records(draw):
    """Odd ones: steps, doubles, extreme scales, no time, much missing."""
    n = draw(st.integers(0, 60))
    g = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    z = g.normal(0, 1, n)
    shapes = [z, np.round(z), np.cumsum(z), np.sign(z), (z > 2) * 1.0, np.exp(9 * z), 1e15 + np.round(z)]
    z = draw(st.sampled_from(shapes)) * 10.0 ** draw(st.sampled_from([-250, -9, 0, 9, 250]))
    z[g.random(n) < draw(st.sampled_from([0.0, 0.3, 0.9]))] = np.nan
    steps = [None, np.zeros(n), g.uniform(0, 2, n), g.integers(0, 4, n) * 1.0, 10.0 ** g.uniform(-300, 300, n)]
    return z, draw(st.sampled_from(steps))


@pytest.mark.slow
@given(records())
def test_any_record_gets_numbers_and_words(record):
    z, dt = record
    each = [estimate(z, method, dt, momentum=0.0, robust=False) for method in METHODS]
    for one in (*each, estimate_fixed_r(z, 1.0, dt), estimate_fixed_ratio(z, 0.01, dt)):
        values = [one.q, one.r, one.ratio, one.loglik, one.q_se, one.r_se]
        values += [*one.ratio_interval, *one.gain_interval, *one.lag_interval]
        assert not np.isnan(values).any()
        assert one.message.endswith(".")
        if one.params is not None:
            assert one.q > 0
            assert one.r > 0


# --- side by side ---------------------------------------------------------------------------------------


# --- manners --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_progress_rises_to_one(method, nile):
    seen = []
    estimate(nile, method, progress=lambda fraction, text: seen.append((fraction, text)))
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] < fractions[-1] == 1
    assert all(text for _, text in seen)


def test_importing_the_estimators_leaves_the_heavy_parts_of_scipy_alone():
    code = "import sys, kalscope.estimation; print({'scipy.optimize', 'scipy.interpolate'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=True, capture_output=True).stdout.strip() == b"set()"


@pytest.mark.parametrize(
    ("z", "options"),
    [
        ([1.0, np.inf, 2.0], {}),
        ([1.0, 2.0], {"dt": [1.0]}),
        ([1.0, 2.0], {"dt": [1.0, -1.0]}),
        ([1.0, 2.0], {"method": "guess"}),
        (np.ones((2, 2, 2)), {}),
    ],
)
def test_bad_settings_are_refused(z, options):
    with pytest.raises(BadSetting):
        estimate(z, **options)


def test_a_method_that_misses_what_the_record_shows_does_not_blame_the_record():
    rng = np.random.default_rng(0)
    z = np.cumsum(0.1 * rng.standard_normal(2000)) + rng.standard_normal(2000)
    blind = estimate(z, "moments")
    assert blind.verdict == "no_movement"
    assert blind.ratio_interval[0] > 0.0
    assert "more about the method than about the record" in blind.message


# --- hostile records ------------------------------------------------------------------------------------


def hostile_record(i, g):
    """Random bits, values over many decades, constants, alternating extremes, or noise of any size."""
    n = int(g.integers(0, 300))
    signs = g.choice([-1.0, 1.0], n)
    if i % 5 == 0:
        bits = g.integers(0, 2**64, n, dtype=np.uint64).view(np.float64)
        return np.where(np.isinf(bits), np.nan, bits)
    if i % 5 == 1:
        return signs * 10.0 ** g.uniform(-400.0, 308.0, n)
    if i % 5 == 2:
        return np.full(n, 10.0 ** g.uniform(-320.0, 308.0))
    if i % 5 == 3:
        return np.where(np.arange(n) % 2, 1e308, -1e308) * g.uniform(0.5, 1.7, n)
    return g.normal(size=n) * 10.0 ** g.integers(-300, 300)


@pytest.mark.parametrize("seed", range(3))
def test_an_estimate_of_any_record_ends_without_a_warning(seed):
    g = np.random.default_rng(seed)
    for i in range(40 * FUZZ):
        assert estimate(hostile_record(i, g)).verdict
