"""A tuning: every value comes back from its file, comments stay, hostile files; and another sample period."""

from __future__ import annotations

import os
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope import kalman_filter
from kalscope.classic import Butterworth, Chain, Exponential, Median, MovingAverage, Notch, OneEuro
from kalscope.errors import BadFile, BadSetting
from kalscope.filtering.classic import ChainFilter
from kalscope.filtering.params import MAX_MOMENTUM, MAX_VARIANCE
from kalscope.tuning.choose import rescaled
from kalscope.tuning.file import dumps, load_tuning, loads, save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning, rescaled_to_period

TWO = Tuning(
    (ChannelTuning("a", "V", 1e-3, 1.0), ChannelTuning("b", "°C", 2.0, 1.0, p0=4.0, x0=-1.5, how="EM")),
    source="logs/x.csv",
    source_name="x.csv",
    sha256="ab" * 32,
    sample_period=0.01,
    selected="b",
)
FUSED = ChannelTuning(
    "level", "cm", 0.25, (4.0, 0.09), momentum=12.5, sensors=("a", "b"), offset=(0.0, -1.5), gain=(1.0, 1.02)
)
CHAINS = (
    *(Chain(5), Chain(1, MovingAverage(9)), Chain(3, Exponential(0.1)), Chain(3, Median(9))),
    *(Chain(7, Butterworth(1 / 3)), Chain(5, OneEuro(0.02, 1e-7, 0.1)), Chain(notch=Notch(0.2, 1 / 30))),
    Chain(3, MovingAverage(9), Notch(0.2, 1 / 30)),
)


def with_chain(chain):
    return replace(TWO, channels=(replace(TWO.channels[0], chain=chain), TWO.channels[1]))


# ---- every value comes back


variances = st.floats(0.0, MAX_VARIANCE)
positive = st.floats(0.0, MAX_VARIANCE, exclude_min=True)
words = st.text(max_size=30) | st.sampled_from(['"', "'", '"""', "\n", "\r\n", "\t", "\\", "\0", "\x7f", "# x"])
noises = st.floats(1e-290, 1e290)  # what stays a variance where it is divided by the square of a gain
offsets = st.floats(-1e200, 1e200)
gains = st.floats(1e-3, 1e3) | st.floats(-1e3, -1e-3)


@st.composite
def filters(draw, sensors=()):
    """The filter of a channel, or that of these sensors."""
    q, r = draw(positive), draw(variances)
    p0 = draw(st.none() | (positive if sensors else variances))
    x0 = None if p0 is None else draw(st.none() | st.floats(allow_nan=False, allow_infinity=False))
    gate, momentum = draw(st.none() | positive), draw(st.just(0.0) | st.floats(0.0, MAX_MOMENTUM))
    name, unit, how = draw(words), draw(words), draw(words)
    if sensors:
        r, offset, gain = (tuple(draw(values) for _ in sensors) for values in (noises, offsets, gains))
        return ChannelTuning(name, unit, q, r, p0, x0, how, gate, momentum, None, sensors, offset, gain)
    if draw(st.booleans()):
        fast, spikes = draw(st.floats(2.0, 1e12)), draw(st.floats(0.0, 0.5))
        return ChannelTuning(name, unit, q, draw(positive), p0, x0, how, fast=fast, spikes=spikes)
    if draw(st.booleans()):
        q, r = 0.0, draw(positive)
    return ChannelTuning(name, unit, q, r, p0, x0, how, gate, momentum, draw(st.none() | st.sampled_from(CHAINS)))


@st.composite
def tunings(draw):
    channels = draw(st.lists(filters(), min_size=1, max_size=4, unique_by=lambda one: one.name))
    sensors = draw(st.lists(st.text(max_size=20), min_size=1, max_size=4, unique=True))
    return Tuning(
        tuple(channels),
        *(draw(words) for _ in range(3)),
        sample_period=draw(st.none() | positive),
        selected=draw(st.sampled_from(channels)).name,
        tool=draw(words),
        date=draw(words),
        fusion=draw(st.none() | filters(tuple(sensors))),
    )


@pytest.mark.slow
@given(tunings(), tunings())
def test_a_tuning_comes_back_from_its_file_to_the_last_bit_over_any_other(tmp_path_factory, old, new):
    path = tmp_path_factory.mktemp("any") / "t.toml"
    for tuning in (old, new):
        save_tuning(tuning, path)
        assert load_tuning(path) == tuning
        assert repr(load_tuning(path)) == repr(tuning)  # the sign of zero too


