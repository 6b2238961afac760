"""Pinned settings: how they are named and coloured, what can be done with them, and the numbers beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.app.recordings import walk

from kalscope import BadSetting, kalman_filter, steady_state
from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, OneEuro
from kalscope.papers.generalized import GeneralizedParams
from kalscope.tuning.file import dumps, loads
from kalscope.tuning.tuning import chain_text, typed_chain
from kalscope_app.engine.filter_runs import Cache, FilterRuns, choose_samples
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session import changes
from kalscope_app.session.changes import pin_present, set_text, use_chain, use_variant
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session
from kalscope_app.session.state import MAX_VARIANTS, SAME_LAG
from kalscope_app.studies.comparisons import compute_variants
from kalscope_app.views.variants import table_text


@pytest.fixture
def state():
    return opened(walk(400, truth=True, title="log"))


def pin(state, *values):
    for value in values:
        state = pin_present(set_text("q", str(value))(state))
    return state


def test_letters_and_colours_that_were_freed_come_again(state):
    again = pin(changes.delete_variant("B")(pin(state, 1, 2, 3)), 4)
    assert [(one.name, one.number) for one in again.variants] == [("A", 0), ("C", 2), ("B", 1)]
    assert again.variants[-1].tuning.q == 4


def test_no_more_than_can_be_told_apart_are_pinned_and_that_is_said(state):
    full = pin(state, *range(1, MAX_VARIANTS + 1))
    assert len({variant.number for variant in full.variants}) == MAX_VARIANTS
    with pytest.raises(BadSetting, match="at most 8 pinned settings: delete one first"):
        pin(full, 99)
    assert pin(changes.select_channel("b")(full), 1).variants[0].name == "A"  # the limit is one of each channel


def test_using_a_variant_brings_all_of_its_setting_and_ends_the_second_papers_filter(state):
    pinned = pin(set_text("gate", "9")(set_text("x0", "2")(set_text("p0", "3")(state))), 7)
    moved = set_text("x0", "first")(set_text("gate", "off")(set_text("r", "5")(pinned)))
    paper = replace(state.tuning, paper=GeneralizedParams(1.0, None, None, "printed"))
    other = pinned.with_tuning_of(0, paper)
    for shown in moved, other:
        assert use_variant("A")(shown).tuning == pinned.tuning
    with pytest.raises(BadSetting, match=r"variant must be one of A \(got 'B'\)"):
        use_variant("B")(moved)
    with pytest.raises(BadSetting, match="so it cannot be pinned"):
        pin_present(other)


def test_curves_are_the_filter_at_the_drawn_samples_and_are_computed_once(state):
    tuned, z = pin(state, 1, 2), state.recording.channel("a")
    curves, shown = FilterRuns(), choose_samples(tuned.recording, "a", None)
    first = curves.variants(tuned, shown)
    assert np.allclose(first[1], kalman_filter(z, tuned.variants[1].tuning.params).x, rtol=0, atol=1e-11)
    again = curves.variants(set_text("r", "3")(tuned), shown)
    assert all(a is b for a, b in zip(first, again, strict=True))
    narrower = choose_samples(tuned.recording, "a", (1.0, 2.0))
    assert [len(curve) for curve in curves.variants(tuned, narrower)] == [len(narrower.indices)] * 2
    assert curves.variants(changes.select_channel("b")(tuned), shown) == ()


def test_the_table_holds_what_each_setting_does(state):
    tuned = pin(state, 1, 2)
    table = compute_variants(set_text("q", "0.5")(tuned), Cache())
    assert [row.variant for row in table.rows] == [None, *tuned.variants]
    for row, q in zip(table.rows, (0.5, 1, 2), strict=True):
        result = kalman_filter(tuned.recording.channel("a"), row.tuning.params)
        error = result.x - tuned.recording.truth[:, 0]
        assert row.tuning.q == q
        assert row.measures.rmse == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
        assert row.measures.loglik == result.loglik
        assert row.measures.steady == steady_state(row.tuning.params, 0.01)


# --- chains of filters ----------------------------------------------------------------------------------


EURO = OneEuro(0.02, 0.7, 0.1)
STAGES = (MovingAverage(9), Exponential(0.2), Median(7), Butterworth(0.05), EURO)


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
    chain, median = use_chain(Chain(5, EURO)), changes.set_median("3 samples")
    gestures = pin_present, chain, pin_present, use_variant("A"), median
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
