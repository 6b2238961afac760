"""The page: numbers computed here stand on it, nothing from outside acts on it, and only the date changes."""

from __future__ import annotations

import shlex
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from tests.support.html_page import Page

from kalscope import BadSetting, FilterParams, Recording, kalman_filter, load_tuning, steady_state
from kalscope.cli.app import run
from kalscope.common.text import frequency, lag_in_full, noise_left, number, percent, trimmed
from kalscope.export.report import MAX_DRAWN_POINTS, as_html, make_report
from kalscope.tuning.tuning import ChannelTuning, Tuning

pytestmark = pytest.mark.slow

RNG = np.random.default_rng(22)
NOON = datetime(2024, 5, 6, 12, 0, tzinfo=UTC)
HOSTILE = "\"><script>alert(1)</script><img src=x onerror=alert(2)>'`$(x)"


def recording(n=3000, name="ax", unit="g", rng=RNG, **changes):
    values = np.cumsum(0.05 * rng.normal(size=(n, 1)), axis=0) + rng.normal(size=(n, 1))
    made = Recording(np.arange(float(n)) / 100, (name,), (unit,), values, 0.01, source="log.csv", title="log.csv")
    return replace(made, **changes)


def tuned(rec, **changes):
    own = ChannelTuning(rec.names[0], rec.units[0], 0.0025, 1.0, how="by hand")
    return Tuning(channels=(replace(own, **changes),), tool="kalscope 1", date="then", sample_period=0.01)


@pytest.fixture(scope="module")
def plain():
    """A recording, and the page of it at noon."""
    rec = recording(rng=np.random.default_rng(22))
    report = make_report(rec, tuned(rec), now=NOON)
    return rec, as_html(report)


def test_the_page_has_the_numbers_of_the_filter(plain):
    rec, page = plain
    text, steady = " ".join(Page(page).text), steady_state(FilterParams(0.0025, 1.0), 0.01)
    numbers = number(steady.gain), lag_in_full(steady.lag_samples, 0.01), noise_left(steady.noise_reduction_db)
    numbers += (
        frequency(steady.cutoff_hz),
        number(kalman_filter(rec.channel("ax"), FilterParams(0.0025, 1.0)).loglik, 6),
    )
    words = "0.0025 g² per sample", "At equal lag, nothing simpler does better", "2024-05-06 12:00 UTC"
    for one in (*numbers, *words, "kalscope open log.csv --config tuning.toml"):
        assert one in text
    later = make_report(rec, tuned(rec), now=NOON.replace(year=2025))
    assert page.replace("2024-05-06", "2025-05-06") == as_html(later)
    named = replace(rec, source="it's; rm -rf $HOME.csv")
    words = shlex.split(make_report(named, tuned(rec), config="my tuning.toml").command)
    assert words == ["kalscope", "open", named.source, "--config", "my tuning.toml"]


def test_momentum_and_its_overshoot_stand_on_the_page(plain):
    rec, page = plain
    report = make_report(rec, tuned(rec, momentum=24.0), now=NOON)
    text = " ".join(Page(as_html(report)).text)
    share = percent(float(steady_state(FilterParams(0.0025, 1.0, momentum=24.0), 0.01).overshoot))
    assert all(words in text for words in ("momentum τ", "240 ms (24 samples)", "overshoot on a step", share))
    *_, table, _ = report.tables
    shares = {name: overshoot for name, _, _, overshoot, _ in table.rows}
    compared = [shares[name] for name in ("Kalman (present)", "Exponential", "Smoother (offline bound)")]
    assert (table.columns[3], compared) == ("overshoot", [share, "0 %", "–"])
    assert "momentum" not in " ".join(Page(page).text)


def test_nothing_from_outside_becomes_markup():
    rec = recording(name=HOSTILE, unit=HOSTILE, title=HOSTILE, source=HOSTILE, sha256=HOSTILE)
    tuning = replace(tuned(rec, how=HOSTILE), tool=HOSTILE, date=HOSTILE)
    text = as_html(make_report(rec, tuning, config=HOSTILE, now=NOON))
    page = Page(text)
    attributes = {name for name, _ in page.attributes}
    assert not {"script", "img", "iframe", "link", "object", "a", "form"} & set(page.tags)
    assert not any(name.startswith("on") or name in ("src", "href", "srcset", "action") for name in attributes)
    assert HOSTILE in "".join(page.text)
    assert [word in text for word in ("<script", "default-src 'none'")] == [False, True]
    assert "url(" not in text.split("</style>")[0]


