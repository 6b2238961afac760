"""A tuning at another sample period, and what a fusion must hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope import ChannelTuning, Tuning, kalman_filter
from kalscope.classic import Butterworth, Chain, Exponential, Median, MovingAverage, Notch, OneEuro
from kalscope.errors import BadSetting
from kalscope.filtering.classic import ChainFilter
from kalscope.tuning.choose import rescaled
from kalscope.tuning.tuning import rescaled_to_period

FUSED = ChannelTuning(
    name="level",
    unit="cm",
    sensors=("a", "b"),
    q=0.25,
    r=(4.0, 0.09),
    offset=(0.0, -1.5),
    gain=(1.0, 1.02),
    momentum=12.5,
    how="maximum likelihood",
)
TWO = Tuning(
    (ChannelTuning("a", "V", 0.25, 2.0), ChannelTuning("b", "V", 1.0, 2.0, p0=4.0, x0=-1.5)),
    sample_period=0.01,
    fusion=FUSED,
)


@given(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6))
def test_q_follows_the_sample_period_and_nothing_else_does(old, new):
    tuning = replace(TWO, sample_period=old, fusion=None)
    moved = tuning.rescaled(new)
    assert moved.sample_period == new
    for before, after in zip(tuning.channels, moved.channels, strict=True):
        assert after.q == pytest.approx(before.q * new / old, rel=1e-15)
        assert replace(after, q=before.q) == before  # neither has momentum


def test_momentum_of_a_fusion_follows_too_and_both_periods_are_needed():
    moved = TWO.rescaled(0.02).fusion
    assert moved == replace(FUSED, q=0.5, momentum=6.25)
    assert TWO.rescaled(0.01) == rescaled_to_period(TWO, 0.01) == TWO
    how = "at 0.01 s: maximum likelihood; q times 2 and momentum divided by it"
    assert rescaled_to_period(TWO, 0.02).fusion == replace(moved, how=how)
    with pytest.raises(BadSetting, match="must be known"):
        replace(TWO, sample_period=None).rescaled(0.01)
    with pytest.raises(BadSetting, match="sample_period must be a finite number above 0"):
        TWO.rescaled(-1.0)


def test_a_rescaled_filter_with_momentum_sees_the_same_signal():
    """Twice as fine: every second sample missing, the estimates at the others are the same."""
    z = np.random.default_rng(7).normal(size=200).cumsum()
    fine = np.full(400, np.nan)
    fine[1::2] = z
    tuning = Tuning((ChannelTuning("a", "", 0.3, 2.0, 4.0, 0.5, momentum=6.0),), sample_period=0.01)
    coarse = kalman_filter(z, tuning.channel("a").params)
    halved = kalman_filter(fine, tuning.rescaled(0.005).channel("a").params)
    np.testing.assert_allclose(halved.x[1::2], coarse.x, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(halved.p[1::2], coarse.p, rtol=1e-12)


# ---- chains


def with_chain(chain):
    return replace(TWO, channels=(replace(TWO.channels[0], chain=chain), TWO.channels[1]), fusion=None)


def test_at_another_period_cut_offs_stay_in_hertz_and_windows_in_seconds():
    for ratio, before, after in (
        (2.0, Chain(5, MovingAverage(9)), Chain(3, MovingAverage(4))),
        (0.5, Chain(5, Median(9)), Chain(9, Median(17))),
        (4.0, Chain(3, Exponential(1.0)), Chain(1, Exponential(1.0))),
        (2.0, Chain(1, Butterworth(0.1)), Chain(1, Butterworth(0.2))),
        (2.0, Chain(1, OneEuro(0.1, 3.0, 0.2)), Chain(1, OneEuro(0.2, 3.0, 0.4))),
        (8.0, Chain(5), None),
        (2.0, Chain(5, notch=Notch(0.1, 0.01)), Chain(3, notch=Notch(0.2, 0.02))),
        (1.0, Chain(5, Exponential(0.3)), Chain(5, Exponential(0.3))),
    ):
        assert with_chain(before).rescaled(0.01 * ratio).channels[0].chain == after
    slow = with_chain(Chain(1, Exponential(0.19))).rescaled(0.005).channels[0].chain
    assert slow.then.alpha == pytest.approx(0.1)
    # The one-euro filter of a ramp in V/s answers alike: half as many samples, twice as far apart.
    ramp = np.linspace(0.0, 8.0, 4001)
    fast, half = (ChainFilter(Chain(1, OneEuro(f, 3.0, 2 * f)), TWO.channels[0].params) for f in (1e-3, 2e-3))
    assert fast.denoise(ramp)[-1] == pytest.approx(half.denoise(ramp[::2])[-1], rel=1e-3)


def test_the_user_is_told_what_a_chain_became_and_which_cannot():
    moved, notes = rescaled(with_chain(Chain(5, MovingAverage(9))), 0.02, {"q": 1.0})
    assert notes == [
        "the chain of a became median of 3, then moving average (window of 4): it was tuned at a sample period of"
        " 0.01 s, here it is 0.02 s"
    ]
    assert moved.channels[0].chain == Chain(3, MovingAverage(4))
    assert rescaled(with_chain(Chain(5)), 0.08, {})[1][0].startswith(
        "q was multiplied by 8 and the chain of a became Kalman alone: they were tuned"
    )
    assert rescaled_to_period(with_chain(Chain(5)), 0.02).channels[0].how.endswith("q times 2, chain rescaled")
    with pytest.raises(BadSetting, match=r"^a cannot be filtered alike every 20 ms: cutoff in .* 0.499 \(got"):
        with_chain(Chain(1, Butterworth(0.3))).rescaled(0.02)


# ---- fused sensors


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"sensors": ("a", "a")}, r"sensors of a fusion must have distinct names \(got \['a', 'a'\]\)"),
        ({"sensors": ("a",)}, r"one value per sensor \(got 2 for 1 sensors\)"),
        ({"sensors": ()}, "^r of a channel must be one number"),
        ({"chain": Chain(3)}, "^a chain filters one channel"),
        ({"r": (0.0, 0.0)}, "^at most one r may be 0"),
        ({"offset": (0.0, float("nan"))}, "^offset must"),
    ],
)
def test_values_that_are_no_fusion_are_refused(changed, says):
    with pytest.raises(BadSetting, match=says):
        replace(FUSED, **changed)
