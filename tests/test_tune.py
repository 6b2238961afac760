"""`kalscope.tune`: from samples in any form to the filter of `find_parameters`, in a table, a file, code."""

from __future__ import annotations

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

import kalscope
from kalscope.estimation.request import Request, find_parameters


@pytest.fixture(scope="module")
def recording():
    return kalscope.synthesize("random_walk", n=600, amplitude=1.0, sigma=2.0, sample_period=0.02, seed=1)


def test_a_series_an_array_and_a_recording_give_the_filter_of_the_dashboard(recording):
    (name,) = recording.names
    z, index = recording[name], pd.to_datetime(np.arange(600) * 20, unit="ms")
    request = Request(target={"lag_s": 0.05})
    expected = find_parameters(z, request, sample_period=recording.sample_period)
    series = kalscope.tune(pd.Series(z, index, name="u"), lag_ms=50)
    others = kalscope.tune(z, lag_ms=50, sample_period=0.02), kalscope.tune(recording, lag_ms=50)
    assert {one.params for one in (series, *others)} == {expected.params}
    assert series.message == expected.message
    assert series.x.index.equals(index)
    assert series.x.name == "u"
    np.testing.assert_array_equal(series.x, kalscope.kalman_filter(z, expected.params).x)
    assert list(series.to_frame().columns) == ["z", "x", "p"]


@pytest.mark.slow
def test_the_result_is_drawn_saved_and_exported_and_nothing_is_overwritten(recording, tmp_path):
    mpl.use("agg")
    tuned = kalscope.tune(recording, lag_ms=50)
    assert [line.get_label() for line in tuned.plot().lines] == ["raw", "filtered"]
    tuned.save(tmp_path / "tuning.toml")
    assert kalscope.load_tuning(tmp_path / "tuning.toml").channels[0].params == tuned.params
    assert all(path.exists() for path in tuned.export("c", tmp_path))
    with pytest.raises(kalscope.BadSetting):
        tuned.export("c", tmp_path)


def test_q_and_r_in_place_of_params(recording):
    z, params = recording.values[:, 0], kalscope.FilterParams(0.1, 4.0)
    series = pd.Series(z, name="u")
    np.testing.assert_array_equal(kalscope.kalman_filter(z, q=0.1, r=4.0).x, kalscope.kalman_filter(z, params).x)
    assert kalscope.denoise(series, q=0.1, r=4.0).equals(pd.Series(kalscope.denoise(z, params), name="u"))
    for wrong in ({}, {"q": 0.1}, {"params": params, "q": 0.1, "r": 4.0}):
        with pytest.raises(kalscope.BadSetting, match="params"):
            kalscope.denoise(z, **wrong)


def test_known_noise_or_a_ratio(recording):
    z = recording.values[:, 0]
    assert kalscope.estimate(z, r=4.0).r == 4.0
    assert kalscope.estimate(z, ratio=0.1).ratio == pytest.approx(0.1)
    for wrong in ({"r": 4.0, "ratio": 0.1}, {"r": 4.0, "momentum": 3.0}, {"ratio": 0}):
        with pytest.raises(kalscope.BadSetting):
            kalscope.estimate(z, **wrong)


def test_steps_are_nominal_periods_and_a_step_back_is_none(recording):
    uneven = replace(recording, time=[0.0, 3.0, 2.0], values=recording.values[:3], sample_period=2.0)
    assert uneven.steps().tolist() == [1.0, 1.5, 0.0]
    with pytest.raises(kalscope.BadSetting, match="dt needs a recording with time"):
        replace(recording, sample_period=None).steps()


def test_a_frame_is_a_recording_and_everything_prints_in_a_few_words(recording):
    frame = pd.DataFrame({"a": [1.0, np.nan], "b": [3.0, 4.0]}, index=pd.to_timedelta([0.0, 0.5], unit="s"))
    made = kalscope.Recording.from_frame(frame)
    assert (made.names, made.sample_period) == (("a", "b"), 0.5)
    np.testing.assert_array_equal(made["b"], [3.0, 4.0])
    with pytest.raises(kalscope.BadSetting, match="channel must be one of a, b"):
        kalscope.tune(made)
    tuned = kalscope.tune(recording)
    long = kalscope.kalman_filter(recording.values, tuned.params)
    found = kalscope.estimate(recording.values[:, 0])
    for one in (recording, tuned, tuned.result, found, kalscope.diagnose(tuned.result), long):
        assert len(repr(one)) < 2500
    assert "<script>" not in kalscope.Recording.from_frame(frame.rename(columns={"a": "<script>"}))._repr_html_()
    assert tuned.message[:20] in tuned._repr_html_()
