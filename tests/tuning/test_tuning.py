"""A tuning: its values, its file, and another sample period."""

from __future__ import annotations

import os
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope import export_tuning
from kalscope.errors import BadFile, BadSetting
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import MAX_MOMENTUM, MAX_VARIANCE
from kalscope.tuning.file import dumps, load_tuning, loads, save_tuning
from kalscope.tuning.toml_text import updated
from kalscope.tuning.tuning import ChannelTuning, Tuning, rescaled_to_period

variances = st.floats(0.0, MAX_VARIANCE)
positive = st.floats(0.0, MAX_VARIANCE, exclude_min=True)
estimates = st.floats(allow_nan=False, allow_infinity=False)
words = st.text(max_size=30) | st.sampled_from(['"', "'", '"""', "\n", "\r\n", "\t", "\\", "\0", "\x7f", "# x"])

TWO = Tuning(
    (ChannelTuning("a", "V", 1e-3, 1.0), ChannelTuning("b", "°C", 2.0, 1.0, p0=4.0, x0=-1.5, how="EM")),
    source="logs/x.csv",
    source_name="x.csv",
    sha256="ab" * 32,
    sample_period=0.01,
    selected="b",
)

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


@st.composite
def channel_tunings(draw: st.DrawFn) -> ChannelTuning:
    q, r = draw(variances), draw(variances)
    if q == 0.0 and r == 0.0:
        r = draw(positive)
    p0 = draw(st.none() | variances)
    x0 = None if p0 is None else draw(st.none() | estimates)
    gate = draw(st.none() | positive)
    momentum = draw(st.just(0.0) | st.floats(0.0, MAX_MOMENTUM))
    return ChannelTuning(draw(words), draw(words), q, r, p0, x0, draw(words), gate, momentum)


@st.composite
def tunings(draw: st.DrawFn) -> Tuning:
    channels = draw(st.lists(channel_tunings(), min_size=1, max_size=4, unique_by=lambda c: c.name))
    return Tuning(
        tuple(channels),
        *(draw(words) for _ in range(3)),
        sample_period=draw(st.none() | positive),
        selected=draw(st.sampled_from(channels)).name,
        tool=draw(words),
        date=draw(words),
    )


def bits(tuning: Tuning) -> list[str]:
    """Every float, sign of zero included."""
    return [
        "none" if value is None else value.hex()
        for c in tuning.channels
        for value in (c.q, c.r, c.p0, c.x0, c.gate, c.momentum, tuning.sample_period)
    ]


# ---- the text and back


@pytest.mark.slow
@given(tunings())
def test_a_tuning_comes_back_from_its_text_bit_for_bit(tuning: Tuning) -> None:
    again = loads(dumps(tuning))
    assert again == tuning
    assert bits(again) == bits(tuning)


@pytest.mark.slow
@given(tunings(), tunings())
def test_saving_over_any_tuning_saves_every_value(old: Tuning, new: Tuning) -> None:
    from kalscope.tuning.file import _plain

    assert loads(updated(dumps(old), _plain(new))) == new


def test_names_with_lone_surrogates_still_make_a_readable_file() -> None:
    tuning = Tuning((ChannelTuning("a", "", 1.0, 1.0),), source="caf\udce9.csv")
    assert loads(dumps(tuning)).source == "caf?.csv"


# ---- the file


