"""The rule by which a board measures r, sample by sample in float32: the figure of the host, and its refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.support.exported_rule import GROUPS, LEARNING, compiled_rule, rows_of

from kalscope import Recording
from kalscope.cli.demo_board import Sketch
from kalscope.errors import BadSetting
from kalscope.estimation.noise import noise_from_still
from kalscope.export.registry import export_tuning
from kalscope.filtering.classic import Chain
from kalscope.tuning.tuning import ChannelTuning, Tuning

ROWS = rows_of(2.0, 0.005)
COUNTS = (1.0, 0.0, 1023.0)
UNBOUNDED = (1.0,)


@pytest.fixture(scope="module")
def measure(tmp_path_factory):
    return compiled_rule(tmp_path_factory.mktemp("rule"))


def still(sigma=3.0, level=500.3, seed=0, rows=ROWS):
    return level + np.random.default_rng(seed).normal(0.0, sigma, rows)


def hosts_figure(z, step):
    measured = z[LEARNING + (len(z) - LEARNING) // (GROUPS + 1) :]
    return noise_from_still(np.asarray(measured, np.float32), step if step > 0.0 else None)


@pytest.mark.slow
def test_the_figure_is_the_hosts_at_noise_levels_and_quantisations_with_drift_and_spikes(measure):
    rng = np.random.default_rng(8)
    for i, sigma in enumerate(np.geomspace(0.05, 500.0, 20)):
        for j, step in enumerate((0.0, 0.25, 1.0, 4.0, 16.0)):
            z = still(sigma, seed=[i, j, 1]) + np.linspace(0.0, rng.uniform(0.0, 1.0) * sigma, ROWS)
            z[rng.integers(100, ROWS, 3)] += 40.0 * sigma + 40.0 * step
            z = np.round(z / step) * step if step else z
            z[rng.integers(LEARNING, ROWS, 4)] = np.nan
            found = measure(z, step)
            assert found.state == "FOUND", (sigma, step, found)
            assert found.r == pytest.approx(hosts_figure(z, step).r, rel=0.01), (sigma, step)
            assert found.spikes >= 2
            assert found.used + found.spikes + found.missing == GROUPS * ((ROWS - LEARNING) // (GROUPS + 1))
    z = np.round(
        still(1.3, 4e6, rows=rows_of(8.0, 0.001))
    )  # a sum of many samples on a high level keeps its digits
    assert measure(z, 1.0).r == pytest.approx(hosts_figure(z, 1.0).r, rel=1e-4)


def stepped(z, at, size):
    z[at:] += size
    return z


REFUSED = {
    "MOVING": [
        still() + np.linspace(0.0, 12.0, ROWS),
        still() + 5.0 * np.sin(np.arange(ROWS) / 40),
        stepped(still(), ROWS // 2, 8.0),
        500.0 + np.cumsum(still(1.0, 0.0)),
    ],
    "DEPENDENT": [still(1.0) + 3.0 * np.sin(np.arange(ROWS) * 0.9)],
    "UNEVEN": [np.where(np.arange(ROWS) < ROWS // 2, still(1.0), still(5.0, seed=1))],
    "MISSING": [np.where(np.arange(ROWS) < 90, still(), np.nan), np.full(ROWS, np.nan)],
    "SPIKES": [stepped(still(), ROWS // 2, 300.0)],
    "CUT_OFF": [np.full(ROWS, 1023.0), np.zeros(ROWS), np.clip(np.round(still(3.0, 1.0)), 0, 1023)],
    "EQUAL": [np.full(ROWS, 3.25), np.where(np.arange(ROWS) == 200, 85.0, 21.0625)],  # a sensor while it started
    "TOO_LARGE": [still(1e25, 1e27), still(8e37, 0.0)],
}


@pytest.mark.parametrize("state", REFUSED)
def test_what_shows_more_or_less_than_noise_is_refused(measure, state):
    for z in REFUSED[state]:
        found = measure(z, *(() if state == "EQUAL" else UNBOUNDED if state == "TOO_LARGE" else COUNTS))
        assert found.state == state
        assert state != "MISSING" or found.missing == 34
        assert state != "SPIKES" or found.spikes == 17


FOUND = [still(), still(0.3), np.round(still(1.5)), np.where(np.arange(ROWS) % 97 == 50, 800.0, still())]
WORDS = {"MOVING": "the level moves", "DEPENDENT": "neighbouring readings depend on each other"}
WORDS |= {"UNEVEN": "the noise is uneven", "MISSING": "no reading in", "EQUAL": "nearly all readings are equal"}
WORDS["FOUND"] = "calibrated r="


@pytest.mark.parametrize("state", WORDS)
def test_a_demo_board_decides_as_the_exported_rule(state):
    for z in REFUSED.get(state, FOUND):
        board = Sketch(Recording(np.arange(ROWS) * 0.005, ("light",), ("",), z[:, None], 0.005))
        assert board.obey(b"c 2\n") == b"# light calibrating rows=%d\r\n" % ROWS
        *_, last = b"".join(map(board.line, range(ROWS))).splitlines()
        assert WORDS[state] in last.decode()


@pytest.mark.slow
def test_still_noise_is_hardly_ever_refused_and_without_any_it_is_the_rounding_of_a_known_step(measure):
    found = [measure(still(sigma, seed=i)).state for i in range(20) for sigma in (0.1, 30.0)]
    assert found.count("FOUND") >= len(found) - 1
    equal = measure(np.full(ROWS, 512.0), *COUNTS)
    assert (equal.r, equal.variance) == (np.float32(1.0) / np.float32(12.0), 0.0)


def test_a_sketch_that_measures_is_for_filters_with_an_r_on_an_arduino():
    tuning = Tuning((ChannelTuning("light", "", 0.01, 4.0),))
    plain, measuring = export_tuning(tuning, "arduino"), export_tuning(tuning, "arduino", calibration=True)
    assert set(measuring) - set(plain) == {"KalscopeCalibration.h"}
    assert measuring["KalscopeFilter.h"] == plain["KalscopeFilter.h"]
    assert "calibrat" not in "".join(plain.values()).lower()
    assert "const float KALSCOPE_RATIO_LIGHT = 0.00249999994f;" in measuring["KalscopeCalibration.h"]
    assert "p VALUE (or inf), c SECONDS, k, f, or ?" in measuring["kalscope_filter.ino"]
    (light,), fusion = tuning.channels, ChannelTuning("level", "", 0.1, (1.0, 1.0), sensors=("a", "b"))
    for other, target, refusal in (
        (tuning, "c", "calibration must be for arduino .* .got c."),
        (Tuning((replace(light, r=0.0),)), "arduino", "r of light must be above 0"),
        (Tuning((replace(light, chain=Chain(5)),)), "arduino", "the Kalman filter alone .* .got median of 5"),
        (replace(tuning, fusion=fusion), "arduino", "filters of channels .got fused sensors."),
    ):
        with pytest.raises(BadSetting, match=refusal):
            export_tuning(other, target, calibration=True)