@pytest.mark.slow
def test_a_chain_leaves_no_key_of_the_one_before(tmp_path):
    path = tmp_path / "t.toml"
    for chain in (*CHAINS, *CHAINS[::-1], None):
        tuning = with_chain(chain)
        save_tuning(tuning, path)
        text = path.read_text("utf-8")
        assert load_tuning(path) == tuning
        assert text.count(" = ") == dumps(tuning).count(" = ")
        assert text.splitlines()[1] == f"format = {1 if chain is None else 5 if chain.notch else 4}"
    assert "chain" not in text


def test_what_other_programs_write_is_read(tmp_path):
    path = tmp_path / "t.toml"
    path.write_bytes(b"\xef\xbb\xbf" + dumps(TWO).replace("\n", "\r\n").encode())  # Notepad
    assert load_tuning(path) == TWO
    assert loads(dumps(replace(TWO, source="caf\udce9.csv"))).source == "caf?.csv"
    text = 'format = 1\nfuture = [1, {a = 2}]\n[extra]\nq = 1\n[[channel]]\nname = "a"\nq = 1\nr = 0\nnote = 3\n'
    assert loads(text).channels == (ChannelTuning("a", "", 1.0, 0.0, how=""),)
    older = only('momentum = 0\n[channel.chain]\nmedian = 3\nfilter = "power-of-two"\nshift = 3')
    assert loads(older).channels[0].chain == Chain(3, Exponential(0.125))
    dots = "a." * 200 + "z"  # no deep keys in strings and comments
    assert loads(dumps(replace(TWO, source=dots)) + f"\n# {dots}\n").source == dots


# ---- saving over a file


ANNOTATED = """\
# the rig in the cellar
format = 1 # do not touch
site = "cellar"
date = 2026-01-02

[source]
name = "x.csv" # from Tuesday
sample_period = 1e-2

[[channel]] # the good one
name = "a" # left foot
unit = "V"
q = 1e-3 # found by hand
r = 1 # from the data sheet
noise = { colour = "pink" }
# about b

[[channel]]
name = "b"
unit = "°C"
q = 2.0 # too much?
r = 1.0
p0 = 4
x0 = -1.5
gate = 9.0 # spikes
"""


@pytest.fixture
def path(tmp_path):
    """A tuning file that was annotated by hand."""
    path = tmp_path / "t.toml"
    path.write_text(ANNOTATED, encoding="utf-8")
    return path


def test_saving_over_an_annotated_file_changes_only_the_values_that_changed(path):
    old = load_tuning(path)
    b = replace(old.channel("b"), q=0.25, p0=None, x0=None, gate=None)
    save_tuning(replace(old, channels=(old.channel("a"), b)), path)
    lines = path.read_text(encoding="utf-8").splitlines()
    removed = [line for line in ANNOTATED.splitlines() if line not in lines]
    assert removed == ["date = 2026-01-02", "q = 2.0 # too much?", "p0 = 4", "x0 = -1.5", "gate = 9.0 # spikes"]
    assert "q = 0.25 # too much?" in lines
    assert "r = 1 # from the data sheet" in lines


def test_comments_survive_new_and_lost_and_reordered_channels_and_a_fusion_until_it_goes(path):
    old = load_tuning(path)
    changed = replace(old, channels=(ChannelTuning("c", "m", 3.0, 4.0), old.channel("a")))
    save_tuning(changed, path)
    assert load_tuning(path).channels == changed.channels
    text = path.read_text(encoding="utf-8")
    for kept in ("# the rig in the cellar", "# do not touch", "# left foot", "# found by hand", 'site = "cellar"'):
        assert kept in text
    assert "too much" not in text
    both = replace(TWO, fusion=FUSED)
    text = dumps(both).replace("[fusion]", "[fusion] # the tank").replace("1.02 #", "1.02 # bought 2019:")
    path.write_text(text.replace("offset = -1.5", 'serial = "A7"\noffset = -1.5'), encoding="utf-8")
    assert load_tuning(path) == both
    both = replace(both, fusion=replace(FUSED, q=0.5, r=(4.0, 0.08)))
    save_tuning(both, path)
    assert load_tuning(path) == both
    text = path.read_text("utf-8")
    for kept in ('serial = "A7"', "[fusion] # the tank", "q = 0.5 # process-noise", "1.02 # bought 2019:"):
        assert kept in text
    save_tuning(TWO, path)
    text = path.read_text("utf-8")
    assert (text.splitlines()[1], "fusion" in text, load_tuning(path)) == ("format = 1", False, TWO)


