"""Settings of other programs' filters: the recursion of the source has the lag and noise that the text gives."""

from __future__ import annotations

import math
import re
import statistics
from collections import deque
from dataclasses import replace
from functools import partial
from itertools import accumulate, pairwise

import numpy as np
import pytest
import yaml
from ruamel.yaml import YAML

from kalscope import BadSetting, ChannelTuning, Recording, Tuning, denoise, export_tuning, fuse, kalman_filter
from kalscope.export.settings import settings_of
from kalscope.filtering import classic
from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, Notch, OneEuro
from kalscope.filtering.steady import steady_state

PERIOD = 0.02
KALMAN = ChannelTuning("flex", "counts", q=0.08, r=4.0)


def chained(*chain):
    return replace(KALMAN, chain=Chain(*chain))


def tuned(one=KALMAN, period=PERIOD):
    return Tuning((one,), sample_period=period)


def text_of(target, one=KALMAN, period=PERIOD):
    ((_, text),) = export_tuning(tuned(one, period), target).items()
    return text


def filters_of(text):
    """The numbers of the only filter in the YAML of ESPHome or Home Assistant."""
    read = yaml.safe_load(text)
    ((one,),) = [read["filters"]] if "filters" in read else [read["sensor"][0]["filters"]]
    return one if "filter" in one else next(iter(one.values()))


def number(text, pattern):
    return float(re.search(pattern + r"([-+.e\d]+)", text)[1])


def smoothing(alpha, z):
    """x += alpha (z - x) from the first reading on."""
    return np.array(list(accumulate(z, lambda x, sample: x + alpha * (sample - x))))


def esphome(take, text, z):
    numbers = filters_of(text)
    assert numbers["send_every"] == 1
    if "alpha" in numbers:
        return smoothing(numbers["alpha"], z)
    window = deque(maxlen=numbers["window_size"])
    return np.array([take(window) for sample in z if window.append(sample) is None])


def home_lowpass(text, z):
    numbers = filters_of(text)
    new = 1.0 / numbers["time_constant"]
    steps = accumulate(z, lambda x, one: round((1.0 - new) * x + new * one, numbers["precision"]))
    return np.array(list(steps))


def home_average(text, z):
    window, queue, leaked, out = filters_of(text)["window_size"]["seconds"] + 1e-9, deque(), None, []
    for i, sample in enumerate(z):
        now = i * PERIOD
        while queue and queue[0][0] + window <= now + 2e-9:
            leaked = queue.popleft()
        queue.append((now, sample))
        total, start, before = 0.0, now - window, (leaked or queue[0])[1]
        for time, value in queue:
            total += (time - start) * before
            start, before = time, value
        out.append(total / window)
    return np.array(out)


def first_order(pattern, text, z):
    rc = 1.0 / (2.0 * math.pi * number(text, pattern))
    return smoothing(PERIOD / (PERIOD + rc), z)


def second_order(text, z):
    from scipy.signal import lfilter

    ohm, cosine = math.tan(math.pi * number(text, "INS_GYRO_FILTER,") * PERIOD), 2.0 * math.cos(math.pi / 4.0)
    c, b0 = 1.0 + cosine * ohm + ohm * ohm, ohm * ohm
    return lfilter([b0, 2.0 * b0, b0], [c, 2.0 * (ohm * ohm - 1.0), 1.0 - cosine * ohm + ohm * ohm], z)


def rc(text, z):
    """dx/dt = (z - x)/(R C) between the readings, z a straight line."""
    tau, x, out = 1e-6 * number(text, "R = ") * number(text, "C = "), z[0], [z[0]]
    for before, sample in pairwise(z):
        bent = (sample - before) * tau / PERIOD
        x = sample - bent + math.exp(-PERIOD / tau) * (x - before + bent)
        out.append(x)
    return np.array(out)


RUNS = {
    "esphome-exponential": partial(esphome, None),
    "esphome-average": partial(esphome, statistics.fmean),
    "esphome-median": partial(esphome, statistics.median),
    "homeassistant-lowpass": home_lowpass,
    "homeassistant-average": home_average,
    "klipper": lambda text, z: smoothing(min(PERIOD / number(text, "smooth_time: "), 1.0), z),
    "betaflight": partial(first_order, "gyro_lpf1_static_hz = "),
    "ardupilot": partial(first_order, "ATC_RAT_RLL_FLTD,"),
    "ardupilot-2p": second_order,
    "rc": rc,
}


