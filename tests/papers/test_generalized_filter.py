"""Khan et al.: both readings of equation (3), as laws and against loops written here."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.errors import BadSetting
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.papers.generalized import GeneralizedParams, printed_gain

EXACT = 0.0
ROUNDING = 1e-12
SETTLED = 1e-9

SIGNAL = 50.0 + np.random.default_rng(3).normal(0.0, 4.0, 400)


def equations_1_to_3(measurements, sigma_m, e, sigma_e):
    """The three equations as printed: returns E, σE and K after each measurement."""
    rows = []
    for m in measurements:
        k = sigma_e / (sigma_e + sigma_m)
        previous = e
        e = previous + k * (m - previous)
        sigma_e = (1 - k) * previous
        rows.append((e, sigma_e, k))
    return np.array(rows).T


def test_the_printed_reading_is_the_three_printed_equations():
    result = GeneralizedParams(100.0, sigma_e0=7.0, e0=20.0).run(SIGNAL)
    for ours, theirs in zip(
        (result.x, result.p, result.k), equations_1_to_3(SIGNAL.tolist(), 100.0, 20.0, 7.0), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=EXACT)


@pytest.mark.parametrize("start", [{}, {"sigma_e0": 3.0}, {"sigma_e0": 3.0, "e0": 10.0}])
def test_without_the_slip_it_is_the_five_line_filter_with_q_0(start):
    z = SIGNAL.copy()
    z[[0, 5, 6]] = np.nan
    ours = GeneralizedParams(16.0, reading="without_slip", **start).run(z)
    five = kalman_filter(z, FilterParams(q=0.0, r=16.0, p0=start.get("sigma_e0"), x0=start.get("e0")))
    for field in ("x", "p", "k", "innovation", "s"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(five, field))
    assert (ours.loglik, ours.m) == (five.loglik, five.m)


def test_without_the_slip_the_gain_is_one_over_n_and_x_is_the_mean():
    result = GeneralizedParams(16.0, reading="without_slip").run(SIGNAL)
    n = np.arange(1, len(SIGNAL) + 1)
    np.testing.assert_allclose(result.k, 1.0 / n, rtol=ROUNDING)
    np.testing.assert_allclose(result.x, np.cumsum(SIGNAL) / n, rtol=ROUNDING)


@given(st.floats(1e-3, 1e6), st.floats(1e-3, 1e6))
def test_the_fixed_point_solves_its_quadratic(level, sigma_m):
    gain = printed_gain(level, sigma_m)
    s = (1 - gain) * level  # equation (3) at rest
    assert s * s + sigma_m * s == pytest.approx(sigma_m * level, rel=1e-9)


@pytest.mark.parametrize(("level", "sigma_m"), [(1.0, 4.0), (20.0, 0.8), (1000.0, 4.0), (3.0, 500.0)])
def test_a_constant_signal_settles_at_the_fixed_point_from_any_start(level, sigma_m):
    gain = printed_gain(level, sigma_m)
    for start in (0.01 * level, level, 50.0 * level):
        result = GeneralizedParams(sigma_m, sigma_e0=start, e0=start).run(np.full(5000, level))
        settled = result.x[-1], result.p[-1], result.k[-1]
        assert settled == pytest.approx((level, (1 - gain) * level, gain), rel=SETTLED)


def test_the_gain_depends_on_the_level_but_not_on_a_common_factor():
    assert printed_gain(1.0, 4.0) < 0.2
    assert printed_gain(1000.0, 4.0) > 0.9
    one = GeneralizedParams(9.0).run(SIGNAL)
    scaled = GeneralizedParams(1024.0 * 9.0).run(1024.0 * SIGNAL)
    np.testing.assert_array_equal(scaled.k, one.k)
    moved = GeneralizedParams(9.0).run(SIGNAL + 273.15)  # °C to K
    assert moved.k[-1] > one.k[-1] + 0.02


@pytest.mark.parametrize(
    ("z", "params"),
    [
        ([0.0, 1.0], GeneralizedParams(4.0)),
        ([-3.0], GeneralizedParams(4.0)),
        ([3.0, -50.0], GeneralizedParams(4.0)),
        ([np.nan, 3.0, np.nan, -50.0], GeneralizedParams(4.0)),
    ],
)
def test_at_zero_and_below_the_printed_reading_says_what_must_hold(z, params):
    with pytest.raises(BadSetting, match=r"needs estimates above 0.*without_slip"):
        params.run(z)
    stream = params.stream()
    for sample in z[:-1] if z[0] != 0.0 else []:
        stream.update(sample)
    with pytest.raises(BadSetting, match="needs estimates above 0"):
        stream.update(z[-1] if z[0] != 0.0 else z[0])


@pytest.mark.parametrize("reading", ["printed", "without_slip"])
@pytest.mark.parametrize("start", [{}, {"sigma_e0": 2.0, "e0": 90.0}])
def test_batch_and_stream_agree_bit_for_bit_whatever_was_refused(reading, start):
    z = np.array(SIGNAL)
    z[[0, 3]] = np.nan
    params = GeneralizedParams(30.0, reading=reading, **start)
    stream, x = params.stream(), params.run(z).x
    for i, sample in enumerate(z):
        np.testing.assert_array_equal(stream.update(sample), x[i])
        for bad, dt in ((math.inf, None), (1.0, -1.0), ([1.0], None)):
            with pytest.raises(BadSetting, match="must be"):
                stream.update(bad, dt)


def test_a_missing_sample_changes_nothing():
    params = GeneralizedParams(30.0)
    gappy = np.insert(SIGNAL, [4, 4, 9], np.nan)
    result = params.run(gappy)
    kept = np.isfinite(gappy)
    np.testing.assert_array_equal(result.x[kept], params.run(SIGNAL).x)
    assert (result.k[~kept] == 0.0).all()
    assert np.isnan(result.innovation[~kept]).all()


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"sigma_m": 0.0}, "sigma_m must be"),
        ({"sigma_m": math.nan}, "sigma_m must be"),
        ({"sigma_m": "a"}, "sigma_m must be"),
        ({"sigma_m": 1.0, "sigma_e0": -1.0}, "sigma_e0 must be"),
        ({"sigma_m": 1.0, "e0": 0.0}, "e0 must be"),
        ({"sigma_m": 1.0, "e0": 0.0, "reading": "without_slip"}, "e0 needs sigma_e0"),
        ({"sigma_m": 1.0, "reading": "slip"}, "reading must be one of"),
    ],
)
def test_bad_settings_are_named(settings, says):
    with pytest.raises(BadSetting, match=says):
        GeneralizedParams(**settings)


def test_bad_data_is_named():
    for z, dt, says in (
        ([1.0, math.inf], None, "z must be finite"),
        (np.ones((2, 2)), None, "z must be one channel, shape"),
        ([1.0], [-1.0], "dt must be finite"),
    ):
        with pytest.raises(BadSetting, match=says):
            GeneralizedParams(1.0).run(z, dt)
    with pytest.raises(BadSetting, match="level must be"):
        printed_gain(0.0, 1.0)
