"""The float32 filter against numpy's float32, one operation a rounding; and float32 written as text."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.effort import FUZZ
from tests.support.float32_by_hand import ByHand

from kalscope import FilterParams, kalman_filter, steady_state
from kalscope.errors import BadSetting
from kalscope.export.float32 import filter_float32, float32_params, float32_text
from kalscope.export.registry import STALLING_GAIN

F = np.float32


def test_a_start_variance_far_above_r_is_the_unknown_start_on_a_board():
    """With p = (1 - k) p the board kept its first sample from p0/r = 1e7 on: RMS error 1.2 in place of 0.1."""
    z = 5.0 + np.random.default_rng(2).normal(size=2000)
    for p0 in (1e7, 1e8, 1e30):
        x = filter_float32(z, FilterParams(1e-5, 1.0, p0, 0.0))
        np.testing.assert_allclose(x, kalman_filter(z, FilterParams(1e-5, 1.0)).x, atol=1e-4)


def awkward_samples(seed, n=1500):
    """A walk that keeps its direction, with holes, spikes and a missing first sample."""
    rng = np.random.default_rng(seed)
    z = 100 * rng.normal() + np.cumsum(np.cumsum(rng.normal(size=n) / 20)) + rng.normal(size=n)
    z[rng.random(n) < 0.03] = np.nan
    z[rng.random(n) < 0.03] += 60
    z[0] = np.nan
    return z


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2 * FUZZ))
def test_it_equals_the_filter_in_float32_by_hand_to_the_bit_with_and_without_momentum(seed):
    rng = np.random.default_rng(seed)
    z = awkward_samples(seed, 600)
    q, r, p0, x0 = 10.0 ** rng.uniform(-4, 2, 4)
    kinds = (q, r), (q, r, p0), (q, r, p0, x0), (q, r, p0, None, 9.0), (0.0, r, 0.0, None, 4.0), (q, 0.0, 0.0)
    for tau in (0.0, 1e-3, 0.4, 7.0, 60.0, 1e5):
        for kind in kinds:
            held = float32_params(FilterParams(*kind, momentum=tau))
            other = ByHand(held)
            np.testing.assert_array_equal(filter_float32(z, held), [other.update(one) for one in z])


@pytest.mark.parametrize("tau", [0.4, 7.0, 60.0, 1e5])
def test_momentum_in_float32_stays_with_the_filter_in_double(tau):
    z = awkward_samples(3)
    near = 2e-5 * np.nanmax(np.abs(z))
    for params in (FilterParams(0.5, 1.0, momentum=tau), FilterParams(50.0, 4.0, 1.0, 0.0, 9.0, momentum=tau)):
        np.testing.assert_allclose(filter_float32(z, params), kalman_filter(z, params).x, rtol=0, atol=near)


def test_text_and_float32_are_the_same_bits():
    rng = np.random.default_rng(1)
    bits = rng.integers(0x00800000, 0x7F7FFFFF, 10_000, dtype=np.uint32)
    for value in [*bits.view(F), F(0), F(1), F(-512.25), F(3e38)]:
        text = float32_text(value)
        assert text.endswith("f")
        assert "." in text or "e" in text
        assert F(text[:-1]).view(np.uint32) == value.view(np.uint32)
    assert (float32_text(F(np.inf)), float32_text(F(np.nan))) == ("INFINITY", "NAN")


@pytest.mark.parametrize(
    ("name", "params"),
    [
        *((name, {name: wrong}) for name in ("q", "r", "p0") for wrong in (1e-50, 1.1e-38, 4e38, 1e300)),
        ("q.. of q and momentum", {"q": 1e-30, "momentum": 1e5}),
        ("q22 of q and momentum", {"q": 1e30, "momentum": 1e-10}),
    ],
)
def test_what_float32_cannot_hold_is_refused_by_name(name, params):
    with pytest.raises(BadSetting, match=f"^{name} must fit float32"):
        float32_params(FilterParams(**{"q": 1.0, "r": 1.0} | params))
    with pytest.raises(BadSetting, match="shape"):
        filter_float32([[1.0]], FilterParams(1.0, [1.0, 2.0]))


@pytest.mark.slow
@pytest.mark.parametrize("momentum", [0.0, 2.0, 300.0])
def test_above_the_stalling_gain_float32_settles_within_one_percent(momentum):
    for gain, samples in ((1e-3, 20_000), (1e-5, 1_000_000), (1.1 * STALLING_GAIN, 2_000_000)):
        params = FilterParams(gain * gain / (1 - gain) * 7.0, 7.0, momentum=momentum)
        z = np.zeros(samples + 1, F)
        z[-1] = 1  # resting at 0, the answer to a single 1 is the gain
        assert filter_float32(z, params)[-1] == pytest.approx(steady_state(params).gain, rel=0.01)