@pytest.mark.slow
@pytest.mark.parametrize("target", RUNS)
def test_the_recursion_of_the_source_has_the_lag_and_the_noise_that_the_text_gives(target):
    text, ramp = text_of(target), 3.0 * np.arange(400.0)
    late = float(np.mean((ramp - RUNS[target](text, ramp))[300:]) / 3.0)
    asked, rounded = 6.6, {"betaflight": 2.7, "ardupilot-2p": 1.3}.get(target, 0.5)
    assert abs(late - asked) <= rounded
    if target != "esphome-median":  # its lag and noise are measured on a recording
        assert number(text, r"lag .*\(") == pytest.approx(late, rel=2e-3)
    assert ("noise" in text) == (target not in ("esphome-median", "rc"))
    if "noise" in text:
        noise = 4.0 * np.random.default_rng(1).normal(size=40_000)
        left = 10.0 * math.log10(np.var(RUNS[target](text, noise)[300:]) / 16.0)
        assert number(text, "noise ") == pytest.approx(left, abs=0.25)


@pytest.mark.parametrize("q", [0.0, 0.04, 0.4])
def test_the_radius_replaces_1_of_1000_good_readings(q):
    one = replace(KALMAN, q=q)
    rng, numbers = np.random.default_rng(3), filters_of(text_of("homeassistant-outlier", one))
    z = np.cumsum(rng.normal(0, math.sqrt(q), 400_000)) + rng.normal(0, 2.0, 400_000)
    before = np.lib.stride_tricks.sliding_window_view(z[:-1], numbers["window_size"])
    share = np.mean(np.abs(z[numbers["window_size"] :] - np.median(before, axis=1)) > numbers["radius"])
    assert share == pytest.approx(1e-3, rel=0.25)
    wide = filters_of(text_of("homeassistant-outlier", replace(one, gate=4 * 10.83)))
    assert wide["radius"] == pytest.approx(2.0 * numbers["radius"], rel=1e-3)


def test_one_euro_has_the_lag_of_the_filter_on_the_recording():
    """The recursion of Casiez et al. with the speed from the last output, in Hz and seconds."""
    rng = np.random.default_rng(5)
    z = np.cumsum(rng.normal(0, math.sqrt(KALMAN.q), 5000)) + rng.normal(0, 2.0, 5000)
    recording = Recording(PERIOD * np.arange(5000), ("flex",), ("counts",), z[:, None], PERIOD)
    texts = export_tuning(tuned(), "one-euro", vectors=recording)
    text = texts["kalscope_one_euro.txt"]
    freq, mincutoff, beta, dcutoff = (number(text, f"{word}=") for word in ("freq", "mincutoff", "beta", "dcutoff"))

    def alpha(cutoff):
        return 1.0 / (1.0 + freq / (2.0 * math.pi * cutoff))

    def run(z):
        x, speed, out = z[0], 0.0, []
        for sample in z:
            speed += alpha(dcutoff) * ((sample - x) * freq - speed)
            x += alpha(mincutoff + beta * abs(speed)) * (sample - x)
            out.append(x)
        return np.array(out)

    rows = np.genfromtxt(texts["groundtruth.csv"].splitlines(), delimiter=",", names=True)
    np.testing.assert_allclose(rows["filtered"], run(z)[: len(rows)], atol=0.02)
    assert np.isnan(rows["gain"]).all()
    lag = steady_state(KALMAN.params).lag_samples
    assert classic.bench_of(z, denoise(z, KALMAN.params), lag).lag(run) == pytest.approx(lag, rel=0.02)


def test_a_chain_gives_its_own_filter_and_another_one_its_lag():
    assert filters_of(text_of("esphome-exponential", chained(1, Exponential(0.3))))["alpha"] == 0.3
    assert filters_of(text_of("esphome-exponential", chained(1, MovingAverage(9))))["alpha"] == 0.2
    text = text_of("one-euro", chained(1, OneEuro(0.02, 0.5, 0.05)))
    assert "freq=50.0, mincutoff=1.0, beta=0.5, dcutoff=2.5" in text
    assert len(settings_of(tuned(), Chain(1, Exponential(0.3)))) == 6
    assert settings_of(tuned(period=60.0), Chain(1, Butterworth(0.3))) == {}


