"""How much the steps of a recording vary, and its rate in words."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import read_recording
from kalscope.sources.reading.account import summary
from kalscope.sources.reading.axis import jitter_of, rate_words


def written(tmp_path, time):
    file = tmp_path / "log.csv"
    z = np.random.default_rng(1).normal(size=len(time))
    file.write_text("t_s,z\n" + "".join(f"{t:.6f},{v:.5f}\n" for t, v in zip(time, z, strict=True)))
    return file


def uneven_steps(n=2000):
    return np.random.default_rng(0).choice([0.06, 0.08, 0.1, 0.13], n)


def test_even_stamps_have_no_jitter(tmp_path):
    record = read_recording(written(tmp_path, np.arange(500) * 0.01))
    assert jitter_of(record) == 0.0
    assert rate_words(record.sample_period, 0.0) == "100 Hz"


def test_steps_that_vary_have_their_standard_deviation(tmp_path):
    steps = uneven_steps()
    record = read_recording(written(tmp_path, np.cumsum(steps)))
    jitter = jitter_of(record)
    assert jitter == pytest.approx(steps.std() / steps.mean(), rel=1e-2)
    assert rate_words(record.sample_period, jitter) == "10.7 Hz, steps ± 28 %"
    assert summary(record).endswith(", 10.7 Hz from uneven stamps, standard error 0.71 %, steps ± 28 %")


def test_pauses_do_not_count(tmp_path):
    steps = uneven_steps()
    paused = steps.copy()
    paused[[300, 900]] = 50.0
    record = read_recording(written(tmp_path, np.cumsum(paused)))
    assert jitter_of(record) == pytest.approx(np.delete(steps, [300, 900]).std() / record.sample_period, rel=1e-3)
