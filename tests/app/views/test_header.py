"""The header: what is open and at which rate, the lag and the noise, and how far uneven steps spread both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kalscope import open_source
from kalscope.common.text import duration, lag_text
from kalscope.recording import Recording
from kalscope.sources.reading.axis import jitter_of
from kalscope_app.engine.filter_runs import choose_samples
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.opening import opened
from kalscope_app.views.window import numbers_line, record_line, spread_of_span


def recording(time, title="log.csv", period=0.01):
    z = np.random.default_rng(3).normal(size=(len(time), 1))
    return Recording(np.asarray(time, dtype=float), ("z",), ("V",), z, period, title=title)


def frame_of(record):
    state = opened(record).with_tuning(q=0.01, r=1.0, momentum=0.0)
    return compute_frame(state, 0, choose_samples(record, state.channel, None))


def uneven(n=5000, low=0.005, high=0.015):
    return np.cumsum(np.random.default_rng(7).uniform(low, high, n))


def test_even_steps_have_no_spread_whatever_the_span():
    time = 0.01 * np.arange(500)
    for samples in (0.3, 1.0, 7.5, 100.0):
        assert spread_of_span(time, samples) == pytest.approx((0.01 * samples, 0.01 * samples), abs=1e-9)


def test_one_step_spreads_as_its_percentiles_do():
    low, high = spread_of_span(uneven(), 1.0)
    assert (low, high) == pytest.approx((0.0055, 0.0145), abs=0.0002)  # 5 % and 95 % of 5 to 15 ms


def test_the_spread_of_many_independent_steps_falls_as_one_over_the_square_root_of_their_number():
    time = uneven(200_000)
    widths = [np.subtract(*spread_of_span(time, samples)[::-1]) / samples for samples in (16.0, 64.0, 256.0)]
    assert widths[0] / widths[1] == pytest.approx(2.0, rel=0.1)
    assert widths[1] / widths[2] == pytest.approx(2.0, rel=0.1)


def test_a_few_pauses_decide_nothing():
    time = 0.01 * np.arange(1000)
    time[500:] += 60.0
    assert spread_of_span(time, 3.0) == pytest.approx((0.03, 0.03), abs=1e-9)


@pytest.mark.parametrize(
    ("time", "samples"),
    [
        (np.arange(5.0), 2.0),
        (np.arange(100.0), np.inf),
        (np.arange(100.0), 0.0),
        ([], 1.0),
        (np.arange(100.0), 1e6),
    ],
)
def test_where_nothing_can_be_told_there_is_no_spread(time, samples):
    assert spread_of_span(np.asarray(time, dtype=float), samples) is None


def shown(record):
    return shown_with(record, jitter_of(record))


def shown_with(record, jitter):
    return record_line(record, jitter), numbers_line(frame_of(record), jitter)


def test_an_even_recording_shows_name_rate_lag_and_noise_and_no_more():
    name, numbers = shown(open_source("demo"))
    assert (name, numbers) == ("**Bending finger** · 50.0 Hz", "lag **190 ms** · noise **−13.0 dB**")


def test_an_uneven_recording_shows_its_lag_and_how_far_it_spreads(tmp_path):
    log = tmp_path / "log.csv"
    z = np.random.default_rng(3).normal(size=5000)
    log.write_text("t,z\n" + "".join(f"{t:.6f},{v:.6f}\n" for t, v in zip(uneven(), z, strict=True)))
    record = open_source(str(log))
    name, numbers = shown(record)
    assert name.startswith("**log\\.csv** · 10")
    assert " Hz, steps ± 2" in name  # the standard deviation of a uniform law from 0.5 to 1.5 is 29 %
    lag = float(frame_of(record).steady.lag_samples)
    low, high = spread_of_span(record.time, lag)
    assert (
        f"lag **{lag_text(lag, record.sample_period)}** ({duration(low)} to {duration(high)}: the steps" in numbers
    )
    assert low < lag * record.sample_period < high


def test_steps_that_change_the_lag_by_little_are_named_beside_the_rate_alone():
    time = 0.01 * np.arange(5000) + np.random.default_rng(1).uniform(0.0, 0.0005, 5000)
    name, numbers = shown_with(recording(time), 0.03)
    assert name.endswith("100 Hz, steps ± 3.0 %")
    assert numbers == "lag **95.1 ms** · noise **−13.0 dB**"


def test_without_a_sample_period_the_lag_is_in_samples():
    name, numbers = shown(recording(np.arange(300.0), period=None))
    assert name.endswith("sample rate unknown")
    assert numbers.startswith("lag **9.51 samples** · ")


def test_the_name_of_a_file_is_no_markup():
    hostile = replace(open_source("demo"), title="<img src=x> *a* [b](c)")
    assert shown(hostile)[0].startswith(r"**\<img src\=x\> \*a\* \[b\]\(c\)**")
