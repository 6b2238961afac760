"""What the tabs Compare, Spectrum, Allan and Channels draw and write, and channels tuned together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadSetting, Recording, denoise, steady_state
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.session import changes
from kalscope_app.session.changes import set_link, set_text, set_window
from kalscope_app.session.opening import opened
from kalscope_app.session.state import SAME_LAG, SAME_NUMBERS
from kalscope_app.studies.checks import compute_spectra
from kalscope_app.studies.comparisons import MAX_LANE_POINTS, MAX_LANES, compute_alternatives, compute_overview
from kalscope_app.views.chart_tabs import ALL, NAMES, cutoff_words, lanes_of, lead_of, settings_of, text_of

pytestmark = pytest.mark.slow

RNG = np.random.default_rng(30)


def state_of(n=3000, unit="g", **changes):
    values = RNG.normal(size=(n, 1)) + np.cumsum(0.1 * RNG.normal(size=(n, 1)), axis=0)
    rec = Recording(np.arange(float(n)) / 100, ("ax",), (unit,), values, 0.01, title="log.csv")
    return opened(replace(rec, **changes))


def test_drawn_curves_are_those_of_the_comparison_at_the_drawn_samples():
    state = set_window(5.0, 15.0)(state_of())
    compared = compute_alternatives(state, Cache())
    assert compared.drawn.first == 500
    at = compared.drawn.indices
    for one in (compared.found.present, *compared.alternatives):
        assert np.array_equal(compared.curve(one), one.curve[at], equal_nan=True)
    assert [one.name for one in compared.alternatives] == ["Moving average"]
    everything = compute_alternatives(changes.set_drawn_alternative(ALL)(state), Cache())
    assert tuple(one.name for one in everything.alternatives) == NAMES


def test_a_long_recording_is_compared_around_the_view_and_drawn_only_there():
    n = 450_000
    state = state_of(n, values=np.resize(RNG.normal(size=9973), n).reshape(-1, 1))
    whole = compute_alternatives(state, Cache())
    assert (whole.found.first, whole.found.last) == (125_000, 325_000)
    assert 0 < len(whole.curve(whole.found.present)) == whole.inside.sum() < len(whole.drawn.indices)
    assert compute_alternatives(set_window(4400.0, 4499.0)(state), Cache()).inside.all()


def test_the_table_has_a_row_a_filter_and_no_markup_from_the_unit():
    text = text_of(compute_alternatives(state_of(unit="<b>|"), Cache()))
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert len(rows) == 2 + 1 + len(NAMES)
    assert len({row.replace("\\|", "").count("|") for row in rows}) == 1
    for words, told in ("<b>", False), ("exponential smoothing with α = K", True), ("**Moving average.**", True):
        assert (words in text) == told
    odd = changes.set_drawn_alternative("x" * 10_000)(state_of())  # a browser may send any word
    odd = changes.set_match_by("rubbish")(odd)
    assert (odd.view.match_by, len(odd.view.drawn_alternative)) == ("lag", 60)
    assert "**Median.**" in text_of(compute_alternatives(odd, Cache()))


def test_the_density_keeps_its_power_in_bins_and_the_cutoff_is_on_the_response():
    spectra = compute_spectra(state_of(100_000).with_tuning(q=0.01, r=1.0, momentum=0.0))
    assert len(spectra.frequency) <= 240
    raw = spectra.densities[0]
    assert np.all((raw >= spectra.found.raw.min()) & (raw <= spectra.found.raw.max()))
    at = spectra.fine == spectra.found.cutoff
    assert spectra.response_db[at] == pytest.approx([10 * np.log10(0.5)])
    assert "Cut-off (−3 dB): 1.59 Hz. " in cutoff_words(spectra.found)  # q = r/100 at 100 Hz
    slow = compute_spectra(state_of(300).with_tuning(q=1e-4, r=1.0))
    assert slow.fine[0] < slow.found.cutoff < slow.frequency[0] / 2  # drawn though the record has no such wave
    assert slow.fine[-1] == pytest.approx(slow.frequency[-1])
    fast = compute_spectra(state_of().with_tuning(q=1.0, r=0.01))
    assert "no cut-off" in cutoff_words(fast.found)
    assert np.isfinite(fast.response_db).all()


# --- several channels: tuned together, and side by side -------------------------------------------------


def recording(n=500, channels=3, scale=10.0):
    z = np.random.default_rng(7).normal(size=(n, channels)) * scale ** np.arange(channels)
    names = tuple(f"c{i}" for i in range(channels))
    return Recording(np.arange(n) * 0.01, names, ("V",) * channels, z, 0.01)


@pytest.fixture
def state():
    return opened(recording())


def test_tuned_together_every_change_sets_all_channels_or_their_lag_at_any_scale(state):
    more = set_text("momentum", "12"), changes.reset_parameters
    for change in (set_text("q", "0.3"), changes.set_slider("r", 1.0), *more):
        together = change(set_link(SAME_NUMBERS)(set_text("q", "0.1")(state)))
        assert len({tuning.params for tuning in together.tunings}) == 1
        alone = change(set_text("q", "0.1")(state))
        assert alone.tunings[1:] == state.tunings[1:]
    with pytest.raises(BadSetting, match="way of tuning channels must be one of"):
        set_link("<img>")(state)
    together = set_text("q", "0.3")(set_link(SAME_LAG)(state))
    lags = [float(steady_state(tuning.params).lag_samples) for tuning in together.tunings]
    assert lags == pytest.approx([lags[0]] * 3)
    assert [one.r for one in together.tunings] == pytest.approx([start.r for start in state.starts])


def test_lanes_hold_each_channel_on_its_own_scale(state):
    overview = compute_overview(state, Cache())
    for i, lane in enumerate(overview.lanes):
        z = state.recording.channel(lane.name)
        assert (lane.low, lane.high) == (z.min(), z.max())
        middle, half = (z.max() + z.min()) / 2, (z.max() - z.min()) / 2
        assert np.allclose(lane.raw, (z - middle) / half, atol=1e-12)
        filtered = denoise(z, state.tunings[i].params)
        assert np.allclose(lane.filtered, (filtered - middle) / half, atol=1e-9)


@pytest.mark.parametrize(("channels", "lanes"), [(1, 0), (2, 2), (40, MAX_LANES)])
def test_sixteen_channels_are_drawn_of_any_number(channels, lanes):
    state = opened(recording(n=20_000, channels=channels, scale=1.5))
    overview = compute_overview(state, Cache())
    assert len(overview.lanes) == lanes
    assert len(overview.time) <= MAX_LANE_POINTS + MAX_LANES
    assert (np.diff(overview.time) > 0).all()
    if lanes:
        lines = lanes_of(overview)
        assert len(lines) == 2 * lanes
        for i, one in enumerate(lines):
            assert (np.abs(one.y - (i // 2 + 1)) < 0.5).all()  # no lane reaches into the next
        assert settings_of(overview).count("\n") == lanes + 1
    assert ("The first 16 of 40" in lead_of(overview)) == (channels == 40)