def test_saving_over_an_annotated_file_changes_only_the_values_that_changed(tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    path.write_text(ANNOTATED, encoding="utf-8")
    old = load_tuning(path)
    b = replace(old.channel("b"), q=0.25, p0=None, x0=None, gate=None)
    save_tuning(replace(old, channels=(old.channel("a"), b)), path)
    lines = path.read_text(encoding="utf-8").splitlines()
    removed = [line for line in ANNOTATED.splitlines() if line not in lines]
    assert removed == ["date = 2026-01-02", "q = 2.0 # too much?", "p0 = 4", "x0 = -1.5", "gate = 9.0 # spikes"]
    assert "q = 0.25 # too much?" in lines
    assert "r = 1 # from the data sheet" in lines


def test_comments_survive_new_and_lost_and_reordered_channels(tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    path.write_text(ANNOTATED, encoding="utf-8")
    old = load_tuning(path)
    c = ChannelTuning("c", "m", 3.0, 4.0)
    save_tuning(replace(old, channels=(c, old.channel("a"))), path)
    assert [channel.name for channel in load_tuning(path).channels] == ["c", "a"]
    text = path.read_text(encoding="utf-8")
    for comment in (
        *("# the rig in the cellar", "# do not touch", "# left foot", "# found by hand", 'site = "cellar"'),
    ):
        assert comment in text
    assert "too much" not in text


TABLES = 'channel = [{name = "a", q = 1, r = 1}, {name = "b", q = 1, r = 1}]'


@pytest.mark.parametrize("content", ["", "format = 1\nchannel = 3\n", f"format = 1\n{TABLES}\n"])
def test_a_layout_that_cannot_be_updated_is_replaced(tmp_path: Path, content: str) -> None:
    path = tmp_path / "t.toml"
    path.write_text(content)
    save_tuning(TWO, path)
    assert load_tuning(path) == TWO


@pytest.mark.parametrize("content", ["time,a\n0,1\n", "format = 6\n", "q = 1\n", "\0\1\2"])
def test_a_file_that_is_no_tuning_is_never_saved_over(tmp_path: Path, content: str) -> None:
    path = tmp_path / "recording.csv"
    path.write_text(content)
    with pytest.raises(BadFile, match=r"recording\.csv' must be a tuning file to be overwritten"):
        save_tuning(TWO, path)
    assert path.read_text() == content


@pytest.mark.slow
def test_a_tuning_too_large_to_be_read_again_is_not_saved(tmp_path: Path) -> None:
    tuning = Tuning((ChannelTuning("a", "", 1.0, 1.0),), source="x" * 1_000_001)
    with pytest.raises(BadSetting, match="1000000"):
        save_tuning(tuning, tmp_path / "t.toml")
    assert os.listdir(tmp_path) == []


def test_files_by_windows_notepad_load(tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    path.write_bytes(b"\xef\xbb\xbf" + dumps(TWO).replace("\n", "\r\n").encode())
    assert load_tuning(path) == TWO


def test_unknown_keys_are_ignored_and_optional_ones_have_defaults() -> None:
    text = 'format = 1\nfuture = [1, {a = 2}]\n[extra]\nq = 1\n[[channel]]\nname = "a"\nq = 1\nr = 0\nnote = 3\n'
    assert loads(text).channels == (ChannelTuning("a", "", 1.0, 0.0, how=""),)


def channel(*lines: str) -> str:
    return "\n".join(["format = 1", "[[channel]]", *lines, ""])


def only(*lines: str) -> str:
    return channel('name = "a"', "q = 1", "r = 1", *lines)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "format must be 1, 2, 3, 4 or 5 (got None)"),
        ("format = 6", "format must be 1, 2, 3, 4 or 5: a newer Kalscope may have written this file (got 6)"),
        ("format = true", "format must be 1, 2, 3, 4 or 5 (got True)"),
        (only("momentum = 2e5"), "'a': momentum must be a number of sample periods from 0 to 1e5 (got"),
        (only("momentum = true"), "Expected `float | null`, got `bool` - at `$.channel[0].momentum`"),
        ("format = 1", "Object missing required field `channel`"),
        ("format = 1\nchannel = []", "tuning must hold at least one channel (got none)"),
        ("format = 1\nchannel = [5]", "Expected `object`, got `int` - at `$.channel[0]`"),
        (channel("q = 1", "r = 1"), "Object missing required field `name` - at `$.channel[0]`"),
        (channel('name = "a"', "q = 1"), "'a': r must be a finite variance from 0 to 1e300 (got None)"),
        (channel('name = "a"', 'q = "1"', "r = 1"), "Expected `float`, got `str` - at `$.channel[0].q`"),
        (channel('name = "a"', "q = nan", "r = 1"), "'a': q must be a finite variance from 0 to 1e300 (got nan)"),
        (channel('name = "a"', f"q = 1{'0' * 400}", "r = 1"), "Number out of range - at `$.channel[0].q`"),
        (channel('name = "a"', f"q = 1{'0' * 5000}", "r = 1"), "must be TOML text (got: Exceeds the limit"),
        (channel('name = "a"', "q = 0", "r = 0"), "q and r must not both be 0"),
        *((only('p0 = "x"'), "Invalid enum value 'x' - at `$.channel[0].p0`"), (only("x0 = 1"), "x0 needs p0")),
        (only() + '[[channel]]\nname = "a"\nq = 1\nr = 1', "distinct names"),
        ("selected = 'z'\n" + only(), "selected must be one of ['a'] (got 'z')"),
        ("source = 5\n" + only(), "Expected `object`, got `int` - at `$.source`"),
        ("source.sample_period = 0\n" + only(), "sample_period must be a finite number above 0"),
        ("not toml at all", "must be TOML text (got: "),
        ("x = " + "[" * 100_000, "must be TOML text (got brackets nested without end)"),
        ("x" * 1_000_001, "at most 1000000 characters (got 1000001)"),
    ],
)
def test_hostile_text_is_refused_in_one_line_that_says_what_came(text: str, says: str) -> None:
    with pytest.raises(BadFile) as caught:
        loads(text)
    assert says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    "bomb",
    [
        "a." * 400_000 + "a = 1",
        '"a"\t. ' * 100_000 + "a = 1",
        "x = {" + "'a'." * 200_000 + "a = 1}",
        "[" + "a." * 400_000 + "a]",
        'x = {k = """\n""", ' + "a." * 200_000 + 'a = 1, z = "1"}',
        "x = 1 # it's\n" + "a." * 200_000 + "a = 'x'",
    ],
    ids=["bare", "quoted", "inline", "header", "after a long string", "after a comment"],
)
def test_deep_keys_are_refused_before_they_eat_the_memory(bomb: str) -> None:
    started = time.process_time()
    with pytest.raises(BadFile, match="nested at most 64 deep"):
        loads(bomb)
    assert time.process_time() - started < 2.0


