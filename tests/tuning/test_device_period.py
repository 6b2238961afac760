"""The tuning at another period: what it says of itself is true there."""

from __future__ import annotations

import re

import numpy as np
import pytest

from kalscope import BadSetting, ChannelTuning, Tuning, export_tuning, steady_state
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.tuning.tuning import meeting_goal, rescaled_to_period

Z = np.random.default_rng(1).normal(0.0, 3.0, 500).cumsum()


def tuned(request, period=0.005):
    found = find_parameters(Z, request, sample_period=period)
    q, r, momentum = (float(value) for value in (found.params.q, found.params.r, found.params.momentum))
    channel = ChannelTuning("a", "V", q, r, how=found.how, momentum=momentum)
    return Tuning((channel, ChannelTuning("b", "V", 2.0, 1.0)), sample_period=period)


def measured(tuning, target, period):
    steady = steady_state(tuning.channel("a").params, period)
    (name,) = target
    return {
        "lag_s": steady.lag_s,
        "lag_samples": steady.lag_samples,
        "cutoff_hz": steady.cutoff_hz,
        "noise_reduction_db": steady.noise_reduction_db,
    }[name]


GOALS = ({"lag_s": 0.05}, {"lag_samples": 8.0}, {"cutoff_hz": 3.0}, {"noise_reduction_db": 10.0})


@pytest.mark.parametrize("target", GOALS, ids=lambda target: next(iter(target)))
@pytest.mark.parametrize("period", [0.001, 0.01, 0.02])
def test_a_goal_is_met_at_the_period_of_the_device_and_r_stays(target, period):
    request = Request(target=target, noise=Noise(r=4.0))
    tuning = tuned(request)
    met = meeting_goal(tuning, "a", request, period)
    assert measured(met, target, period) == pytest.approx(next(iter(target.values())), rel=1e-6)
    assert met.channel("a").r == tuning.channel("a").r
    assert met.sample_period == period
    assert met.channel("b") == rescaled_to_period(tuning, period).channel("b")


def test_what_cannot_be_met_is_refused():
    request = Request(target={"lag_s": 0.05}, noise=Noise(r=4.0))
    with pytest.raises(BadSetting, match="goal must be a lag"):
        meeting_goal(tuned(request), "a", Request(), 0.01)
    with pytest.raises(BadSetting, match="channel must be one of a, b"):
        meeting_goal(tuned(request), "c", request, 0.01)


LAGS = re.compile(r"(?:at ([\d.e-]+) s: )?a lag of ([\d.e-]+) ms|lag behind a ramp \S+ samples = (\S+) s")


@pytest.mark.parametrize("period", [0.001, 0.005, 0.01, 0.1])
@pytest.mark.parametrize("meets", [False, True])
def test_no_header_states_two_lags_for_one_period(period, meets):
    request = Request(target={"lag_s": 0.05}, noise=Noise(r=4.0))
    tuning = tuned(request)
    moved = meeting_goal(tuning, "a", request, period) if meets else rescaled_to_period(tuning, period)
    text = export_tuning(moved, "c", channel="a")["kalscope_filter.c"]
    lags = {}
    for at, asked, settled in LAGS.findall(text):
        here = float(at) if at else period
        lags.setdefault(here, []).append(float(asked) / 1e3 if asked else float(settled))
    assert len(lags[period]) >= 1
    assert sum(map(len, lags.values())) == 2, "both lines stand in the header"
    for said in lags.values():
        assert said == pytest.approx([said[0]] * len(said), rel=1e-3)
