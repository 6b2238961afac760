"""The time of the samples: units of stamps, rates and pauses of simulated devices, laws, coarse clocks, wraps."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kalscope.sources.grammar.timestamps import TimeColumn, stamp_parser
from kalscope.sources.reading.account import summary
from kalscope.sources.reading.axis import (
    GivenPeriod,
    counted_time,
    find_rate,
    jitter_of,
    place_evenly,
    rate_words,
    read_time,
    to_seconds,
    unit_by_magnitude,
)


@dataclass(frozen=True)
class Device:
    """How samples are taken, delivered and stamped."""

    rate: float = 100.0
    """Hz."""
    stamp_jitter: float = 0.0
    """Noise of each stamp, standard deviation in periods."""
    loop_jitter: float = 0.0
    """Noise of each step between two samples, standard deviation in periods."""
    buffer: int = 1
    """Samples that are delivered at once, stamped as they arrive."""
    drain: float = 0.0
    """Seconds between two rows of one delivery."""
    clock: float = 1e-6
    """Resolution of the stamps in s."""
    pauses: int = 0
    pause: float = 0.0
    """Seconds of the shortest pause."""
    lost: float = 0.0
    """Share of samples that are lost at random."""

    def run(self, n, seed=0):
        """True times, stamps from 0, and the samples, from 0, after which samples are missing."""
        rng = np.random.default_rng(seed)
        steps = (1 + self.loop_jitter * rng.normal(size=n - 1).clip(-3, 3)) / self.rate
        at = np.sort(rng.choice(np.arange(n // 20, n - n // 20), self.pauses, replace=False))
        steps[at] += self.pause * rng.uniform(1, 3, size=self.pauses)
        true = np.concatenate(([0.0], np.cumsum(steps))) + rng.uniform(0, 1)
        kept = np.flatnonzero(rng.random(n) >= self.lost)
        true, missing = true[kept], np.flatnonzero((np.diff(kept) > 1) | np.isin(kept[:-1], at))
        stamps = true + self.stamp_jitter / self.rate * rng.normal(size=len(true))
        if self.buffer > 1:
            delivery = np.arange(len(true)) // self.buffer
            last = np.append(np.flatnonzero(np.diff(delivery)), len(true) - 1)
            within = np.arange(len(true)) - delivery * self.buffer
            stamps = stamps[last[delivery]] + self.drain * within * rng.uniform(0.5, 1.5, len(true))
            stamps = np.maximum.accumulate(stamps)
        stamps = np.round(np.floor(stamps / self.clock) * self.clock, 9)
        return true - stamps[0], stamps - stamps[0], missing


DEVICES = {
    "even": [Device(), Device(pauses=3, pause=2.0), Device(lost=0.02)],
    "uneven": [
        Device(64, clock=1e-3), Device(490, clock=1e-3), Device(900, clock=1e-3), Device(stamp_jitter=0.1),
        Device(loop_jitter=0.2), Device(loop_jitter=0.2, pauses=4, pause=0.5), Device(0.9, clock=1.0),
        Device(480, clock=1e-3, loop_jitter=0.3), Device(48, clock=0.015625, pauses=4, pause=1.0), Device(lost=0.4),
        Device(104, loop_jitter=0.02, lost=0.2), Device(1.0, clock=1.0, lost=0.2),
        Device(1000, clock=1e-3, lost=0.3), Device(0.7, clock=1.0, stamp_jitter=0.3),
    ],
    "bursts": [
        Device(buffer=5, drain=1e-3), Device(250, buffer=20, drain=2e-4, clock=1e-3),
        Device(250, buffer=20, drain=2e-4, clock=1e-3, pauses=3, pause=2.0),
    ],
    "bursts or coarse": [Device(250, buffer=250, drain=1e-6, clock=1e-3)],
    "coarse": [
        Device(1100, clock=1e-3), Device(3000, clock=1e-3), Device(400, clock=1.0, pauses=4, pause=20.0),
        Device(67, clock=1.0), Device(67, clock=1.0, pauses=3, pause=5.0), Device(13.4, clock=1.0, loop_jitter=0.2),
        Device(1.3, clock=1.0), Device(100.4, clock=0.015625, stamp_jitter=0.3),
        Device(0.5, clock=60.0, pauses=3, pause=3600.0),
    ],
}  # fmt: skip
"""Devices by how their stamps lie."""
CASES = [(stamps, device) for stamps, devices in DEVICES.items() for device in devices]


@pytest.mark.parametrize(("form", "stamps", "seconds", "said"), [
    ("h:m:s", "23:59:59 00:00:00 00:00:01", [0, 1, 2], "once, like a clock at midnight"),
    ("h:m:s", "12:59:58 12:59:59 01:00:00", [0, 1, 2], "once, like a clock at noon"),
    ("h:m:s", "20:00:00 20:00:01 06:00:00", [0, 1, 36000], "once, like a clock at midnight"),
    ("elapsed", "59:59.5 00:00.5 59:59.5 00:00.5", [0, 1, 3600, 3601], "2 times, like a clock at the full hour"),
    ("elapsed", "99:59:59 100:00:00 0:00:00", [0, 1, -359999], "steps back once"),
    ("s", "86399 0 1", [86399, 86400, 86401], "once, like seconds of the day"),
    ("ms", "604799800 0 200", [604799.8, 604800, 604800.2], "once, like milliseconds of the week"),
    ("s", "4294.96 0.003 0.013", [4294.96, 4294.970296, 4294.980296], "once, like a 32-bit counter (micros())"),
    ("ms", "65519 65529 3", [65.519, 65.529, 65.539], "once, like a 16-bit counter"),
    ("ms", "4294966305 6 1003", [4294966.305, 4294967.302, 4294968.299], "once, like a 32-bit counter"),
    ("ms", "10 20 30 0 10", [0.01, 0.02, 0.03, 0, 0.01], "time steps back once"),  # the device restarted
    ("ms", "40000 40010 40020 0 10", [40, 40.01, 40.02, 0, 0.01], "time steps back once"),
    ("ms", "65520 65530 65525 65535", [65.52, 65.53, 65.525, 65.535], "time steps back once"),
    ("ms", "-10 65530 4", [-0.01, 65.53, 0.004], "time steps back once"),
    ("ymd", "2024-10-27T02:58 2024-10-27T02:59 2024-10-27T02:00", [0, 60, 120], "is set back by an hour"),
    ("ymd", "2024-10-27T02:58 2024-10-27T02:59 2024-10-27T02:30", [0, 60, -1680], "steps back once"),
])  # fmt: skip
def test_clocks_and_counters_that_begin_again_go_on_and_others_step_back(form, stamps, seconds, said):
    kinds = {"ymd": TimeColumn(0, "calendar"), **{unit: TimeColumn(0, "number", unit) for unit in ("s", "ms")}}
    column = kinds.get(form) or TimeColumn(0, "clock", clock=form)
    axis = read_time(np.array([stamp_parser(column, ".")(cell) for cell in stamps.split()]), column)
    assert axis.time == pytest.approx(seconds, abs=1e-6)
    assert any(said in note for note in axis.notes)


DAYS = np.arange(50) / 144
UNITS = {
    "s": [[0, 1, 2], [0.0, 8.5, 17.1], [0, 60, 120], [0, 3600, 7200], [0, 300, 600], [0, 5, 10],
        45123.5 + DAYS / 1.44, 45123.5 + np.arange(50) / 3, [1.7e9, 1.7e9 + 1],
        45123.5 + np.cumsum(np.random.default_rng(1).uniform(0, 0.1, 50))],
    "ms": [[7, 17, 27], [0, 1000, 2000], [3, 1004, 2006], [0, 60000, 120000], [0, 10000, 20011],
        [1.7e12, 1.7e12 + 10], [5012, 7015, 9018, 11022]],
    "us": [[71, 250_071, 500_079], [7e8, 7e8 + 2500, 7e8 + 5004], [1.7e15, 1.7e15 + 1e4], [1.2e9, 1.2e9 + 4e3]],
    "ns": [[584065454762638, 584065474483599], [1.7e18, 1.7e18 + 1e7]],
    "100ns": [[133540000000000000, 133540000001000000], [638451306000000000, 638451306000100000]],
    "day": [45123.5 + DAYS, 0.25 + DAYS / 300, np.round(45123.5 + DAYS / 10, 9), 739000 + DAYS,
        2460000.5 + 6 * DAYS],
}  # fmt: skip


@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_follows_from_the_size_of_stamp_and_step(unit):
    assert [unit_by_magnitude(np.array(stamps, dtype=float)) for stamps in UNITS[unit]] == [unit] * len(UNITS[unit])


@pytest.mark.parametrize(("first", "step", "date"), [
    *((45123.5, 1 / 144, "2023-07-16T12:00:00"), (739000.5, 1 / 144, "2023-04-24T12:00:00")),
    *((60123.25, 1 / 144, "2023-06-28T06:00:00"), (2460000.5, 1 / 144, "2023-02-25T00:00:00")),
    *((3792385800, 600, "2024-03-04T08:30:00"), (1.7e12, 6e5, "2023-11-14T22:13:20")),  # LabVIEW, JavaScript
    *((133540000000000000, 6e9, "2024-03-04T04:26:40"), (638451306000000000, 6e9, "2024-03-04T06:30:00")),
])  # fmt: skip
def test_stamps_count_from_the_date_that_their_size_shows(first, step, date):
    seconds, said = to_seconds(first + step * np.arange(50), TimeColumn(0, "number"))
    assert seconds.tolist() == [600.0 * i for i in range(50)]
    assert f"time counts from {date}+00:00" in said


RNG = np.random.default_rng(3)


@pytest.mark.slow
@pytest.mark.parametrize(("stamps", "device"), CASES)
def test_the_rate_and_the_pauses_of_a_device_are_found(stamps, device):
    for seed in range(3):
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


def test_a_damaged_stamp_does_not_change_the_rate():
    for place, error in product((5, 135, 398), (-1e8, 1e8)):
        time = np.cumsum(0.001 * RNG.uniform(0.5, 1.5, 400))
        time[place] += error
        assert find_rate(time).period == pytest.approx(0.001, rel=0.1)


LATE = np.arange(400) * 0.01
LATE[100:112] = LATE[111]


def pages(rows, period):
    return np.concatenate([start + period * np.arange(rows) for start in 600.0 * np.arange(20)])


FIVE_MINUTES = np.arange(0, 86400, 300.0)
RATES = {  # the stamps, the period, and how many pauses
    "11 rows that come late": (LATE, 0.01, 0),
    "rows that never come early enough": (LATE + 0.2 * (np.arange(400) >= 100), 0.01, 1),
    "reports every hour between even rows": ([*FIVE_MINUTES, *np.arange(180.0, 86400, 3600)], 300, 0),
    "reports every 20 min between even rows": ([*FIVE_MINUTES, *np.arange(180.0, 86400, 1200)], 300, 0),
    "a late row now and then, on no grid": (np.cumsum(np.tile([1.137] * 7 + [0.137], 20)), 1.012, 0),
    "a logger that wakes for 10 rows": (pages(10, 1.0), 1.0, 19),
    "a logger that wakes for 500 rows": (pages(500, 0.01), 0.01, 19),
    "an SD card that writes at every tenth row": (np.cumsum(np.tile([2, 2, 1, 2, 2, 1, 2, 2, 1, 19], 300)), 3.4, 0),
}


@pytest.mark.parametrize("name", RATES)
def test_the_rate_is_what_a_filter_meets(name):
    time, period, pauses = RATES[name]
    found = find_rate(np.sort(time) * (1e-3 if "SD" in name else 1))
    assert found.period == pytest.approx(period * (1e-3 if "SD" in name else 1), rel=1e-3)
    assert (found.pauses.size, found.stamps == "bursts") == (pauses, False)


@pytest.mark.slow
@given(st.integers(2, 400), st.sampled_from([0.001, 0.004, 0.01, 0.02, 1.0, 60.0, 3600.0]), st.integers(0, 10**6))
def test_even_stamps_keep_their_median_step_to_the_last_digit(n, step, first):
    time = np.round((first + np.arange(n)) * step, 6)
    found = find_rate(time)
    assert (found.stamps, found.pauses.size) == ("even", 0)
    assert found.period == float(f"{np.median(np.diff(time)):.9g}")


@pytest.mark.slow
@settings(max_examples=30)
@given(*map(st.sampled_from, (CASES, range(20), (1.0, 2.0, 8.0), (0.0, 1024.0, -65536.0))))
def test_shifted_and_stretched_stamps_have_the_shifted_and_stretched_rate(case, seed, scale, shift):
    _, time, _ = case[1].run(1500, seed)
    found, changed = find_rate(time), find_rate(scale * time + shift)
    if scale == 1.0 or found.stamps != "bursts":  # what comes slower than 0.1 s is no burst
        assert changed.stamps == found.stamps
        assert changed.period == pytest.approx(scale * found.period, rel=1e-6)
        assert changed.pauses.tolist() == found.pauses.tolist()


def test_samples_of_a_coarse_clock_are_where_they_were_taken_and_a_rate_that_drifts_is_followed():
    for device in (Device(67, clock=1.0), Device(1.3, clock=1.0), Device(3000, clock=1e-3)):
        true, time, _ = device.run(6000)
        placed = place_evenly(time, find_rate(time))
        np.testing.assert_allclose(np.diff(placed), 1 / device.rate, rtol=1e-3)
        assert np.abs(placed - true).max() <= 1.01 / device.rate
    true = np.cumsum(np.linspace(0.014, 0.018, 20_000))
    placed = place_evenly(np.floor(true), find_rate(np.floor(true)))
    assert np.abs(placed - true).max() <= 0.15
    assert np.all(np.diff(placed) > 0)


NUMBER = TimeColumn(0, "number", "ms")


def test_stamps_too_fine_or_too_coarse_for_a_rate_are_no_time():
    for step in (1e-320, 1e-120, 1e60, 1e120):
        stamps, column = step * np.arange(60.0), TimeColumn(0, "number", "s")
        axis = read_time(stamps, column)
        assert (axis.timing.period, axis.time.tolist()) == (None, list(range(60)))
        assert any(note.endswith("which is not a time: the samples were counted") for note in axis.notes)
        assert read_time(stamps, column, given=GivenPeriod(0.5)).timing.period == 0.5


WHOLE_SECONDS = np.floor(np.arange(7000) / 67) * 1000


UNSTEADY = np.cumsum(np.random.default_rng(1).pareto(1.1, 400) * 10 + 2)
"""Stamps in ms without a scale at which they come steadily: median step 10 ms, mean step 90 ms."""


@pytest.mark.parametrize(("stamps", "given", "source", "rate", "said"), [
    (WHOLE_SECONDS, GivenPeriod(file=1 / 66.5), "file", 66.5, "the one that the file gives, 66.5 Hz"),
    (WHOLE_SECONDS, GivenPeriod(file=1 / 33), "stamps", 67, "gives a sample rate of 33.0 Hz, but its stamps"),
    (np.arange(500) * 10.0, GivenPeriod(file=0.02), "stamps", 100, "gives a sample rate of 50.0 Hz, but its"),
    (np.arange(500) * 10.0, GivenPeriod(option=0.02), "option", 50, "stamps are read as ms"),
    (UNSTEADY, GivenPeriod(file=0.03), "file", 1 / 0.03, "the one that the file gives, 33.3 Hz"),
    (UNSTEADY, GivenPeriod(file=0.001), "stamps", 99.1, "gives a sample rate of 1.00 kHz, but its stamps"),
    (np.array([0.0, 0, 0, 1000, 1000]), GivenPeriod(file=0.34), "file", 1 / 0.34, "the file gives, 2.94 Hz"),
])  # fmt: skip
def test_a_rate_that_is_given_has_its_place(stamps, given, source, rate, said):
    axis = read_time(stamps, NUMBER, given=given)
    assert axis.timing.source == source
    assert axis.timing.period == pytest.approx(1 / rate, rel=1e-3)
    assert any(said in note for note in axis.notes)


def test_samples_without_stamps_are_counted_in_the_period_that_is_given():
    assert counted_time(4, GivenPeriod()).time.tolist() == [0, 1, 2, 3]
    axis = counted_time(4, GivenPeriod(file=0.5), start=1.5e9)
    assert axis.time.tolist() == [0, 0.5, 1, 1.5]
    assert (axis.timing.source, axis.timing.summary) == ("file", "2.00 Hz as stated in the file")
    assert axis.notes == ("time counts from 2017-07-14T02:40:00+00:00",)


@pytest.mark.slow
def test_steps_that_vary_have_their_standard_deviation_and_pauses_do_not_count(read):
    steps = np.random.default_rng(0).choice([0.06, 0.08, 0.1, 0.13], 2000)
    paused = np.insert(steps, [300, 900], 50.0)
    for some, true in ((np.full(500, 0.01), np.zeros(1)), (paused, steps), (steps, steps)):
        record = read("t_s,z\n" + "".join(f"{t:.6f},{i % 7}\n" for i, t in enumerate(np.cumsum(some))))
        assert jitter_of(record) == pytest.approx(true.std() / record.sample_period, rel=1e-3, abs=1e-9)
        assert any("the stamps are uneven" in note for note in record.report.notes) == (true.std() > 0.0)
    assert rate_words(record.sample_period, jitter_of(record)) == "10.7 Hz, steps ± 28 %"
    assert summary(record).endswith(", 10.7 Hz from uneven stamps, standard error 0.71 %, steps ± 28 %")
