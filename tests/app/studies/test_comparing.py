"""What the tabs Compare, Spectrum and Allan draw and write, without a browser."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from kalscope import Recording
from kalscope.analysis.filter_errors import Difference
from kalscope.filtering.classic import Chain
from kalscope.papers.generalized import GeneralizedParams
from kalscope_app.session.changes import set_drawn_alternative, set_match_by, set_window
from kalscope_app.session.opening import opened
from kalscope_app.studies.checks import compute_allan, compute_spectra
from kalscope_app.studies.comparisons import AlternativesStudy
from kalscope_app.views.chart_tabs import (
    ALL,
    NAMES,
    about_kalman,
    against,
    cutoff_words,
    text_of,
    verdict_of,
)
from kalscope_app.views.charts import Scale

RNG = np.random.default_rng(30)


def state_of(n=3000, unit="g", **changes):
    values = RNG.normal(size=(n, 1)) + np.cumsum(0.1 * RNG.normal(size=(n, 1)), axis=0)
    rec = Recording(np.arange(float(n)) / 100, ("ax",), (unit,), values, 0.01, title="log.csv")
    return opened(replace(rec, **changes))


def test_drawn_curves_are_those_of_the_comparison_at_the_drawn_samples():
    state = set_window(5.0, 15.0)(state_of())
    compared = AlternativesStudy().compute(state)
    assert compared.drawn.first == 500
    at = compared.drawn.indices
    for one in (compared.found.present, *compared.alternatives):
        assert np.array_equal(compared.curve(one), one.curve[at], equal_nan=True)
    assert [one.name for one in compared.alternatives] == ["Moving average"]
    everything = AlternativesStudy().compute(set_drawn_alternative(ALL)(state))
    assert tuple(one.name for one in everything.alternatives) == NAMES


@pytest.mark.slow
def test_a_long_recording_is_compared_around_the_view_and_drawn_only_there():
    n = 450_000
    values = np.resize(RNG.normal(size=9973), n).reshape(-1, 1)
    state = state_of(n, values=values)
    whole = AlternativesStudy().compute(state)
    assert (whole.found.first, whole.found.last) == (125_000, 325_000)
    assert 0 < whole.inside.sum() < len(whole.drawn.indices)
    assert len(whole.curve(whole.found.present)) == whole.inside.sum()
    end = AlternativesStudy().compute(set_window(4400.0, 4499.0)(state))
    assert end.inside.all()


@pytest.mark.slow
def test_the_study_is_computed_again_only_when_the_comparison_changes():
    study, state = AlternativesStudy(), state_of()
    first = study.compute(state).found
    assert study.compute(set_drawn_alternative("Median")(state)).found is first
    assert study.compute(state.with_view(dark=True)).found is first
    assert study.compute(set_window(1.0, 5.0)(state)).found is first  # the whole recording all the same
    assert study.compute(set_match_by("noise")(state)).found.match == "noise"
    assert study.compute(state.with_tuning(q=0.5)).found is not first
    again = study.compute(state_of()).found
    assert study.compute(state).found is not again


@pytest.mark.parametrize(("word", "match"), [("noise", "noise"), ("lag", "lag"), ("rubbish", "lag"), ("", "lag")])
def test_a_browser_may_send_any_word(word, match):
    state = state_of()
    assert set_match_by(word)(state).view.match_by == match
    long = set_drawn_alternative("x" * 10_000)(state)
    assert len(long.view.drawn_alternative) == 60
    assert len(AlternativesStudy().compute(long).alternatives) == len(NAMES)


def test_the_second_papers_filter_has_nothing_to_compare():
    state = state_of()
    state = state.with_tuning_of(0, replace(state.tuning, paper=GeneralizedParams(1.0, None, None, "printed")))
    assert AlternativesStudy().compute(state) is None
    assert compute_spectra(state) is None
    assert compute_allan(state) is None


def test_the_table_has_a_row_a_filter_and_no_markup_from_the_unit():
    text = text_of(AlternativesStudy().compute(state_of(unit="<b>|")))
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert len(rows) == 2 + 1 + len(NAMES)
    assert len({row.replace("\\|", "").count("|") for row in rows}) == 1
    assert "<b>" not in text
    assert "exponential smoothing with α = K" in text
    assert "**Moving average.**" in text
    assert "**Median.**" in text_of(AlternativesStudy().compute(set_drawn_alternative(ALL)(state_of())))


@pytest.mark.slow
def test_while_a_chain_runs_every_sentence_names_the_kalman_filter():
    chained = {"chain": Chain(3)}
    cases = {
        "the errors of the Kalman filter are correlated over": state_of(300).with_tuning(**chained),
        "The Kalman filter passes the signal unchanged": state_of(300).with_tuning(r=1e-30, **chained),
        "The lag of the Kalman filter, ": state_of(100).with_tuning(q=1e-9, **chained),
    }
    for words, state in cases.items():
        compared = AlternativesStudy().compute(state)
        text = f"{verdict_of(compared)} {about_kalman(text_of(compared))}"
        assert words in text
        assert not re.search(r"\b(yours?|this filter|current filter)\b", text, re.IGNORECASE)


@pytest.mark.parametrize(
    ("d", "words"),
    [
        (None, "–"),
        (Difference(np.nan, 0.0, np.inf), "–"),
        (Difference(1.2, 0.0, np.inf), "too short to tell"),
        (Difference(1.01, 0.99, 1.03), "no significant difference"),
        (Difference(1.042, 1.033, 1.053), "4.2 % worse (3.3 to 5.3)"),
        (Difference(0.8, 0.75, 0.85), "20 % better (15 to 25)"),
    ],
)
def test_differences_in_words(d, words):
    assert against(d) == words


def test_the_density_keeps_its_power_in_bins_and_the_cutoff_is_on_the_response():
    spectra = compute_spectra(state_of(100_000).with_tuning(q=0.01, r=1.0, momentum=0.0))
    assert len(spectra.frequency) <= 240
    raw = spectra.densities[0]
    assert np.all((raw >= spectra.found.raw.min()) & (raw <= spectra.found.raw.max()))
    at = np.flatnonzero(spectra.fine == spectra.found.cutoff)
    assert len(at) == 1
    assert spectra.response_db[at[0]] == pytest.approx(10 * np.log10(0.5))
    hertz, milli = Scale(1.0, "Hz"), Scale(1e3, "mHz")
    assert "Cut-off (−3 dB): 1.59 Hz. " in cutoff_words(spectra, hertz)  # q = r/100 at 100 Hz
    assert "1.59 Hz, 1\u202f590 mHz on the axis. " in cutoff_words(spectra, milli)
    slow = compute_spectra(state_of(300).with_tuning(q=1e-4, r=1.0))
    assert slow.fine[0] < slow.found.cutoff < slow.frequency[0] / 2  # drawn though the record has no such wave
    assert slow.fine[-1] == pytest.approx(slow.frequency[-1])
    fast = compute_spectra(state_of().with_tuning(q=1.0, r=0.01))
    assert "no cut-off" in cutoff_words(fast, hertz)
    assert np.isfinite(fast.response_db).all()
