"""What an export starts from."""

from __future__ import annotations

import pytest

from kalscope import BadSetting, ChannelTuning, Tuning, steady_state
from kalscope.export.job import ExportJob, job_of, step_of
from kalscope.filtering.kernels import transition
from kalscope.tuning.tuning import rescaled_to_period

TUNING = Tuning(
    (ChannelTuning("Temp °C", "°C", 0.01, 1.0), ChannelTuning("temp degc", "°C", 1.0, 2.0)), sample_period=0.5
)


def test_a_job_holds_all_channels_or_the_one_asked_for():
    assert job_of(TUNING).channels == TUNING.channels
    assert job_of(TUNING.only("temp degc")).channels == TUNING.channels[1:]
    with pytest.raises(BadSetting, match="channel must be one of Temp °C, temp degc"):
        job_of(TUNING.only("unknown"))


def test_a_job_without_channels_is_refused():
    with pytest.raises(BadSetting, match="at least one channel"):
        ExportJob(())


def test_channels_that_are_spelt_alike_get_distinct_identifiers():
    assert job_of(TUNING).identifiers == ("temp_degc", "temp_degc_2")


def test_the_settled_filter_is_that_of_the_period():
    job = job_of(TUNING)
    assert job.steady(job.channels[0]) == steady_state(TUNING.channels[0].params, 0.5)


def test_the_constants_of_a_momentum_are_those_of_one_sample():
    plain, with_momentum = ChannelTuning("a", "", 2.0, 1.0), ChannelTuning("b", "", 2.0, 1.0, momentum=20.0)
    assert step_of(plain) == {}
    constants = step_of(with_momentum)
    assert tuple(constants[name] for name in ("e", "f", "q11", "q12", "q22")) == transition(1.0, 2.0, 20.0)
    assert (constants["momentum"], constants["w0"]) == (20.0, 0.05)
    assert [ExportJob((channel,)).has_momentum for channel in (plain, with_momentum)] == [False, True]


def test_another_period_carries_q_and_momentum_over_and_says_so():
    tuning = Tuning(
        (ChannelTuning("a", "", 2.0, 1.0, momentum=20.0), ChannelTuning("b", "", 2.0, 1.0)), sample_period=0.01
    )
    with_momentum, plain = rescaled_to_period(tuning, 0.04).channels
    assert (with_momentum.q, with_momentum.momentum, plain.q, plain.momentum) == (8.0, 5.0, 8.0, 0.0)
    assert with_momentum.how == "at 0.01 s: by hand; q times 4 and momentum divided by it"
    assert plain.how == "at 0.01 s: by hand; q times 4"
