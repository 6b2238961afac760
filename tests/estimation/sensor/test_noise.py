"""The noise of a sensor from a still stretch and from a data sheet."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import BadSetting
from kalscope.estimation.noise import noise_from_datasheet, noise_from_still

# --- a still stretch ------------------------------------------------------------------------------------


def test_still_noise_is_the_variance_about_a_straight_line():
    g = np.random.default_rng(0)
    z = 20 + 0.3 * np.arange(4000) + g.normal(0, 0.5, 4000)
    z[100:150] = np.nan
    found = noise_from_still(z)
    i = np.flatnonzero(np.isfinite(z))
    residual = z[i] - np.polyval(np.polyfit(i, z[i], 1), i)
    assert found.r == found.variance == pytest.approx(residual @ residual / (len(i) - 2), rel=1e-9)
    assert found.r == pytest.approx(0.25, rel=0.1)
    assert found.drift == pytest.approx(0.3, rel=1e-3)
    assert found.samples == len(i)


def test_still_noise_is_at_least_that_of_the_steps():
    """A 10-bit converter that toggles once in 200 readings: the floor Δ²/12 is more than its variance."""
    step = 0.0049
    z = np.full(200, 3 * step)
    z[77] = 4 * step
    found = noise_from_still(z)
    assert found.quantum == pytest.approx(step, rel=1e-9)
    assert found.r == found.floor == pytest.approx(step**2 / 12)
    assert found.variance < found.floor
    assert "steps" in found.message


def test_a_given_quantum_speaks_for_readings_that_never_change():
    assert noise_from_still([5.0] * 20, quantum=0.5).r == pytest.approx(0.25 / 12)


@pytest.mark.parametrize(
    ("z", "quantum"),
    [([5.0] * 20, None), ([1.0, 2.0, 3.0], None), (np.ones((9, 2)), None), ([np.inf] * 9, None), ([1.0] * 9, -1.0)],
)
def test_a_stretch_without_noise_to_measure_is_refused(z, quantum):
    with pytest.raises(BadSetting):
        noise_from_still(z, quantum)


def test_spikes_do_not_belong_to_the_noise_of_a_still_stretch():
    g = np.random.default_rng(1)
    good = 3 + 0.01 * np.arange(400) + g.normal(0, 0.5, 400)
    z = good.copy()
    z[::40] += 30.0
    found = noise_from_still(z)
    kept = np.where(np.arange(400) % 40 == 0, np.nan, good)
    assert found.r == pytest.approx(noise_from_still(kept).r, rel=1e-12)
    assert found.samples == 390
    assert found.message.endswith("10 spikes beyond 6 σ left out.")


# --- the data sheet -------------------------------------------------------------------------------------


def test_noise_from_a_data_sheet():
    assert noise_from_datasheet(sigma=0.03) == pytest.approx(9e-4)
    assert noise_from_datasheet(density=400e-6, bandwidth_hz=50.0) == pytest.approx(400e-6**2 * 50)


@pytest.mark.parametrize(
    "values",
    [{}, {"sigma": 1.0, "density": 1.0}, {"density": 1.0}, {"sigma": 0.0}, {"density": 1.0, "bandwidth_hz": -1.0}],
)
def test_half_a_data_sheet_is_refused(values):
    with pytest.raises(BadSetting):
        noise_from_datasheet(**values)
