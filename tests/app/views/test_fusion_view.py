"""Fused sensors in the views: what is offered, what is said, and what leaves the program."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from kalscope import BadSetting, Recording, estimate_fusion, fuse
from kalscope.common.progress import Progress
from kalscope.errors import Cancelled
from kalscope_app.dashboard import Dashboard
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.engine.frame import compute_frame
from kalscope_app.guard.server import guarded_server
from kalscope_app.live import send_setting
from kalscope_app.session.changes import apply_estimate, pin_present, select_channel, set_taking_part, share_line
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session
from kalscope_app.studies.checks import judge_sensors
from kalscope_app.studies.comparisons import compute_overview, compute_variants
from kalscope_app.studies.tuning_map import compute_map
from kalscope_app.views.chart_tabs import lead_of
from kalscope_app.views.export import Choice, csv, files_of, limits_text
from kalscope_app.views.variants import FOR_ONE_CHANNEL, table_text
from kalscope_app.views.widgets import SlowJob

SENSORS = ("bench", "roof", "door")


def greenhouse(drift=0.0, n=800):
    g = np.random.default_rng(2)
    x = 20.0 + np.cumsum(g.normal(0.0, 0.02, n))
    z = x[:, None] + g.normal(size=(n, 3)) * [0.3, 0.2, 0.2] + [0.0, 0.5, -0.3]
    z[:, 2] += np.linspace(0.0, drift, n)
    values = np.column_stack([z, np.linspace(40.0, 50.0, n)])
    return Recording(0.1 * np.arange(n), (*SENSORS, "humidity"), ("degC",) * 3 + ("%",), values, 0.1, title="x.csv")


def fused(recording):
    found = estimate_fusion(recording.values[:, :3], names=SENSORS, momentum=0.0, robust=False)
    return apply_estimate(recording, SENSORS, found)(opened(recording))


@pytest.fixture(scope="module")
def state():
    return fused(greenhouse())


@pytest.fixture
def view(tmp_path):
    """The folder "Fuse sensors" of a dashboard that is not started."""
    with guarded_server(port=0) as guarded:
        yield Dashboard(guarded.server, opened(greenhouse()), tmp_path)._fusion


def test_channels_of_one_unit_are_offered_and_a_row_follows_its_sensor(view, state):
    for channel, names in ("bench", SENSORS), ("humidity", ()):
        view.show(compute_frame(select_channel(channel)(opened(greenhouse()))))
        assert tuple(row.name for row in view._rows if row.name) == names
        assert view._folder.visible == bool(names)
        assert not any(row.ticked for row in view._rows)
    for shown in state, set_taking_part("door", False)(state):
        view.show(compute_frame(shown))
        bench, _, door = view._rows[:3]
        used = shown is state
        assert bench._tick.label == f"bench: share {100 * shown.fusion.shares['bench']:.0f} %"
        assert (door.ticked, door._tick.visible, door._boxes["r"]._text.visible) == (used, True, used)
        assert ("share" in door._tick.label) == used


def test_the_job_fits_the_ticked_sensors_by_a_reference_and_can_be_cancelled(view, monkeypatch):
    single = opened(greenhouse(n=200))
    session = view._session = Session(single)
    view._search(single, ("bench", "roof"), "roof")
    found = session.apply_requests()[0].fusion.tuning
    assert (found.sensors, found.offset[1]) == (("bench", "roof"), 0.0)
    monkeypatch.setattr(SlowJob, "__enter__", lambda _: Progress(cancelled=lambda: True))
    with pytest.raises(Cancelled):
        view._search(single, ("bench", "roof"), None)


@pytest.mark.slow
def test_the_verdict_names_the_sensor_that_drifts_and_is_good_without_it(state):
    judge = partial(judge_sensors, kept=Cache())
    alike, silent, drifting = greenhouse(), greenhouse(), fused(greenhouse(drift=2.0))
    alike.values[:, 1:3] += np.random.default_rng(3).normal(0.0, 0.5, (800, 1))
    silent.values[300:500, 1] = np.nan
    for shown, word, tone, finding in (
        (state, "fused", "good", ""),
        (drifting, "door disagrees", "bad", "door drifts"),
        (set_taking_part("door", False)(drifting), "fused", "good", ""),
        (fused(alike), "sensors share noise", "bad", ""),
        (fused(silent), "roof sent no data", "note", ""),
    ):
        judged = judge(shown)
        assert (judged.judgement.word, judged.judgement.tone) == (word, tone)
        assert finding in "".join(one.text for one in judged.judgement.findings)
    assert any("offset" in note for note in judge(state).notes)
    assert judge(select_channel("roof")(drifting)) is None


def test_code_and_csv_are_those_of_the_fused_sensors(state):
    without = set_taking_part("roof", False)(state)
    files = files_of(without, Choice("arduino", all_channels=True))
    assert "Fusion" in "".join(files)
    assert "humidity" not in "".join(files.values()) + limits_text(without)
    head, first = csv(without).decode().splitlines()[:2]
    assert head == "time,bench,door,fused,fused_variance"
    assert float(first.split(",")[3]) == fuse(without.readings, without.fusion.used.params).x[0]


def test_what_belongs_to_one_channel_is_refused_in_words_and_not_called_current(state):
    with pytest.raises(BadSetting, match="one channel"):
        pin_present(state)
    with pytest.raises(BadSetting, match="fused sensors"):
        send_setting(state, None)
    assert "one channel" in compute_map(state, Cache()).note
    assert any("tuning file" in remark for remark in share_line(state).remarks)
    assert table_text(compute_variants(state, Cache())) == FOR_ONE_CHANNEL
    assert "current channel" not in lead_of(compute_overview(state, Cache()))