@pytest.mark.parametrize("knows_truth", [True, False])
def test_pinned_settings_stand_beside_the_present_one(knows_truth):
    rec = recording()
    z = rec.channel("ax")
    truth = np.cumsum(np.full((len(z), 1), 0.01), axis=0)
    rec = replace(rec, truth=truth if knows_truth else None)
    moving = ChannelTuning("ax", "g", 0.01, 1.0, momentum=9.0)
    pins = [("A", replace(moving, q=0.04, momentum=0.0)), (HOSTILE, moving)]
    report = make_report(rec, tuned(rec), pins=pins, now=NOON)
    table, rows = report.tables[-1], dict(report.tables[1].rows)
    assert [row[0] for row in table.rows] == ["current", "A", f"{HOSTILE}, τ 9.00"]
    for row, one in zip(table.rows, (tuned(rec).channels[0], *(one for _, one in pins)), strict=True):
        result, steady = kalman_filter(z, one.params), steady_state(one.params, 0.01)
        error = np.sqrt(np.mean((result.x - truth[:, 0]) ** 2))
        last = number(error) if knows_truth else number(float(result.loglik), 6)
        assert row[1:3] == (number(one.q), number(one.r))
        assert row[4:] == (noise_left(float(steady.noise_reduction_db)), last)
    assert table.columns[-1] == ("RMSE" if knows_truth else "log-likelihood")
    assert rows.get("RMSE to the truth") == (f"{table.rows[0][-1]} g" if knows_truth else None)
    assert not {"script", "img"} & set(Page(as_html(report)).tags)
    assert make_report(rec, tuned(rec), now=NOON).tables[-1].rows == ()


def test_the_curves_keep_every_extreme_and_few_points():
    rec = recording(n=100_000)
    rec.values[40_000:41_000] = np.nan
    rec.values[77_777] = 1e3
    whole, detail = make_report(rec, tuned(rec)).charts
    raw, _ = whole.lines
    assert len(raw.x) <= MAX_DRAWN_POINTS + 2
    assert (np.nanmin(raw.y), np.nanmax(raw.y)) == (np.nanmin(rec.values), 1e3)
    assert np.isnan(raw.y[(raw.x > 400.3) & (raw.x < 409.7)]).all()
    assert np.all(np.diff(raw.x) > 0)
    x, filtered = kalman_filter(rec.channel("ax"), FilterParams(0.0025, 1.0)).x, detail.lines[-1]
    assert np.array_equal(filtered.y, x[np.rint(filtered.x * 100).astype(int)])


@pytest.mark.parametrize("values", [np.full((50, 1), 7.0), np.array([[1.0]]), np.full((40, 1), np.nan)])
def test_odd_recordings_make_a_page_all_the_same(values):
    rec = recording(n=len(values), values=values)
    report, untimed = make_report(rec, tuned(rec)), make_report(replace(rec, sample_period=None), tuned(rec))
    assert "nan" not in " ".join(Page(as_html(report)).text).lower()
    assert ["Hz" in repr(one) for one in (report, untimed)] == [True, False]
    with pytest.raises(BadSetting, match="channel must be one of ax"):
        make_report(rec, tuned(rec), "bx")
    with pytest.raises(BadSetting, match="must have samples"):
        make_report(replace(rec, time=rec.time[:0], values=rec.values[:0]), tuned(rec))


def test_the_command_line_writes_it_and_refuses_other_endings(tmp_path, capsys):
    config, page, untimed = (tmp_path / name for name in ("tuning.toml", "page.html", "untimed.csv"))
    assert run(["tune", "demo", "-o", str(config)]) == 0
    assert run(["report", "demo", "--config", str(config), "-o", str(page)]) == 0
    assert trimmed(load_tuning(config).channels[0].q, 4) in page.read_text(encoding="utf-8")
    untimed.write_text("flex\n" + "".join(f"{i % 7}\n" for i in range(100)), encoding="utf-8")
    assert run(["report", str(untimed), "--config", str(config), "-o", str(page), "--force"]) == 0
    assert "100 samples, 50.0 Hz" in page.read_text(encoding="utf-8")  # the sample period of the tuning
    capsys.readouterr()
    assert run(["report", "demo", "--config", str(config), "-o", str(tmp_path / "page.pdf")]) == 2
    assert "-o must end with .html (got" in capsys.readouterr().err
