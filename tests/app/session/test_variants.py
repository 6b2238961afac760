"""Pinned settings: how they are named and coloured, what can be done with them, and the numbers beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.app.recordings import walk

from kalscope import BadSetting, kalman_filter, steady_state
from kalscope.papers.generalized import GeneralizedParams
from kalscope_app.engine.filter_runs import Cache, FilterRuns, choose_samples
from kalscope_app.session.changes import delete_variant, pin_present, select_channel, set_text, use_variant
from kalscope_app.session.opening import opened
from kalscope_app.session.state import MAX_VARIANTS
from kalscope_app.studies.comparisons import compute_variants


@pytest.fixture
def state():
    return opened(walk(400, truth=True))


def pin(state, *values):
    for value in values:
        state = pin_present(set_text("q", str(value))(state))
    return state


def test_letters_and_colours_that_were_freed_come_again(state):
    again = pin(delete_variant("B")(pin(state, 1, 2, 3)), 4)
    assert [(one.name, one.number) for one in again.variants] == [("A", 0), ("C", 2), ("B", 1)]
    assert again.variants[-1].tuning.q == 4


def test_no_more_than_can_be_told_apart_are_pinned_and_that_is_said(state):
    full = pin(state, *range(1, MAX_VARIANTS + 1))
    assert len({variant.number for variant in full.variants}) == MAX_VARIANTS
    with pytest.raises(BadSetting, match="at most 8 pinned settings: delete one first"):
        pin(full, 99)
    assert pin(select_channel("b")(full), 1).variants[0].name == "A"  # the limit is one of each channel


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
    for curve, variant in zip(first, tuned.variants, strict=True):
        assert np.allclose(curve, kalman_filter(z, variant.tuning.params).x[shown.indices], rtol=0, atol=1e-11)
    again = curves.variants(set_text("r", "3")(tuned), shown)
    assert all(a is b for a, b in zip(first, again, strict=True))
    narrower = choose_samples(tuned.recording, "a", (1.0, 2.0))
    assert [len(curve) for curve in curves.variants(tuned, narrower)] == [len(narrower.indices)] * 2
    other = select_channel("b")(tuned)
    assert curves.variants(other, choose_samples(other.recording, "b", None)) == ()


def test_the_table_holds_what_each_setting_does(state):
    tuned = pin(state, 1, 2)
    table = compute_variants(set_text("q", "0.5")(tuned), Cache())
    assert [row.variant for row in table.rows] == [None, *tuned.variants]
    for row, q in zip(table.rows, (0.5, 1, 2), strict=True):
        result = kalman_filter(tuned.recording.channel("a"), row.tuning.params)
        error = result.x - tuned.recording.truth[:, 0]
        assert row.tuning.q == q
        assert row.measures.rmse == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
        assert row.measures.fit.loglik == result.loglik
        assert row.measures.steady == steady_state(row.tuning.params, 0.01)
