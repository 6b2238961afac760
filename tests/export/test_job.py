"""What an export starts from."""

from __future__ import annotations

import pytest

from kalscope import BadSetting, ChannelTuning, Tuning, steady_state
from kalscope.export.job import ExportJob, job_of

TUNING = Tuning(
    (ChannelTuning("Temp °C", "°C", 0.01, 1.0), ChannelTuning("temp degc", "°C", 1.0, 2.0)), sample_period=0.5
)


def test_a_job_holds_all_channels_or_the_one_asked_for():
    assert job_of(TUNING).channels == TUNING.channels
    assert job_of(TUNING, "temp degc").channels == TUNING.channels[1:]
    with pytest.raises(BadSetting, match="channel must be one of Temp °C, temp degc"):
        job_of(TUNING, "unknown")


def test_a_job_without_channels_is_refused():
    with pytest.raises(BadSetting, match="at least one channel"):
        ExportJob(())


def test_channels_that_are_spelt_alike_get_distinct_identifiers():
    assert job_of(TUNING).identifiers == ("temp_degc", "temp_degc_2")


def test_the_settled_filter_is_that_of_the_period():
    job = job_of(TUNING)
    assert job.steady(job.channels[0]) == steady_state(TUNING.channels[0].params, 0.5)


def test_momentum_is_refused() -> None:
    with pytest.raises(BadSetting, match=r"momentum must be 0 for an export \(got 20\.0\)"):
        job_of(Tuning((ChannelTuning("a", "", 1.0, 1.0, momentum=20.0),)))
