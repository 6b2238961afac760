"""The filter that fuses several sensors, in a tuning and in its file."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.errors import BadFile, BadSetting
from kalscope.filtering.classic import Chain
from kalscope.filtering.params import MAX_MOMENTUM, MAX_VARIANCE
from kalscope.tuning.file import dumps, load_tuning, loads, save_tuning
from kalscope.tuning.toml_text import updated
from kalscope.tuning.tuning import ChannelTuning, Tuning, rescaled_to_period

FUSED = ChannelTuning(
    name="level",
    unit="cm",
    sensors=("sonar", "float # 2"),
    q=0.25,
    r=(4.0, 0.09),
    offset=(0.0, -1.5),
    gain=(1.0, 1.02),
    momentum=12.5,
    how="maximum likelihood",
)
BOTH = Tuning(
    (ChannelTuning("sonar", "cm", 0.25, 4.0), ChannelTuning("float # 2", "cm", 0.2, 0.09)),
    sample_period=0.01,
    fusion=FUSED,
)
positive = st.floats(0.0, MAX_VARIANCE, exclude_min=True)
estimates = st.floats(allow_nan=False, allow_infinity=False)
noises = st.floats(1e-290, 1e290)  # what stays a variance where it is divided by the square of a gain
offsets = st.floats(-1e200, 1e200)
gains = st.floats(1e-3, 1e3) | st.floats(-1e3, -1e-3)


@st.composite
def fusions(draw: st.DrawFn) -> ChannelTuning:
    sensors = draw(st.lists(st.text(max_size=20), min_size=1, max_size=4, unique=True))
    r, offset, gain = (tuple(draw(values) for _ in sensors) for values in (noises, offsets, gains))
    p0 = draw(st.none() | positive)
    x0 = None if p0 is None else draw(st.none() | estimates)
    gate, momentum = draw(st.none() | positive), draw(st.floats(0.0, MAX_MOMENTUM))
    name, unit, how = (draw(st.text(max_size=20)) for _ in range(3))
    return ChannelTuning(
        name, unit, draw(positive), r, p0, x0, how, gate, momentum, None, tuple(sensors), offset, gain
    )


def bits(fusion: ChannelTuning) -> list[str]:
    """Every float, sign of zero included."""
    one = (fusion.q, fusion.p0, fusion.x0, fusion.gate, fusion.momentum)
    values = (*one, *fusion.r, *fusion.offset, *fusion.gain)
    return ["none" if value is None else value.hex() for value in values]


# ---- the values


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"sensors": ("a", "a")}, r"sensors of a fusion must have distinct names \(got \['a', 'a'\]\)"),
        ({"sensors": ("a",)}, r"one value per sensor \(got 2 for 1 sensors\)"),
        ({"sensors": ()}, "^r of a channel must be one number"),
        *(({"chain": Chain(3)}, "^a chain filters one channel"), ({"r": (0.0, 0.0)}, "^at most one r may be 0")),
        *(({"r": (1.0, -1.0)}, "^r must"), ({"offset": (0.0, float("nan"))}, "^offset must")),
        *(({"gain": (1.0, 0.0)}, "^gain must"), ({"x0": 1.0}, "x0 needs p0")),
    ],
)
def test_values_that_are_no_fusion_are_refused(changed: dict, says: str) -> None:
    with pytest.raises(BadSetting, match=says):
        replace(FUSED, **changed)


# ---- another sample period


def test_q_and_momentum_of_a_fusion_follow_the_sample_period_and_nothing_else_does() -> None:
    moved = BOTH.rescaled(0.02).fusion
    assert moved == replace(FUSED, q=0.5, momentum=6.25)
    assert BOTH.rescaled(0.01) == BOTH
    said = rescaled_to_period(BOTH, 0.02).fusion
    assert said == replace(moved, how="at 0.01 s: maximum likelihood; q times 2 and momentum divided by it")


# ---- the file


@pytest.mark.slow
@given(fusions())
def test_a_fusion_comes_back_from_its_text_bit_for_bit_and_over_any_other(fusion: ChannelTuning) -> None:
    from kalscope.tuning.file import _plain

    tuning = replace(BOTH, fusion=fusion)
    assert bits(loads(dumps(tuning)).fusion) == bits(fusion)
    for again in (loads(dumps(tuning)), loads(updated(dumps(BOTH), _plain(tuning)))):
        assert again == tuning


def test_saving_over_an_annotated_fusion_keeps_comments_and_keys_until_it_goes(tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    noted = dumps(BOTH).replace("[fusion]", "[fusion] # the tank").replace("1.02 #", "1.02 # bought 2019:")
    path.write_text(noted.replace("offset = -1.5", 'serial = "A7"\noffset = -1.5'), encoding="utf-8")
    assert load_tuning(path) == BOTH
    changed = replace(FUSED, q=0.5, r=(4.0, 0.08))
    save_tuning(replace(BOTH, fusion=changed), path)
    text = path.read_text("utf-8")
    assert load_tuning(path).fusion == changed
    for kept in ('serial = "A7"', "[fusion] # the tank", "q = 0.5 # process-noise", "1.02 # bought 2019:"):
        assert kept in text
    save_tuning(replace(BOTH, fusion=None), path)
    text = path.read_text("utf-8")
    assert (text.splitlines()[1], "fusion" in text) == ("format = 1", False)
    assert load_tuning(path) == replace(BOTH, fusion=None)


def fused(*lines: str, head: str = 'name = "x"\nq = 1') -> str:
    channel = '[[channel]]\nname = "a"\nq = 1\nr = 1'
    return "\n".join(["format = 3", channel, "[fusion]", head, *lines, ""])


SENSOR = '[[fusion.sensors]]\nname = "a"\nr = 1'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (fused(SENSOR, head="q = 1"), "Object missing required field `name` - at `$.fusion`"),
        (fused(), "Object missing required field `sensors` - at `$.fusion`"),
        (fused("sensors = []"), "Expected `array` of length >= 1 - at `$.fusion.sensors`"),
        (fused('[[fusion.sensors]]\nname = "a"'), "missing required field `r` - at `$.fusion.sensors[0]`"),
        (fused(SENSOR, "gain = '1'"), "Expected `float`, got `str` - at `$.fusion.sensors[0].gain`"),
        (fused(SENSOR.replace("r = 1", "r = -1")), "'x': r must"),
        (fused(SENSOR, SENSOR), "'x': sensors of a fusion must have distinct names (got ['a', 'a'])"),
        (fused(*(SENSOR.replace('"a"', f'"a{i}"') + f"\ngain = {i}" for i in range(500))), "'x': gain must"),
    ],
)
def test_hostile_text_is_refused_in_one_line_that_says_what_came(text: str, says: str) -> None:
    with pytest.raises(BadFile, match=re.escape(says)) as caught:
        loads(text)
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 300
