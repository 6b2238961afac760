"""The default channel measures something; what a channel is otherwise is found in its values first."""

import numpy as np
import pytest

from kalscope.analysis import channel_kinds as kinds
from kalscope.analysis.channel_kinds import channel_kinds, default_channel
from kalscope.recording import Recording

N = 400
ROWS = np.arange(N)
RNG = np.random.default_rng(7)
NOISE = RNG.normal(20.0, 0.3, N)
WALK = np.rint(500 + np.cumsum(RNG.normal(0.0, 2.0, N)))


def recording(**channels):
    values = np.column_stack(list(channels.values()))
    return Recording(0.1 * np.arange(len(values)), tuple(channels), ("",) * len(channels), values, 0.1)


def kind(z, name="value 1"):
    return channel_kinds(recording(**{name: np.asarray(z, dtype=float), "other": NOISE[: len(z)]}))[name]


MEASURE = {
    "noise": NOISE,
    "an ADC": WALK,
    "an ADC of two bits": RNG.integers(0, 4, N),
    "a quantised warming": np.rint(20 + 0.05 * ROWS + RNG.normal(0.0, 0.5, N)),
    "a sawtooth with noise": ROWS % 50 + NOISE,
    "a step": np.where(ROWS < 200, 0.0, 5.0) + NOISE,
    "a saturated sensor": np.clip(NOISE, 19.9, 20.1),
    "one wild value": np.where(ROWS == 0, 1.6e9, WALK),
    "whole numbers that come back": [50, 40, 60, 55, 40, 52, 48, 61, 44, 58],
}


@pytest.mark.parametrize("z", MEASURE.values(), ids=MEASURE)
@pytest.mark.parametrize("name", ["value 1", "temperature", "x", "a"])
def test_what_measures_is_a_measurement(z, name):
    assert kind(z, name) == kinds.MEASUREMENT


NO_MEASUREMENT = {
    "a counter": (ROWS, kinds.COUNTER),
    "a counter with lost packets": (ROWS[RNG.random(N) > 0.04], kinds.COUNTER),
    "a counter of one byte": (ROWS % 256, kinds.COUNTER),
    "an even clock": (20 * ROWS, kinds.CLOCK),
    "an uneven clock": (np.cumsum(RNG.integers(18, 23, N)), kinds.CLOCK),
    "epoch milliseconds": (1_700_000_000_000 + np.cumsum(RNG.integers(9, 12, N)), kinds.CLOCK),
    "an hour without a name": (ROWS // 40, kinds.DATE_PART),
    "minutes of the hour": (ROWS // 2 % 60, kinds.DATE_PART),
    "a flag": (RNG.integers(0, 2, N), kinds.FLAG),
    "a constant": (np.full(N, 3.3), kinds.CONSTANT),
    "an empty column": (np.full(N, np.nan), kinds.EMPTY),
    "two values a minute": (np.where(ROWS % 30 == 0, NOISE, np.nan), kinds.SPARSE),
    "hours as decimals": (0.01 * ROWS + 1e-5 * NOISE, kinds.RISING),
}


@pytest.mark.parametrize(("z", "expected"), NO_MEASUREMENT.values(), ids=NO_MEASUREMENT)
def test_the_values_betray_what_does_not_measure(z, expected):
    assert kind(z) == expected


NAMED = [
    ("year", np.where(ROWS < 300, 2024, 2025), kinds.FLAG),
    ("Month", ROWS // 100 + 3, kinds.DATE_PART),
    ("Second", RNG.integers(0, 60, N), kinds.DATE_PART),
    ("RECORD", np.cumsum(RNG.integers(0, 3, N)), kinds.COUNTER),
    ("millis", np.cumsum(RNG.random(N) + 0.5), kinds.CLOCK),
    ("dt [s]", np.full(N, 0.1) + 1e-3 * NOISE, kinds.TIME_STEP),
    ("loop_us", 1e5 + NOISE, kinds.TIME_STEP),
    ("status", RNG.integers(0, 4, N), kinds.CODE),
    ("gpsLat", 48.1 + 1e-4 * NOISE, kinds.POSITION),
    ("longitude", 11.5 + 1e-4 * NOISE, kinds.POSITION),
    ("seq", np.where(ROWS % 50 == 7, ROWS + 2, ROWS), kinds.COUNTER),
    ("frame", np.cumsum(RNG.integers(1, 4, N)), kinds.COUNTER),
    ("Timestamp", 20 * (np.cumsum(RNG.integers(0, 3, N)) // 4), kinds.CLOCK),
    ("a", 1_700_000_000 + ROWS // 13, kinds.CLOCK),
    ("a", 1.7e9 + np.cumsum(RNG.integers(0, 2, N) * 0.25), kinds.CLOCK),
]


@pytest.mark.parametrize(("name", "z", "expected"), NAMED)
def test_a_name_tells_apart_what_looks_alike(name, z, expected):
    assert kind(z, name) == expected


@pytest.mark.parametrize("name", ["seconds", "lat", "count", "status", "year", "dt", "mm", "min", "seq"])
def test_a_name_alone_decides_nothing(name):
    assert kind(50.0 * NOISE, name) == kinds.MEASUREMENT


def test_the_default_is_the_first_channel_that_measures_or_the_one_with_most_to_say():
    made = recording(seq=ROWS, year=np.full(N, 2025), lat=48 + 1e-4 * NOISE, temp=NOISE, hum=WALK)
    assert default_channel(made) == "temp"
    assert default_channel(recording(seq=ROWS, ok=np.ones(N), valve=ROWS % 7 == 0, ms=20 * ROWS)) == "valve"
    assert default_channel(recording(seq=ROWS)) == "seq"


def test_a_long_recording_is_judged_by_parts_of_it():
    n = 100_000
    noise = RNG.normal(size=n)
    made = recording(seq=np.arange(n) % 65536, flag=np.arange(n) % 2, big=np.cumsum(noise**2), temp=noise)
    assert list(channel_kinds(made).values()) == [kinds.COUNTER, kinds.FLAG, kinds.RISING, kinds.MEASUREMENT]