@pytest.mark.parametrize(
    ("target", "one", "period", "message"),
    [
        ("one-euro", KALMAN, PERIOD, "must be tuned on a recording .got none.: add --vectors"),
        ("klipper", KALMAN, None, "sample_period of the tuning must be known for Klipper"),
        ("rc", replace(KALMAN, q=0.0), PERIOD, "must have a lag above 0 .*got a gain of 0 or 1"),
        ("rc", chained(5), PERIOD, "one alone .* .got median of 5, then Kalman"),
        ("rc", chained(1, Exponential(0.3), Notch(0.1, 0.01)), PERIOD, "one alone .* .got notch"),
        ("rc", chained(1, Median(5)), PERIOD, "by a formula .got Median"),
        ("rc", chained(1, Exponential(1.0)), PERIOD, "must have a lag above 0 by a formula .got Exponential"),
        ("ardupilot-2p", KALMAN, 60.0, "cutoff in cycles per sample must be"),
        ("betaflght", KALMAN, PERIOD, "did you mean betaflight"),
    ],
)
def test_what_cannot_be_a_setting_is_refused(target, one, period, message):
    with pytest.raises(BadSetting, match=message):
        text_of(target, one, period)


# ---- the Kalman filter of ESPHome


def esphome_kalman(sensors, z):
    """Its answers to readings, shape (n, sources): those of a row come one after the other, a row every 10 ms.

    The last of `sensors` is the Kalman filter; the others are scaled copies of its sources.
    """
    f, copies = np.float32, {one["source_id"]: one["filters"] for one in sensors[:-1]}
    sources = [
        (f(one["error"]), copies.get(one["source"].removesuffix("_scaled"))) for one in sensors[-1]["sources"]
    ]
    per_row = f(sensors[-1]["process_std_dev"]) * f(sensors[-1]["process_std_dev"]) * f(0.001) * f(10)
    x, p, answers = f(math.nan), f(math.inf), []
    for row in z:
        waited = False
        for value, (error, filters) in zip(map(f, row), sources, strict=True):
            if math.isnan(value):
                continue
            if filters:
                value = (value + f(filters[0]["offset"])) * f(filters[1]["multiply"])  # noqa: PLW2901
            r = error * error
            if math.isnan(x):
                x, p, waited = value, r, True
                continue
            p, waited = p if waited else p + per_row, True
            first, second, a, b = (x, value, p, r) if p < r else (value, x, r, p)
            x, p = first + a * (second - first) / (a + b), a - a * a / (a + b)
        if not waited and not math.isnan(x):
            p = p + per_row
        answers.append(x)
    return np.array(answers, dtype=np.float64)


PAIR = ChannelTuning("level", "cm", 0.09, (1.0, 0.25), sensors=("sonar", "float"))
SCALED = ChannelTuning("tilt", "", 0.09, (1.0, 16.0, 0.01), sensors=("a", "b", "c"), offset=(0.5, -3.0, 0.0))
ESPHOME = [ChannelTuning("tiny", "V", 1e-14, 1e-12), ChannelTuning("large", "Pa", 1e8, 1e10)]
ESPHOME += [ChannelTuning("r0", "V", 2.0, 0.0), KALMAN, PAIR, replace(SCALED, gain=(1.0, -4.1, 0.01))]


@pytest.mark.parametrize("load", [yaml.safe_load, YAML(typ="safe", pure=True).load])
@pytest.mark.parametrize("one", ESPHOME, ids=[one.name for one in ESPHOME])
def test_esphome_numbers_make_its_filter_ours_within_float32(one, load):
    rng, several = np.random.default_rng(4), bool(one.sensors)
    tuning = Tuning((KALMAN,), sample_period=0.01, fusion=one) if several else tuned(one, 0.01)
    sensors = load(*export_tuning(tuning, "esphome").values())["sensor"]
    assert (sensors[-1]["platform"], sensors[-1]["type"]) == ("combination", "kalman")
    noise = np.sqrt(np.atleast_1d(one.r))
    x = np.cumsum(math.sqrt(one.q) * rng.normal(size=(300, 1)), axis=0)
    z = np.array(one.offset or 0.0) + np.array(one.gain or 1.0) * x + noise * rng.normal(size=(300, len(noise)))
    z[rng.random(z.shape) < 0.1] = z[:2] = np.nan
    ours = (fuse(z, one.params) if several else kalman_filter(z[:, 0], one.params)).x
    near = 1e-5 * np.nanmax(np.abs(ours))
    np.testing.assert_allclose(esphome_kalman(sensors, z), ours, rtol=0.0, atol=near)
