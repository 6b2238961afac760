"""A chain in the tuning of a channel: its file, another sample period, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadFile, BadSetting, ChannelTuning, Tuning, load_tuning, save_tuning
from kalscope.classic import Butterworth, Chain, Exponential, Median, MovingAverage, Notch, OneEuro
from kalscope.filtering.classic import ChainFilter
from kalscope.tuning.choose import rescaled
from kalscope.tuning.file import dumps, loads
from kalscope.tuning.toml_text import chain_in
from kalscope.tuning.tuning import rescaled_to_period

PLAIN = Tuning((ChannelTuning("a", "V", 0.25, 2.0), ChannelTuning("b", "V", 1.0, 2.0)), sample_period=0.01)
CHAINS = (
    Chain(5),
    Chain(1, MovingAverage(9)),
    Chain(3, Exponential(0.1)),
    Chain(3, Median(9)),
    Chain(7, Butterworth(1 / 3)),
    Chain(5, OneEuro(0.02, 1e-7, 0.1)),
    Chain(notch=Notch(0.2, 1 / 30)),
    Chain(3, MovingAverage(9), Notch(0.2, 1 / 30)),
)


def with_chain(chain: Chain | None) -> Tuning:
    return replace(PLAIN, channels=(replace(PLAIN.channels[0], chain=chain), PLAIN.channels[1]))


@pytest.mark.slow
def test_every_chain_comes_back_from_a_file_and_leaves_no_key_of_the_one_before(tmp_path):
    path = tmp_path / "t.toml"
    for chain in (*CHAINS, *CHAINS[::-1], None):
        tuning = with_chain(chain)
        save_tuning(tuning, path)
        assert load_tuning(path) == loads(dumps(tuning)) == tuning
        assert path.read_text("utf-8").count(" = ") == dumps(tuning).count(" = ")
        assert (
            path.read_text("utf-8").splitlines()[1] == f"format = {1 if chain is None else 5 if chain.notch else 4}"
        )
    assert "chain" not in path.read_text("utf-8")


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("moving-average; window = 1000000000", "window must be a whole number from 1 to 100000 (got 1000000000"),
        ("moving-average; window = 'ten'", "'a': Expected `int`, got `str` - at `$.window`"),
        ("moving-average", "'a': Object missing required field `window`"),
        ("median; window = 4", "window must be an odd number of samples, such as 5 (got 4)"),
        ("kalman; median = 100001", "median must be a whole number from 1 to 99999 (got 100001"),
        ("kalman", "a chain must have a median of at least 3 samples, a notch, or a filter in place of Kalman's"),
        ("exponential; alpha = 0", "alpha must be a number from 9.31e-10 to 1 (got 0.0)"),
        ("butterworth; cutoff = 0.5", "cutoff in cycles per sample must be a number from 1e-06 to 0.499 (got 0.5)"),
        ("one-euro; cutoff = 1; beta = -1; speed_cutoff = 1", "beta must be a number from 0 to 1e+300 (got -1"),
        ("one-euro; cutoff = inf; beta = 1", "Object missing required field `speed_cutoff`"),
        ("kalman; median = 3; filter = []", "'a': Expected `str`, got `array`"),
        ("alpha-beta", 'filter of the chain must be "moving-average", "exponential"'),
    ],
)
def test_a_hostile_chain_is_refused_in_one_line(table: str, says: str) -> None:
    name, *settings = table.split("; ")
    lines = (*(() if "filter" in table else (f"filter = {name!r}",)), *settings)
    text = "\n".join(("format = 4", "[[channel]]", 'name = "a"', "q = 1", "r = 1", "[channel.chain]", *lines))
    with pytest.raises(BadFile) as refused:
        loads(text)
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 250


def test_at_another_period_cut_offs_stay_in_hertz_and_windows_in_seconds():
    cases = (
        (2.0, Chain(5, MovingAverage(9)), Chain(3, MovingAverage(4))),
        (0.5, Chain(5, Median(9)), Chain(9, Median(17))),
        (4.0, Chain(3, Exponential(1.0)), Chain(1, Exponential(1.0))),
        (2.0, Chain(1, Butterworth(0.1)), Chain(1, Butterworth(0.2))),
        *((2.0, Chain(1, OneEuro(0.1, 3.0, 0.2)), Chain(1, OneEuro(0.2, 3.0, 0.4))), (8.0, Chain(5), None)),
        (2.0, Chain(5, notch=Notch(0.1, 0.01)), Chain(3, notch=Notch(0.2, 0.02))),
        (1.0, Chain(5, Exponential(0.3)), Chain(5, Exponential(0.3))),
    )
    for ratio, before, after in cases:
        assert with_chain(before).rescaled(0.01 * ratio).channels[0].chain == after
    slow = with_chain(Chain(1, Exponential(0.19))).rescaled(0.005).channels[0].chain
    assert slow is not None
    assert isinstance(slow.then, Exponential)
    assert slow.then.alpha == pytest.approx(0.1)
    # The one-euro filter of a ramp in V/s answers alike: half as many samples, twice as far apart.
    ramp = np.linspace(0.0, 8.0, 4001)
    fast, half = (ChainFilter(Chain(1, OneEuro(f, 3.0, 2 * f)), PLAIN.channels[0].params) for f in (1e-3, 2e-3))
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
    with pytest.raises(BadSetting) as refused:
        with_chain(Chain(1, Butterworth(0.3))).rescaled(0.02)
    assert str(refused.value) == (
        "a cannot be filtered alike every 20 ms: cutoff in cycles per sample must be a number from 1e-06 to 0.499"
        " (got 0.6). Choose another sample period or filter"
    )


def test_a_gain_of_a_power_of_two_of_an_older_file_is_exponential_smoothing():
    assert chain_in({"median": 3, "filter": "power-of-two", "shift": 3}) == Chain(3, Exponential(0.125))
    with pytest.raises(BadSetting):
        chain_in({"filter": "power-of-two", "shift": -2})
