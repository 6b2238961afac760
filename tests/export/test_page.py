"""`kalscope page`: what goes into the page, and what is refused; tests/browser/test_page.py opens it."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import kalscope
from kalscope import BadSetting, FilterParams, Recording, open_source
from kalscope.cli.app import run
from kalscope.export.page import FILES, make_page
from kalscope.tuning.tuning import ChannelTuning, typed_chain

ONE = ChannelTuning.of_params("flex", "counts", FilterParams(q=1.0, r=1.0), "")


def data_of(text):
    _, _, after = text.partition('id="data">')
    return json.loads(after.partition("</script>")[0])


def samples_of(packed):
    raw = gzip.decompress(base64.b64decode(packed["data"]))
    if packed["kind"] == "doubles":
        return np.frombuffer(raw, "<f8")
    steps = np.frombuffer(raw, "<i4").astype(float)
    there = steps != -(2.0**31)
    z = np.full(len(steps), np.nan)
    z[there] = np.cumsum(steps[there]) / 10.0 ** packed["digits"]
    return z


STEPS = [1.5, np.nan, -2.25, 1e5], [np.nan, np.nan]
DOUBLES = [0.1, 0.2, 0.30000000000000004], [1e308, np.nan, -1e308]


@pytest.mark.parametrize(("z", "kind"), [*((z, "steps") for z in STEPS), *((z, "doubles") for z in DOUBLES)])
def test_samples_come_back_to_the_last_bit(z, kind):
    recording = replace(Recording.of_samples(np.array(z)), names=("flex",))
    packed = data_of(make_page(recording, [ONE]))["channels"][0]["z"]
    assert packed["kind"] == kind
    np.testing.assert_array_equal(samples_of(packed), z)


@pytest.mark.slow
def test_uneven_time_is_kept_and_of_a_large_recording_the_first_rows_within_5_mb():
    recording = replace(open_source("demo"), time=np.cumsum(np.r_[0.0, np.full(998, 0.02), 5.0]))
    np.testing.assert_allclose(samples_of(data_of(make_page(recording, [ONE]))["time"]), recording.time)
    z = np.random.default_rng(1).normal(size=1_000_000)
    text = make_page(replace(Recording.of_samples(z), names=("flex",)), [ONE])
    assert len(text.encode()) < 5_000_000
    assert re.search(r"the first \d+.* of 1.000.000 samples", text)


@pytest.mark.slow
def test_the_command_and_the_result_write_the_page_and_refuse_what_it_cannot_run_or_would_overwrite(
    tmp_path, capsys
):
    page = tmp_path / "page.html"
    assert run(["page", "demo", "-o", str(page)]) == 0
    shown = data_of(page.read_text("utf-8"))["channels"][0]
    assert shown["start"]["q"] == pytest.approx(kalscope.tune(open_source("demo")).params.q)
    assert run(["page", "demo", "-o", str(page)]) == 2
    assert "--force" in capsys.readouterr().err
    result = kalscope.tune(open_source("demo"), lag_ms=50)
    with pytest.raises(BadSetting, match=re.escape("page.html")):
        result.page(page)
    result.page(page, force=True)
    for changed, kind in (
        ({"chain": typed_chain("median 5, kalman")}, "is a chain"),
        ({"fast": 30.0}, "two speeds"),
    ):
        with pytest.raises(BadSetting, match=kind):
            make_page(open_source("demo"), [replace(ONE, **changed)])
    assert data_of(page.read_text("utf-8"))["channels"][0]["start"]["q"] == result.params.q


def test_the_chart_is_the_published_one():
    published = "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f"  # uplot 1.6.32, npm registry
    assert hashlib.sha256((FILES / "uPlot.iife.min.js").read_bytes()).hexdigest() == published
