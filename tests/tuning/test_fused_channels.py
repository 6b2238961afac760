from __future__ import annotations

import math

import pytest

from kalscope.errors import BadSetting
from kalscope.tuning.choose import channels_to_fuse, for_each_sensor, named_numbers

UNITS = {"a": "°C", "b": "°C", "p, sea": "hPa", "p, top": "hPa", "flag": ""}


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("a,b", ("a", "b")),
        (" b , a ", ("b", "a")),
        ("1,2", ("a", "b")),
        ("3,4", ("p, sea", "p, top")),
        ("a", None),
        ("a,a", None),
        ("a,1", None),
        ("a,0", None),
    ],
)
def test_channels_are_named_or_counted(text: str, names: tuple[str, ...] | None) -> None:
    if names is None:
        with pytest.raises(BadSetting, match=r"of one unit, of a, b, p, sea, p, top, flag \(got"):
            channels_to_fuse(UNITS, text)
    else:
        assert channels_to_fuse(UNITS, text) == names


@pytest.mark.parametrize(("text", "got"), [("a,3", "a in °C, p, sea in hPa"), ("a,flag", "flag without a unit")])
def test_two_units_are_refused_unless_the_gains_are_estimated(text: str, got: str) -> None:
    with pytest.raises(BadSetting, match=f"must have one unit .*{got}.*--sensor-gains"):
        channels_to_fuse(UNITS, text)
    assert len(channels_to_fuse(UNITS, text, mixed_units=True)) == 2


def test_numbers_belong_to_the_sensors_that_they_name() -> None:
    given = named_numbers("b=9, a=4", float)
    assert given == {"b": 9.0, "a": 4.0}
    assert for_each_sensor(("a", "b"), "--r", given) == (4.0, 9.0)
    assert for_each_sensor(("a", "b"), "--r", 5.0) == (5.0, 5.0)
    first, second = for_each_sensor(("a", "b"), "--r", {"2": 3.0})
    assert math.isnan(first)
    assert second == 3.0
    with pytest.raises(BadSetting, match=r"--r must be a sensor of --fuse: a, b \(got 'c'\)"):
        for_each_sensor(("a", "b"), "--r", {"c": 1.0})
    assert named_numbers("a=1,a=2", float) == named_numbers("=1", float) == {}
