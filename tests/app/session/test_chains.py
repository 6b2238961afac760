"""A chain of filters as a setting like any other: chosen, undone, pinned, linked, kept, loaded, left again."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope.errors import BadSetting
from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, OneEuro
from kalscope.recording import Recording
from kalscope.tuning.file import dumps, loads
from kalscope.tuning.tuning import chain_text, typed_chain
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session import changes
from kalscope_app.session.changes import pin_present, set_median, use_chain, use_variant
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session
from kalscope_app.session.state import SAME_LAG
from kalscope_app.studies.comparisons import compute_variants
from kalscope_app.views.variants import table_text

EURO = OneEuro(0.02, 0.7, 0.1)
STAGES = (MovingAverage(9), Exponential(0.2), Median(7), Butterworth(0.05), EURO)


@pytest.fixture(scope="module")
def state():
    rng = np.random.default_rng(3)
    z = np.cumsum(rng.normal(0.0, 0.1, (300, 2)), axis=0) + rng.normal(0.0, 1.0, (300, 2)) * (1.0, 10.0)
    z[50, 0] = np.nan
    return opened(Recording(np.arange(300) * 0.01, ("a", "b"), ("V", "V"), z, 0.01, title="log", source="log.csv"))


@pytest.mark.slow
def test_every_chain_is_drawn_shared_saved_and_reopened_bit_for_bit(state):
    for chain in (*(Chain(m, stage) for stage in STAGES for m in (1, 5)), Chain(3)):
        tuned = use_chain(chain)(state)
        assert np.array_equal(compute_frame(tuned).filtered, tuned.tuning.filter.run(tuned.z).x, equal_nan=True)
        assert changes.use_settings(loads(dumps(tuned.as_tuning())), "t.toml")(state).tuning == tuned.tuning
        assert chain_text(chain) in changes.share_line(tuned).line
        assert changes.apply_options(state, None, chain_text(chain)).tuning.chain == chain


def test_a_chain_is_pinned_beside_the_kalman_filter_and_used_again(state):
    session = Session(state)
    gestures = pin_present, use_chain(Chain(5, EURO)), pin_present, use_variant("A"), set_median("3 samples")
    for change in gestures:
        session.request(change)
    tuned, _, failures = session.apply_requests()
    assert not failures
    assert [pin.tuning.chain for pin in tuned.variants] == [None, Chain(5, EURO)]
    assert use_variant("B")(tuned).tuning.chain == Chain(5, EURO)
    euro = compute_frame(tuned).variants[1]
    assert np.array_equal(euro, tuned.variants[1].tuning.filter.run(tuned.z).x, equal_nan=True)
    current, kalman, euro = table_text(compute_variants(tuned, Cache())).split("\n")[2:5]
    assert "Median of 3, then Kalman" in current.replace("\u00a0", " ")
    assert "| Kalman |" in kalman
    assert "Median of 5, then one-euro" in euro
    assert euro.count("| – ") == 5  # q and r, and what only a model of the signal has
    with pytest.raises(BadSetting, match="pinned already, as B"):
        pin_present(use_variant("B")(tuned))


def test_linked_channels_run_the_same_chain_and_a_speed_counts_in_their_own_noise(state):
    tuned = changes.set_link(SAME_LAG)(use_chain(Chain(5, EURO))(state))
    first, second = tuned.tunings
    wider = np.sqrt(tuned.starts[1].r / tuned.starts[0].r)
    assert (second.chain.median, second.chain.then.cutoff) == (5, 0.02)
    assert second.chain.then.beta == pytest.approx(0.7 / wider)
    assert first.chain == Chain(5, EURO)


HOSTILE = {
    "median 5, one-euro 0.02 0.7": "one-euro must have 3 numbers, cutoff, beta, speed_cutoff",
    "median 1e300, kalman": "window must be a whole number from 1 to",
    "exponential nan": "alpha of exponential must be",
    "exponential 0.2, median 3": "a chain must be a filter, after a median, a notch or both",
    "median 3, median 3, kalman": "a chain must be a filter, after a median, a notch or both",
    "median 5, <script>": "a filter of a chain must be one of",
}


def test_a_chain_from_outside_is_checked(state):
    for text, why in HOSTILE.items():
        with pytest.raises(BadSetting, match=why):
            changes.apply_options(state, None, text)
    assert (typed_chain("median 5"), typed_chain(" Kalman ")) == (Chain(1, Median(5)), None)
    assert changes.apply_options(use_chain(Chain(5))(state), None, None, q="3").tuning.chain == Chain(5)
