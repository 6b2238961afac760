from dataclasses import replace

import numpy as np
import pytest

from kalscope.errors import BadSetting, KalscopeError
from kalscope.recording import Recording


@pytest.fixture
def recording():
    values = np.array([[1.0, 10.0], [2.0, 20.0], [3.0, 30.0]])
    return Recording(np.arange(3.0), ("a", "b"), ("V", ""), values, 1.0)


def test_an_unknown_channel_is_refused_with_the_choices(recording):
    with pytest.raises(BadSetting, match=r"channel must be one of a, b \(got 'c'\)") as caught:
        recording.channel("c")
    assert isinstance(caught.value, KalscopeError)
    assert isinstance(caught.value, ValueError)
    assert recording.channel("b").tolist() == [10, 20, 30]


def test_steps_are_nominal_periods_and_steps_back_are_none(recording):
    uneven = replace(recording, time=np.array([0.0, 3.0, 2.0]), sample_period=2.0)
    assert uneven.steps().tolist() == [1.0, 1.5, 0.0]
    assert recording.steps().tolist() == [1.0, 1.0, 1.0]


def test_steps_need_time(recording):
    with pytest.raises(BadSetting, match="dt needs a recording with time"):
        replace(recording, sample_period=None).steps()