TABLES = 'channel = [{name = "a", q = 1, r = 1}, {name = "b", q = 1, r = 1}]'


@pytest.mark.parametrize("content", ["", "format = 1\nchannel = 3\n", f"format = 1\n{TABLES}\n"])
def test_a_layout_that_cannot_be_updated_is_replaced(tmp_path, content):
    path = tmp_path / "t.toml"
    path.write_text(content)
    save_tuning(TWO, path)
    assert load_tuning(path) == TWO


def test_neither_a_file_that_is_no_tuning_nor_one_too_large_to_read_again_is_saved(tmp_path):
    path = tmp_path / "recording.csv"
    for content in ("time,a\n0,1\n", "format = 6\n", "q = 1\n", "\0\1\2"):
        path.write_text(content)
        with pytest.raises(BadFile, match=r"recording\.csv' must be a tuning file to be overwritten"):
            save_tuning(TWO, path)
        assert path.read_text() == content
    with pytest.raises(BadSetting, match="1000000"):
        save_tuning(replace(TWO, source="x" * 1_000_001), tmp_path / "t.toml")
    assert os.listdir(tmp_path) == ["recording.csv"]


# ---- hostile files


def channel(*lines):
    return "\n".join(["format = 1", "[[channel]]", *lines, ""])


def only(*lines):
    return channel('name = "a"', "q = 1", "r = 1", *lines)


def chained(*lines):
    return only("[channel.chain]", *lines)


def fused(*lines):
    return "\n".join([only(), "[fusion]", 'name = "x"', "q = 1", *lines, ""])


SENSOR = '[[fusion.sensors]]\nname = "a"\nr = 1'
HOSTILE = [
    ("", "format must be 1, 2, 3, 4 or 5 (got None)"),
    ("format = 6", "format must be 1, 2, 3, 4 or 5: a newer Kalscope may have written this file (got 6)"),
    ("format = true", "format must be 1, 2, 3, 4 or 5 (got True)"),
    (only("momentum = 2e5"), "'a': momentum must be a number of sample periods from 0 to 1e5 (got"),
    ("format = 1", "Object missing required field `channel`"),
    ("format = 1\nchannel = []", "tuning must hold at least one channel (got none)"),
    (channel("q = 1", "r = 1"), "Object missing required field `name` - at `$.channel[0]`"),
    (channel('name = "a"', "q = 1"), "'a': r must be a finite variance from 0 to 1e300 (got None)"),
    (channel('name = "a"', 'q = "1"', "r = 1"), "Expected `float`, got `str` - at `$.channel[0].q`"),
    (channel('name = "a"', "q = nan", "r = 1"), "'a': q must be a finite variance from 0 to 1e300 (got nan)"),
    (channel('name = "a"', f"q = 1{'0' * 400}", "r = 1"), "Number out of range - at `$.channel[0].q`"),
    (channel('name = "a"', f"q = 1{'0' * 5000}", "r = 1"), "must be TOML text (got: Exceeds the limit"),
    (channel('name = "a"', "q = 0", "r = 0"), "q and r must not both be 0"),
    (only('p0 = "x"'), "Invalid enum value 'x' - at `$.channel[0].p0`"),
    (only("x0 = 1"), "x0 needs p0"),
    (only() + '[[channel]]\nname = "a"\nq = 1\nr = 1', "distinct names"),
    ("selected = 'z'\n" + only(), "selected must be one of ['a'] (got 'z')"),
    ("source.sample_period = 0\n" + only(), "sample_period must be a finite number above 0"),
    ("not toml at all", "must be TOML text (got: "),
    ("x = " + "[" * 100_000, "must be TOML text (got brackets nested without end)"),
    ("x" * 1_000_001, "at most 1000000 characters (got 1000001)"),
    (chained("filter = 'moving-average'", "window = 1000000000"), "window must be a whole number from 1 to 100000"),
    (chained("filter = 'moving-average'", "window = 'ten'"), "'a': Expected `int`, got `str` - at `$.window`"),
    (chained("filter = 'median'", "window = 4"), "window must be an odd number of samples, such as 5 (got 4)"),
    (chained("filter = 'kalman'", "median = 100001"), "median must be a whole number from 1 to 99999 (got 100001"),
    (
        chained("filter = 'kalman'"),
        "a chain must have a median of at least 3 samples, a notch, or a filter in place",
    ),
    (chained("filter = 'exponential'", "alpha = 0"), "alpha must be a number from 9.31e-10 to 1 (got 0.0)"),
    (chained("filter = 'one-euro'", "cutoff = 1", "beta = -1", "speed_cutoff = 1"), "beta must be a number from 0"),
    (chained("filter = 'power-of-two'", "shift = -2"), "'a': "),
    (chained("filter = 'alpha-beta'"), 'filter of the chain must be "moving-average", "exponential"'),
    (fused("sensors = []"), "Expected `array` of length >= 1 - at `$.fusion.sensors`"),
    (fused(SENSOR, "gain = '1'"), "Expected `float`, got `str` - at `$.fusion.sensors[0].gain`"),
    (fused(SENSOR.replace("r = 1", "r = -1")), "'x': r must"),
    (fused(SENSOR, SENSOR), "'x': sensors of a fusion must have distinct names (got ['a', 'a'])"),
    (fused(*(SENSOR.replace('"a"', f'"a{i}"') + f"\ngain = {i}" for i in range(500))), "'x': gain must"),
]


