"""The tuning at another period: what it says of itself is true there."""

from __future__ import annotations

import re

import numpy as np
import pytest

from kalscope import ChannelTuning, Tuning, export_tuning
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.tuning.tuning import rescaled_to_period

Z = np.random.default_rng(1).normal(0.0, 3.0, 500).cumsum()


def tuned(request, period=0.005):
    found = find_parameters(Z, request, sample_period=period)
    q, r, momentum = (float(value) for value in (found.params.q, found.params.r, found.params.momentum))
    channel = ChannelTuning("a", "V", q, r, how=found.how, momentum=momentum)
    return Tuning((channel, ChannelTuning("b", "V", 2.0, 1.0)), sample_period=period)


LAGS = re.compile(r"(?:at ([\d.e-]+) s: )?a lag of ([\d.e-]+) ms|lag behind a ramp \S+ samples = (\S+) s")


@pytest.mark.parametrize("period", [0.001, 0.005, 0.01, 0.1])
def test_no_header_states_two_lags_for_one_period(period):
    request = Request(target={"lag_s": 0.05}, noise=Noise(r=4.0))
    tuning = tuned(request)
    moved = rescaled_to_period(tuning, period)
    text = export_tuning(moved, "c", channel="a")["kalscope_filter.c"]
    lags = {}
    for at, asked, settled in LAGS.findall(text):
        here = float(at) if at else period
        lags.setdefault(here, []).append(float(asked) / 1e3 if asked else float(settled))
    assert len(lags[period]) >= 1
    assert sum(map(len, lags.values())) == 2, "both lines stand in the header"
    for said in lags.values():
        assert said == pytest.approx([said[0]] * len(said), rel=1e-3)
