"""Where samples are placed whose stamps come in bursts or from a coarse clock."""

import numpy as np
import pytest
from each import each
from simulated_device import DEVICES, Device

from kalscope.sources.reading.axis import find_rate, place_evenly

CROWDED = [name for name, (_, stamps) in DEVICES.items() if stamps not in ("even", "uneven")]


@each("name", CROWDED)
def test_placed_samples_rise_and_stay_near_their_stamps(name):
    _, time, _ = DEVICES[name][0].run(6000)
    rate = find_rate(time)
    placed = place_evenly(time, rate)
    assert np.all(np.diff(placed) >= 0)
    assert np.abs(placed - time).max() <= 2.5 * rate.longest


@pytest.mark.parametrize("name", ["67 Hz in whole s", "1.3 Hz in whole s", "3 kHz in whole ms"])
def test_samples_of_a_coarse_clock_are_where_they_were_taken(name):
    device = DEVICES[name][0]
    true, time, _ = device.run(6000)
    placed = place_evenly(time, find_rate(time))
    np.testing.assert_allclose(np.diff(placed), 1 / device.rate, rtol=1e-3)
    assert np.abs(placed - true).max() <= 1.01 / device.rate


def test_a_pause_stays_as_long_as_it_was():
    device = Device(67, clock=1.0, pauses=3, pause=20.0)
    true, time, missing = device.run(6000)
    placed = place_evenly(time, find_rate(time))
    pauses = (true[missing + 1] - true[missing]).tolist()
    assert (placed[missing + 1] - placed[missing]).tolist() == pytest.approx(pauses, abs=0.2)
    within = np.delete(np.diff(placed), missing)
    np.testing.assert_allclose(within, 1 / 67, rtol=0.02)


def test_a_rate_that_drifts_is_followed():
    true = np.cumsum(np.linspace(0.014, 0.018, 20_000))
    time = np.floor(true)
    placed = place_evenly(time, find_rate(time))
    assert np.abs(placed - true).max() <= 0.15
    assert np.all(np.diff(placed) > 0)