@pytest.mark.parametrize(("text", "says"), HOSTILE)
def test_hostile_text_is_refused_in_one_line_that_says_what_came(text, says):
    with pytest.raises(BadFile) as caught:
        loads(text)
    assert says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 300


BOMBS = {
    "bare": "a." * 400_000 + "a = 1",
    "quoted": '"a"\t. ' * 100_000 + "a = 1",
    "inline": "x = {" + "'a'." * 200_000 + "a = 1}",
    "header": "[" + "a." * 400_000 + "a]",
    "after a long string": 'x = {k = """\n""", ' + "a." * 200_000 + 'a = 1, z = "1"}',
    "after a comment": "x = 1 # it's\n" + "a." * 200_000 + "a = 'x'",
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_deep_keys_are_refused_before_they_eat_the_memory(bomb):
    started = time.process_time()
    with pytest.raises(BadFile, match="nested at most 64 deep"):
        loads(BOMBS[bomb])
    assert time.process_time() - started < 2.0


@pytest.mark.parametrize(
    ("content", "says"),
    [
        *((None, "does not exist"), ("", "is a folder|no permission"), (bytes(range(256)), "UTF-8")),
        *(("format = 1".encode("utf-16"), "UTF-8"), (b"#" * 1_000_001, "at most 1000000 bytes"), (b"a\0", "TOML")),
    ],
    ids=["missing", "folder", "binary", "utf-16", "large", "NUL"],
)
def test_files_that_are_no_tuning_are_refused_in_one_line_with_their_name(tmp_path, content, says):
    path = tmp_path / "t\n.toml"
    if content is not None:
        path.write_bytes(content) if content else path.mkdir()
    with pytest.raises(BadFile, match=says) as caught:
        load_tuning(path)
    assert "t\\n.toml" in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@given(st.binary(max_size=200) | st.binary(max_size=60).map(lambda tail: dumps(TWO).encode()[:300] + tail))
def test_any_bytes_load_or_are_refused(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("any") / "t.toml"
    path.write_bytes(data)
    refusal = "one line"
    try:
        load_tuning(path)
    except BadFile as error:
        refusal = str(error)
    assert len(refusal.splitlines()) == 1


# ---- another sample period


@given(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6))
def test_q_follows_the_sample_period_and_nothing_else_does(old, new):
    tuning = replace(TWO, sample_period=old)
    moved = tuning.rescaled(new)
    assert moved.sample_period == new
    for before, after in zip(tuning.channels, moved.channels, strict=True):
        assert after.q == pytest.approx(before.q * new / old, rel=1e-15)
        assert replace(after, q=before.q) == before  # neither has momentum


def test_momentum_of_a_fusion_follows_too_and_both_periods_are_needed():
    both = replace(TWO, fusion=FUSED)
    moved = both.rescaled(0.02).fusion
    assert moved == replace(FUSED, q=0.5, momentum=6.25)
    assert both.rescaled(0.01) == rescaled_to_period(both, 0.01) == both
    how = "at 0.01 s: by hand; q times 2 and momentum divided by it"
    assert rescaled_to_period(both, 0.02).fusion == replace(moved, how=how)
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


@pytest.mark.slow
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
