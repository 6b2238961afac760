"""Published tables of the smoother, and its edges; the oracle is in test_oracles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kalscope import FilterParams, kalman_filter, smooth


def noisy_walk(n=300, q=0.05, r=1.0, seed=0, missing=0.0):
    g = np.random.default_rng(seed)
    z = np.cumsum(g.normal(0, math.sqrt(q), n)) + g.normal(0, math.sqrt(r), n)
    z[g.random(n) < missing] = np.nan
    return z


# --- published tables -----------------------------------------------------------------------------------


def test_nile_smoothed_level_is_the_published_one(nile):
    """Durbin & Koopman (2012), figure 2.2, at r = 15099, q = 1469.1."""
    x = smooth(nile, FilterParams(q=1469.1, r=15099.0)).x
    assert x[0] == pytest.approx(1111.66832, abs=5e-6)
    assert x[99] == pytest.approx(798.37029, abs=5e-6)


def test_norwegian_road_fatalities_smoothed_level_is_the_published_one():
    """Commandeur & Koopman (2007), section 2.3, level[1] = 6.3048 as printed by sinhrks' R script."""
    x = smooth(np.log(NORWAY), FilterParams(q=0.0047026, r=0.00326838)).x
    assert x[0] == pytest.approx(6.3048, abs=5e-5)


NORWAY = [560.0, 533, 490, 511, 509, 539, 471, 442, 434, 437, 362, 338, 401, 409, 407, 402, 452]
NORWAY += [398.0, 378, 381, 332, 323, 325, 281, 283, 305, 255, 303, 352, 304, 341, 275, 312, 280]
"""Road-traffic fatalities in Norway, 1970-2003: Commandeur & Koopman (2007), appendix A."""


def test_prior_at_the_first_sample_gives_the_columns_of_the_marss_guide(nile):
    """MARSS user guide, KFAS chapter: a1 = 0, P1 = 1000, q = 15210.195, r = 33874.59; dt[0] = 0 states it."""
    dt = np.r_[0.0, np.ones(99)]
    got = smooth(nile, FilterParams(q=15210.195, r=33874.59, p0=1000.0, x0=0.0), dt)
    x = [64.38081, 569.63686, 809.81105, 981.20113, 1049.85712]
    x += [1069.05730, 1047.42286, 1131.04778, 1170.24168, 1119.74113]
    p = [942.3097, 8128.6821, 10055.5588, 10572.2107, 10710.7402]
    assert got.x[:10] == pytest.approx(x, abs=1e-5)  # q and r are printed to eight and seven digits
    assert got.p[:5] == pytest.approx(p, rel=1e-7)
    half = 1.959964 * math.sqrt(got.p[0])
    assert (got.x[0] - half, got.x[0] + half) == pytest.approx((4.215678, 124.5460), abs=1e-4)


def test_exact_diffuse_start_gives_the_ten_points_of_kfas():
    """statsmodels' results_exact_initial_local_level_R.csv (KFAS 1.3.1): alphahat and sumV."""
    got = smooth([10.2394] + [1.0] * 9, FilterParams(q=8.253, r=1.993))
    assert got.x == pytest.approx(KFAS_ALPHAHAT, rel=1e-13)
    assert got.p == pytest.approx(KFAS_SUMV, rel=1e-13)


KFAS_ALPHAHAT = [8.69269189482201, 2.28778372019385, 1.21557953089427, 1.03608877283924, 1.00604138771061]
KFAS_ALPHAHAT += [1.00101134968464, 1.0001693041059, 1.00002834572536, 1.00000476680865, 1.00000092721546]
KFAS_SUMV = [1.65936477978876, 1.42808320855318, 1.4216017878374, 1.42142015300846, 1.42141506687939]
KFAS_SUMV += KFAS_SUMV[::-1]


# --- edges ----------------------------------------------------------------------------------------------


def test_without_measurement_noise_samples_stay_and_gaps_are_bridged():
    got = smooth([1.0, math.nan, 3.0, 7.0], FilterParams(q=2.0, r=0.0))
    assert got.x.tolist() == [1.0, 2.0, 3.0, 7.0]
    assert got.p.tolist() == [0.0, 1.0, 0.0, 0.0]


def test_refused_sample_counts_as_missing():
    z = noisy_walk(seed=4)
    z[100] += 50.0
    params = FilterParams(q=0.05, r=1.0, gate=16.0)
    assert kalman_filter(z, params).rejected == 1
    without = np.where(np.arange(len(z)) == 100, math.nan, z)
    assert np.array_equal(smooth(z, params).x, smooth(without, FilterParams(q=0.05, r=1.0)).x)


def test_record_without_a_sample():
    diffuse = smooth([math.nan] * 3, FilterParams(q=1.0, r=1.0))
    assert np.isnan(diffuse.x).all()
    assert np.isinf(diffuse.p).all()
    prior = smooth([math.nan] * 3, FilterParams(q=1.0, r=1.0, p0=2.0, x0=5.0))
    assert prior.x.tolist() == [5.0] * 3
    assert prior.p == pytest.approx([3.0, 4.0, 5.0])
    assert smooth([], FilterParams(q=1.0, r=1.0)).x.shape == (0,)


@pytest.mark.parametrize("unit", [1e-290, 1e290])
def test_extreme_units_scale_the_variance_and_leave_the_signal(unit):
    z = noisy_walk(missing=0.1)
    plain, scaled = smooth(z, FilterParams(q=0.5, r=1.0)), smooth(z, FilterParams(q=0.5 * unit, r=unit))
    assert scaled.x == pytest.approx(plain.x, rel=1e-12, abs=1e-13)
    assert scaled.p / unit == pytest.approx(plain.p, rel=1e-12)