def test_dots_in_strings_and_comments_are_no_deep_keys() -> None:
    dots = "a." * 200 + "z"
    tuning = Tuning((ChannelTuning(dots, "", 1.0, 1.0),), source=dots, selected=dots)
    assert loads(dumps(tuning) + f"\n# {dots}\n") == tuning


@pytest.mark.parametrize(
    ("make", "says"),
    [
        *((lambda _: None, "does not exist"), (lambda path: path.mkdir(), "is a folder|no permission")),
        (lambda path: path.write_bytes(bytes(range(256))), "UTF-8"),
        (lambda path: path.write_bytes("format = 1".encode("utf-16")), "UTF-8"),
        (lambda path: path.write_bytes(b"#" * 1_000_001), "at most 1000000 bytes"),
        (lambda path: path.write_bytes(b"a\0"), "TOML"),
    ],
    ids=["missing", "folder", "binary", "utf-16", "large", "NUL"],
)
def test_files_that_are_no_tuning_are_refused_in_one_line_with_their_name(tmp_path: Path, make, says: str) -> None:
    path = tmp_path / "t\n.toml"
    make(path)
    with pytest.raises(BadFile, match=says) as caught:
        load_tuning(path)
    assert "t\\n.toml" in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@given(st.binary(max_size=200) | st.binary(max_size=60).map(lambda tail: dumps(TWO).encode()[:300] + tail))
def test_any_bytes_load_or_are_refused(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.mktemp("any") / "t.toml"
    path.write_bytes(data)
    refusal = "one line"
    try:
        load_tuning(path)
    except BadFile as error:
        refusal = str(error)
    assert len(refusal.splitlines()) == 1


# ---- momentum


def test_a_rescaled_filter_with_momentum_sees_the_same_signal() -> None:
    """Twice as fine: every second sample missing, the estimates at the others are the same."""
    z = np.random.default_rng(7).normal(size=200).cumsum()
    fine = np.full(400, np.nan)
    fine[1::2] = z
    tuning = Tuning((ChannelTuning("a", "", 0.3, 2.0, 4.0, 0.5, momentum=6.0),), sample_period=0.01)
    coarse = kalman_filter(z, tuning.channel("a").params)
    halved = kalman_filter(fine, tuning.rescaled(0.005).channel("a").params)
    np.testing.assert_allclose(halved.x[1::2], coarse.x, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(halved.p[1::2], coarse.p, rtol=1e-12)


# ---- the values


@given(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6))
def test_q_follows_the_sample_period_and_nothing_else_does(old: float, new: float) -> None:
    tuning = replace(TWO, sample_period=old)
    moved = tuning.rescaled(new)
    assert moved.sample_period == new
    for before, after in zip(tuning.channels, moved.channels, strict=True):
        assert after.q == pytest.approx(before.q * new / old, rel=1e-15)
        assert replace(after, q=before.q) == before  # neither has momentum


def test_rescaling_needs_both_periods() -> None:
    with pytest.raises(BadSetting, match="must be known"):
        replace(TWO, sample_period=None).rescaled(0.01)
    with pytest.raises(BadSetting, match="sample_period must be a finite number above 0"):
        TWO.rescaled(-1.0)


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
