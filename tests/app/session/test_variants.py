"""Pinned settings: how they are named and coloured, what can be done with them, and the numbers beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadSetting, Recording, kalman_filter, steady_state
from kalscope.papers.generalized import GeneralizedParams
from kalscope_app.engine.filter_runs import Cache, FilterRuns, choose_samples
from kalscope_app.session.changes import (
    delete_variant,
    pin_present,
    select_channel,
    set_dark,
    set_text,
    use_variant,
)
from kalscope_app.session.opening import opened
from kalscope_app.session.state import DARK, LIGHT, MAX_VARIANTS
from kalscope_app.studies.comparisons import compute_variants
from kalscope_app.views.variants import EMPTY, table_text


def recording(n=400, truth=True):
    g = np.random.default_rng(3)
    signal = np.cumsum(g.normal(0, 0.1, (n, 2)), axis=0)
    return Recording(
        np.arange(n) * 0.01,
        ("a", "b"),
        ("V", "V"),
        signal + g.normal(size=(n, 2)),
        0.01,
        truth=signal if truth else None,
    )


@pytest.fixture
def state():
    return opened(recording())


def pin(state, *values):
    for value in values:
        state = pin_present(set_text("q", str(value))(state))
    return state


def names(state):
    return [variant.name for variant in state.variants]


def test_letters_and_colours_that_were_freed_come_again(state):
    three = pin(state, 1, 2, 3)
    assert names(three) == ["A", "B", "C"]
    without = delete_variant("B")(three)
    again = pin(without, 4)
    assert names(again) == ["A", "C", "B"]
    assert [variant.number for variant in again.variants] == [0, 2, 1]
    assert again.variants[-1].tuning.q == 4


def test_no_more_than_can_be_told_apart_are_pinned_and_that_is_said(state):
    full = pin(state, *range(1, MAX_VARIANTS + 1))
    assert len({variant.number for variant in full.variants}) == MAX_VARIANTS
    with pytest.raises(BadSetting, match="at most 8 pinned settings: delete one first"):
        pin(full, 99)
    assert names(pin(select_channel("b")(full), 1)) == ["A"]  # the limit is one of each channel


def test_using_a_variant_brings_all_of_its_setting(state):
    tuned = set_text("gate", "9")(set_text("x0", "2")(set_text("p0", "3")(state)))
    moved = set_text("x0", "first")(set_text("gate", "off")(set_text("r", "5")(pin(tuned, 7))))
    back = use_variant("A")(moved)
    assert back.tuning == pin(tuned, 7).tuning
    with pytest.raises(BadSetting, match=r"variant must be one of A \(got 'B'\)"):
        use_variant("B")(moved)


def test_using_a_variant_ends_the_second_papers_filter(state):
    other = pin(state, 7).with_tuning_of(
        0, replace(state.tuning, paper=GeneralizedParams(1.0, None, None, "printed"))
    )
    assert use_variant("A")(other).filter.is_standard
    with pytest.raises(BadSetting, match="so it cannot be pinned"):
        pin_present(other)


def test_curves_are_the_filter_at_the_drawn_samples_and_are_computed_once(state):
    tuned = pin(state, 1, 2)
    curves, shown = FilterRuns(), choose_samples(tuned.recording, "a", None)
    first = curves.variants(tuned, shown)
    for curve, variant in zip(first, tuned.variants, strict=True):
        z = tuned.recording.channel("a")
        expected = kalman_filter(z, variant.tuning.params).x[shown.indices]
        assert np.allclose(curve, expected, rtol=0, atol=1e-11 * np.abs(z).max())
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


def test_the_table_marks_the_best(state):
    tuned = pin(state, 0.01, 100)
    text = table_text(compute_variants(tuned, Cache()))
    assert text.count("\n| ") == 1 + 2  # the present setting and two variants, no cell broken by the bar
    assert LIGHT[0] in text
    assert DARK[0] in table_text(compute_variants(set_dark(True)(tuned), Cache()))
    best = max(compute_variants(tuned, Cache()).rows, key=lambda row: row.measures.fit.loglik)
    assert best.tuning.q == 0.01
    assert table_text(compute_variants(state, Cache())) == EMPTY
