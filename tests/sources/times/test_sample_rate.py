"""The rate and the pauses of simulated devices, and laws that hold for all stamps."""

import numpy as np
import pytest
from each import each
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_device import DEVICES, Device

from kalscope.sources.reading.axis import find_rate

RNG = np.random.default_rng(3)


@pytest.mark.slow
@each("seed", range(3))
@each("name", DEVICES)
def test_the_rate_and_the_pauses_of_a_device_are_found(name, seed):
    device, stamps = DEVICES[name]
    true, time, missing = device.run(6000, seed)
    found = find_rate(time)
    run_rate = 1 / np.median(np.diff(true)) if not device.loop_jitter else device.rate
    assert found.stamps in stamps.split(" or ")
    assert abs(1 / found.period - run_rate) <= max(0.005, 3 * found.error / found.period) * run_rate
    assert found.error < 0.05 * found.period
    if device.buffer == 1:
        assert found.pauses.tolist() == missing.tolist()
    else:  # the samples of a pause arrive with the next delivery
        assert len(found.pauses) == len(missing)


@each("place", [5, 135, 398])
@each("error", [-1e8, 1e8])
def test_a_damaged_stamp_does_not_change_the_rate(place, error):
    time = np.cumsum(0.001 * RNG.uniform(0.5, 1.5, 400))
    time[place] += error
    assert find_rate(time).period == pytest.approx(0.001, rel=0.1)


LOSSY = {
    "2 %": Device(lost=0.02),
    "40 %": Device(lost=0.4),
    "20 % of noisy steps": Device(104, loop_jitter=0.02, lost=0.2),
    "20 % of 1 Hz in whole s": Device(1.0, clock=1.0, lost=0.2),
    "30 % of 1 kHz in whole ms": Device(1000, clock=1e-3, lost=0.3),
}


@each("name", LOSSY)
def test_lost_samples_are_gaps_and_do_not_change_the_rate(name):
    device = LOSSY[name]
    _, time, missing = device.run(6000)
    found = find_rate(time)
    assert found.period * device.rate == pytest.approx(1, abs=5e-3)
    assert found.pauses.tolist() == missing.tolist()


def test_a_late_delivery_is_no_pause():
    time = np.arange(400) * 0.01
    time[100:112] = time[111]  # 11 samples were late
    found = find_rate(time)
    assert (found.period, found.pauses.size) == (0.01, 0)
    time[100:] += 0.2  # these never come early enough
    assert find_rate(time).pauses.tolist() == [99]


def test_extra_rows_in_between_leave_the_rate_alone():
    """Hourly reports beside one every five minutes, as weather stations send them."""
    regular = np.arange(0, 86400, 300.0)
    time = np.sort(np.concatenate((regular, np.arange(24) * 3600 + 53 * 60.0)))
    found = find_rate(time)
    assert (found.period, found.pauses.size) == (300.0, 0)


@pytest.mark.parametrize("rows", [10, 500])
def test_a_logger_that_wakes_now_and_then_has_pauses_and_no_bursts(rows):
    period = 0.01 if rows > 100 else 1.0
    time = np.concatenate([start + period * np.arange(rows) for start in 600.0 * np.arange(20)])
    found = find_rate(time)
    assert (found.period, found.pauses.size) == (period, 19)
    assert found.stamps != "bursts"


def test_every_tenth_step_of_an_sd_card_counts():
    """Nine steps of 1 or 2 ms, then one of 19 while the card writes: the mean is what the filter meets."""
    steps = np.tile([2, 2, 1, 2, 2, 1, 2, 2, 1, 19], 300) * 1e-3
    found = find_rate(np.concatenate(([0.0], np.cumsum(steps))))
    assert (found.stamps, found.pauses.size) == ("uneven", 0)
    assert found.period == pytest.approx(3.4e-3, rel=1e-3)


@pytest.mark.parametrize("time", [[5.0], [3.0, 2.0, 1.0], [1.0, 1.0]])
def test_stamps_that_never_rise_have_no_rate(time):
    assert find_rate(np.array(time)) is None


@given(st.integers(2, 400), st.sampled_from([0.001, 0.004, 0.01, 0.02, 1.0, 60.0, 3600.0]), st.integers(0, 10**6))
def test_even_stamps_keep_their_median_step_to_the_last_digit(n, step, first):
    time = np.round((first + np.arange(n)) * step, 6)
    found = find_rate(time)
    assert (found.stamps, found.pauses.size) == ("even", 0)
    assert found.period == float(f"{np.median(np.diff(time)):.9g}")


@settings(max_examples=30)
@given(
    st.sampled_from(sorted(DEVICES)),
    st.integers(0, 20),
    st.sampled_from([1.0, 2.0, 8.0]),
    st.sampled_from([0.0, 1024.0, -65536.0]),
)
def test_shifted_and_stretched_stamps_have_the_shifted_and_stretched_rate(name, seed, scale, shift):
    _, time, _ = DEVICES[name][0].run(1500, seed)
    found, changed = find_rate(time), find_rate(scale * time + shift)
    if scale == 1.0 or found.stamps != "bursts":  # what comes slower than 0.1 s is no burst
        assert changed.stamps == found.stamps
        assert changed.period == pytest.approx(scale * found.period, rel=1e-6)
        assert changed.pauses.tolist() == found.pauses.tolist()


@each("size", [1e-300, 1e-120, 1e120, 1e300])
def test_stamps_of_any_size_are_read_without_a_warning(size):
    found = find_rate(np.cumsum(np.random.default_rng(1).exponential(size, 100)))
    assert np.isinf(found.error)
    assert 0 < found.period < np.inf
