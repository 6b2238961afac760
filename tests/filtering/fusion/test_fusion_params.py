"""The parameters of a fused filter: what they must be, and that they are values."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from kalscope import BadSetting, FilterParams

R = np.array([1.0, 4.0])


@each(
    ("wrong", "message"),
    [
        ({"r": 1.0}, "r must be one variance per sensor"),
        ({"r": []}, "r must be"),
        ({"r": [1.0, -1.0]}, "r must be a finite variance"),
        ({"r": [[1.0]]}, "r must be"),
        ({"r": [0.0, 0.0]}, "at most one r may be 0"),
        ({"q": 0.0, "r": [0.0, 1.0]}, "q and r must not both be 0"),
        ({"q": np.array([1.0, 1.0])}, "q must be one number for all sensors"),
        ({"gate": np.array([9.0, 9.0])}, "gate must be one number for all sensors"),
        ({"x0": 1.0}, "x0 needs p0"),
        ({"momentum": -1.0}, "momentum must be"),
        ({"offset": [1.0]}, r"offset must be one number per sensor, shape \(2,\)"),
        ({"offset": [1.0, np.nan]}, "offset must be"),
        ({"offset": "ab"}, "offset must be one finite number"),
        ({"gain": [1.0, 0.0]}, "gain must not be 0"),
        ({"gain": [1.0, np.inf]}, "gain must be"),
        ({"gain": [1.0, 1e-101]}, "gain must not be 0"),
        ({"r": [1e200, 1.0], "gain": [1e-90, 1.0]}, "r/gain² must be"),
        ({"r": [1e-200, 1.0], "gain": [1e90, 1.0]}, "r/gain² must be"),
    ],
)
def test_what_cannot_be_is_refused_with_what_came(wrong, message):
    with pytest.raises(BadSetting, match=message):
        FilterParams(**{"q": 1.0, "r": R, **wrong})


def test_they_are_values():
    one = FilterParams(1.0, R, gate=9.0)
    other = FilterParams(1, [1, 4], offset=[0, 0], gain=(1, 1), gate=9)  # pyright: ignore
    assert one == other
    assert hash(one) == hash(other)
    assert one != FilterParams(1.0, R)
    assert one != FilterParams(1.0, R, gain=[1.0, 2.0], gate=9.0)
    R_before = R.copy()
    with pytest.raises(ValueError, match="read-only"):
        one.r[0] = 5.0
    np.testing.assert_array_equal(R, R_before)


def test_some_sensors_are_a_fused_filter_too():
    params = FilterParams(1.0, [1.0, 2.0, 4.0], [0.0, 1.0, 2.0], [1.0, -1.0, 2.0], 3.0, 0.5, 9.0, 7.0)
    assert params.only([2, 0]) == FilterParams(1.0, [4.0, 1.0], [2.0, 0.0], [2.0, 1.0], 3.0, 0.5, 9.0, 7.0)
    assert params.shares.tolist() == pytest.approx([0.4, 0.2, 0.4])


@each("indices", [[9], [-3], []])
def test_sensors_that_are_not_there_are_refused(indices):
    with pytest.raises(BadSetting, match="indices must be those of sensors, 0 to 1"):
        FilterParams(1.0, R).only(indices)
