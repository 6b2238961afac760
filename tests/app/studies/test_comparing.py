"""What the tabs Compare, Spectrum and Allan draw and write, without a browser."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from kalscope import FilterParams, Recording, open_source
from kalscope.analysis.alternatives import compare_alternatives
from kalscope.analysis.filter_errors import Difference
from kalscope.filtering.classic import Chain
from kalscope.papers.generalized import GeneralizedParams
from kalscope_app.session.changes import set_drawn_alternative, set_match_by, set_window, use_paper_filter
from kalscope_app.session.opening import opened
from kalscope_app.studies.checks import compute_allan, compute_spectra, log_binned
from kalscope_app.studies.comparisons import AlternativesStudy
from kalscope_app.views.chart_tabs import (
    ALL,
    COLOURS,
    NAMES,
    about_kalman,
    against,
    cutoff_words,
    floored,
    log_axes,
    text_of,
    verdict_of,
)
from kalscope_app.views.charts import Scale, log_scale_for, log_ticks, log_time_scale

RNG = np.random.default_rng(30)


def state_of(n=3000, unit="g", **changes):
    values = RNG.normal(size=(n, 1)) + np.cumsum(0.1 * RNG.normal(size=(n, 1)), axis=0)
    rec = Recording(np.arange(float(n)) / 100, ("ax",), (unit,), values, 0.01, title="log.csv")
    return opened(replace(rec, **changes))


def test_the_names_to_choose_from_are_those_of_the_comparison():
    found = compare_alternatives(RNG.normal(size=500), FilterParams(q=0.1, r=1.0))
    assert tuple(one.name for one in found.others) == NAMES
    assert len(COLOURS[False]) == len(COLOURS[True]) == len(NAMES)


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
    state = use_paper_filter(state_of(), GeneralizedParams(1.0, None, None, "printed"))
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


def test_with_momentum_the_table_has_the_overshoot_of_each_filter():
    text = text_of(AlternativesStudy().compute(state_of().with_tuning(momentum=20.0)))
    head, _, yours, *others = [line.split("|")[1:-1] for line in text.splitlines() if line.startswith("|")]
    at = [cell.strip() for cell in head].index("overshoot")
    assert yours[at].strip().replace("\u00a0", " ").endswith(" %")
    by = {row[0].strip(" *").replace("\u00a0", " "): row[at].strip().replace("\u00a0", " ") for row in others}
    assert by["Exponential"] == by["Moving average"] == "none"
    assert by["2nd-order Butterworth"].endswith(" %")
    assert by["Smoother (offline bound)"] == "–"
    assert "overshoot" not in text_of(AlternativesStudy().compute(state_of())).splitlines()[0]


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


def test_log_bins_are_means_of_what_falls_into_them():
    x = np.arange(1.0, 10_001.0)
    binned, y = log_binned(x, [2.0 * x], 50)
    assert len(binned) <= 50
    assert np.allclose(y, 2.0 * binned)
    assert np.all(np.diff(binned) > 0)
    assert log_binned(x[:40], [x[:40]], 50)[0] is not None


@pytest.mark.parametrize(
    ("lowest", "highest", "unit", "factor", "shown"),
    [
        (0.5, 10.0, "s", 1, "s"),
        (5e-4, 50.0, "Hz", 1, "Hz"),  # a cut-off in Hz stands above it
        (2e-6, 1e-3, "s", 1e6, "µs"),
        (1e-7, 1e-3, "Hz", 1e6, "µHz"),
        (1e8, 1e10, "Hz", 1e-9, "GHz"),
        (1e-15, 1e-13, "V", 1e12, "pV"),
        (3e-12, 3e-3, "g²/Hz", 1, "g²/Hz"),
        (5e-6, 0.5, "cycles/sample", 1, "cycles/sample"),
    ],
)
def test_a_logarithmic_axis_has_the_prefix_of_its_middle(lowest, highest, unit, factor, shown):
    scale = log_scale_for(np.array([0.0, lowest, highest, np.nan]), unit)
    assert (scale.factor, scale.unit) == (pytest.approx(factor), shown)


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (0.9, 11.0, [1, 2, 5, 10]),
        (0.02, 300.0, [0.1, 1, 10, 100]),
        (1e-3, 1e14, [1e-3, 1e-1, 1e1, 1e3, 1e5, 1e7, 1e9, 1e11, 1e13]),
    ],
)
def test_ticks_are_round_and_inside(low, high, ticks):
    assert log_ticks(low, high) == pytest.approx(ticks)
    across, up = log_axes(np.array([low, high]), (low, high), "y")
    assert len(across["values"]) == len(across["splits"]) == len(up["values"]) == len(ticks)


@pytest.mark.parametrize(
    ("first", "last", "factor", "unit"),
    [
        (0.01, 5.0, 1.0, "s"),
        (1e-4, 0.5, 1e3, "ms"),
        (1.0, 20_000.0, 1 / 60, "min"),
        (604_800.0, 3e8, 1 / 86_400, "days"),
        (60.0, 601.0, 1 / 60, "min"),
    ],
)
def test_a_logarithmic_axis_of_times_has_the_unit_of_its_middle(first, last, factor, unit):
    scale = log_time_scale(np.array([first, last]))
    assert (scale.factor, scale.unit) == (pytest.approx(factor), unit)


def test_a_logarithmic_chart_is_given_positive_numbers_only():
    low, high, ys = floored((np.array([0.0, np.nan, 1.0]), np.array([1e-30, 5.0, np.inf])))
    assert 0 < low < high
    assert high / low <= 10.0**9 * 1.001
    assert all(np.all((y >= low) & (y <= high)) for y in ys)
    low, high, ys = floored((np.zeros(3),))
    assert 0 < low < high


def test_the_allan_study_has_the_recording_and_the_model():
    allan = compute_allan(opened(open_source("demo")))
    assert len(allan.found.size) == len(allan.found.model) > 10
    assert "does not help" in allan.found.message
