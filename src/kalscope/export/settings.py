"""Settings of filters that people already run, as targets: the filter of a chain, or one of the same lag.

Each is a row of a table; its source is where its recursion is written. The lag and the noise in the first line of
the text are those of the setting as it is rounded.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from kalscope.analysis.candidates import stage_at_lag
from kalscope.common.text import decibels, duration, lag_in_full
from kalscope.errors import BadSetting
from kalscope.export.job import ExportJob, job_of
from kalscope.export.names import comment_text, number_text
from kalscope.filtering import classic
from kalscope.filtering.classic import Butterworth, Chain, Exponential, MovingAverage, OneEuro, Stage
from kalscope.filtering.steady import steady_state
from kalscope.recording import Recording
from kalscope.tuning.tuning import ChannelTuning, Tuning

Values = Callable[[Any, float, ChannelTuning], dict[str, float]]
Fit = Callable[[Any, float], Stage]


@dataclass(frozen=True)
class Setting:
    """A filter of another program, and how a classic filter is written for it."""

    title: str
    what: str
    source: str
    """Repository and file that the formula was checked against."""
    kind: type[Stage] | None
    """The classic filter that it is; None: it rejects outliers by q and r."""
    values: Values
    """The formula: the numbers of the text from the filter, the sample period (s) and the channel."""
    text: str
    head: str = ""
    fit: Fit = lambda stage, _: stage
    """The nearest filter that its numbers can express."""
    late: int = 0
    """Samples by which it lags more than that filter."""
    in_time: bool = True
    """Whether its numbers need the sample period."""
    has_noise: bool = True
    """Whether it reduces all noise of the readings."""


# From a classic filter to the numbers of a setting, and back from rounded numbers.


def _hertz(stage: Exponential, period: float) -> float:
    """Cut-off of a first-order low-pass whose share of a step is α = ω/(1 + ω), ω = 2π f T."""
    return 1.0 / (2.0 * math.pi * stage.lag * period)


def _of_constant(seconds: float, period: float) -> Exponential:
    """The first-order low-pass of a time constant, which is its lag."""
    return Exponential(1.0 / (1.0 + seconds / period))


def _whole_hertz(stage: Exponential, period: float) -> Exponential:
    hertz = min(max(round(_hertz(stage, period)), 1), 1000)  # LPF_MAX_HZ
    return _of_constant(1.0 / (2.0 * math.pi * hertz), period)


E24 = (10, 11, 12, 13, 15, 16, 18, 20, 22, 24, 27, 30, 33, 36, 39, 43, 47, 51, 56, 62, 68, 75, 82, 91)


def _parts(seconds: float) -> dict[str, float]:
    """Standard values whose product is nearest to a time constant, 1 ... 10 kΩ: what an AVR's converter takes."""
    ohms = (10_000.0, *(100.0 * value for value in reversed(E24)))
    microfarads = (base * 10.0**power for power in range(-3, 3) for base in (1.0, 2.2, 4.7))

    def miss(parts: tuple[float, float]) -> float:
        return round(abs(math.log(1e-6 * parts[0] * parts[1] / seconds)), 9)

    return dict(zip(("ohm", "microfarad"), min(product(ohms, microfarads), key=miss), strict=True))


def _radius(_stage: None, _period: float, one: ChannelTuning) -> dict[str, float]:
    """Distance from the median of the five readings before, which 1 in 1,000 good ones exceeds; or as the gate.

    Its variance is that of normal noise, and of a random walk as measured.
    """
    return {"radius": math.sqrt((one.gate or 10.83) * (1.287 * float(one.params.r) + 2.4 * one.q))}


def _constant(stage: Exponential, _period: float, one: ChannelTuning) -> dict[str, float]:
    """Also the decimals whose rounding, which is fed back, stops the output within 0.1 √r of the signal."""
    constant, r = round(1.0 / stage.alpha), float(one.params.r)
    decimals = 6 if r == 0.0 else min(max(math.ceil(math.log10(5.0 * constant / math.sqrt(r))), 0), 12)
    return {"constant": constant, "decimals": decimals}


def _window(stage: MovingAverage | classic.Median, *_: Any) -> dict[str, float]:
    return {"number": stage.window}


def _esphome(name: str, number: str, kind: type[Stage], values: Values) -> Setting:
    """A filter of ESPHome by its name and that of its number."""
    source = "esphome/esphome: esphome/components/sensor/filter.cpp"
    text = f'filters:  # of the sensor "{{name}}"\n  - {name}: {{{{ {number}: {{number}}, send_every: 1 }}}}\n'
    what = f"The {number} of ESPHome's filter {name}."
    return Setting(f"ESPHome {name}", what, source, kind, values, text, in_time=False)


def _home(
    name: str,
    what: str,
    kind: type[Stage] | None,
    values: Values,
    numbers: str,
    fit: Fit = lambda stage, _: stage,
    late: int = 0,
) -> Setting:
    """A filter of Home Assistant by its name and the lines of its numbers."""
    source = "home-assistant/core: homeassistant/components/filter/sensor.py"
    text = (
        '  - platform: filter\n    name: "{name} filtered"\n    entity_id: {entity}\n    filters:\n'
        f"      - filter: {name}\n" + "".join(f"        {line}\n" for line in numbers.split("; "))
    )
    return Setting(
        f"Home Assistant {name}", what, source, kind, values, text, "sensor:\n", fit, late, in_time=late > 0
    )


SETTINGS: dict[str, Setting] = {
    "esphome-exponential": _esphome(
        "exponential_moving_average", "alpha", Exponential, lambda stage, _period, _one: {"number": stage.alpha}
    ),
    "esphome-average": _esphome("sliding_window_moving_average", "window_size", MovingAverage, _window),
    "esphome-median": _esphome("median", "window_size", classic.Median, _window),
    "homeassistant-lowpass": _home(
        "lowpass",
        "The time constant, in readings, of Home Assistant's lowpass.",
        Exponential,
        _constant,
        "time_constant: {constant}; precision: {decimals}",
        fit=lambda stage, _: Exponential(1.0 / max(round(1.0 / stage.alpha), 2)),
    ),
    "homeassistant-average": _home(
        "time_simple_moving_average",
        "The window of Home Assistant's moving average, which ends before the newest reading.",
        MovingAverage,
        lambda stage, period, _: {"seconds": stage.window * period},
        "window_size: {{ seconds: {seconds} }}",
        fit=lambda stage, _: MovingAverage(max(stage.window - 2, 1)),
        late=1,
    ),
    "homeassistant-outlier": _home(
        "outlier",
        "The radius of Home Assistant's outlier filter, from q, r and the gate.",
        None,
        _radius,
        "window_size: 5; radius: {radius}",
    ),
    "klipper": Setting(
        "Klipper smooth_time",
        "The smooth_time of a heater in Klipper.",
        "Klipper3d/klipper: klippy/extras/heaters.py",
        Exponential,
        lambda stage, period, _: {"seconds": period / stage.alpha},
        "[extruder]  # or heater_bed, heater_generic\nsmooth_time: {seconds}\n",
    ),
    "one-euro": Setting(
        "One-euro filter",
        "mincutoff, beta and dcutoff of the one-euro filter, tuned on a recording.",
        "casiez/OneEuroFilter: OneEuroFilter.py, which takes the speed from its last output",
        OneEuro,
        lambda stage, period, _: {
            "freq": 1.0 / period,
            "mincutoff": stage.cutoff / period,
            "beta": stage.beta,
            "dcutoff": stage.speed_cutoff / period,
        },
        "OneEuroFilter(freq={freq}, mincutoff={mincutoff}, beta={beta}, dcutoff={dcutoff})\n",
    ),
    "betaflight": Setting(
        "Betaflight low-pass, first order",
        "The cut-off in Hz of a PT1 low-pass in Betaflight.",
        "betaflight/betaflight: src/main/common/filter.c, src/main/sensors/gyro_init.c",
        Exponential,
        lambda stage, period, _: {"hertz": round(_hertz(stage, period))},
        "set gyro_lpf1_type = PT1\nset gyro_lpf1_dyn_min_hz = 0\nset gyro_lpf1_static_hz = {hertz}\n",
        fit=_whole_hertz,
    ),
    "ardupilot": Setting(
        "ArduPilot low-pass, first order",
        "The cut-off in Hz of a first-order low-pass in ArduPilot, as of its PID controllers.",
        "ArduPilot/ardupilot: libraries/Filter/LowPassFilter.cpp",
        Exponential,
        lambda stage, period, _: {"hertz": _hertz(stage, period)},
        "ATC_RAT_RLL_FLTD,{hertz}\n",
    ),
    "ardupilot-2p": Setting(
        "ArduPilot low-pass, second order",
        "The cut-off in Hz of a second-order low-pass in ArduPilot, as of its gyroscopes.",
        "ArduPilot/ardupilot: libraries/Filter/LowPassFilter2p.cpp",
        Butterworth,
        lambda stage, period, _: {"hertz": round(stage.cutoff / period)},
        "INS_GYRO_FILTER,{hertz}\n",
        fit=lambda stage, period: Butterworth(max(round(stage.cutoff / period), 1) * period),
    ),
    "rc": Setting(
        "RC low-pass",
        "Standard values of an RC low-pass before the converter; it leaves the converter's noise.",
        "dx/dt = (z - x)/(R C), whose lag on a ramp is R C",
        Exponential,
        lambda stage, period, _: _parts(stage.lag * period),
        "R = {ohm} ohm\nC = {microfarad} uF\n",
        fit=lambda stage, period: _of_constant(1e-6 * math.prod(_parts(stage.lag * period).values()), period),
        has_noise=False,
    ),
}
"""The settings, by the names of their targets."""


def matched(tuning: Tuning, row: Setting, recording: Recording | None = None) -> Tuning:
    """The tuning with the row's filter in each channel: that of its chain, or one of the lag of its filter.

    Raises:
        BadSetting: The tuning fuses sensors, or does not know its sample period where that is needed; a channel has
            no lag that a formula gives; a one-euro filter has no recording to be tuned on.
    """
    if tuning.fusion is not None:
        raise BadSetting("settings must be for the filter of a channel (got fused sensors): choose a channel")
    if row.in_time and tuning.sample_period is None:
        raise BadSetting(f"sample_period of the tuning must be known for {row.title} (got none)")
    return replace(tuning, channels=tuple(_matched(one, row, tuning, recording) for one in tuning.channels))


def _matched(one: ChannelTuning, row: Setting, tuning: Tuning, recording: Recording | None) -> ChannelTuning:
    chain, name = one.chain, comment_text(one.name)
    if chain is not None and (chain.first or row.kind is None):
        raise BadSetting(f"the filter of {name} must be one alone for {row.title} (got {chain.words})")
    if row.kind is None:
        return one
    stage = None if chain is None else chain.then
    lag = steady_state(one.params.moving).lag_samples if stage is None else stage.lag
    if stage is None or type(stage) is not row.kind or lag == 0.0:
        if lag is None or not 0.0 < lag < math.inf:
            got = "a gain of 0 or 1" if stage is None else f"{stage.name}, {stage.words}"
            raise BadSetting(f"the filter of {name} must have a lag above 0 by a formula (got {got})")
        stage = stage_at_lag(row.kind, float(lag), _bench(one, row, float(lag), recording))
    return replace(one, fast=None, spikes=0.0, chain=Chain(1, row.fit(stage, tuning.sample_period or math.nan)))


def _bench(one: ChannelTuning, row: Setting, lag: float, recording: Recording | None) -> classic.Bench:
    if recording is not None:
        z = one.readings(recording)
        return classic.bench_of(z, one.filter.run(z).x, lag)
    if row.kind is OneEuro:
        raise BadSetting(
            f"{row.title} must be tuned on a recording (got none): add --vectors, or use it from the tab Compare"
        )
    return classic.Bench(np.zeros(1), 1.0, 2 * classic.MAX_WINDOW, lag)


def files(name: str, row: Setting, job: ExportJob) -> dict[str, str]:
    """One file with the setting of each channel."""
    texts = "".join(_text(row, job.sample_period, *named) for named in job.named_channels)
    return {f"kalscope_{name.replace('-', '_')}.txt": row.head + texts}


def settings_of(tuning: Tuning, chain: Chain) -> dict[str, str]:
    """Every setting that is the filter of a chain alone, for the only channel of a tuning, by its title."""
    (one,), texts = tuning.channels, dict[str, str]()
    filtered = replace(tuning, fusion=None, channels=(replace(one, fast=None, spikes=0.0, chain=chain),))
    for name, row in SETTINGS.items():
        if row.kind is type(chain.then):
            with suppress(BadSetting):  # such as a cut-off in whole Hz above the sample rate
                (texts[row.title],) = files(name, row, job_of(matched(filtered, row))).values()
    return texts


def _text(row: Setting, period: float | None, word: str, one: ChannelTuning) -> str:
    """What the setting does to a channel, one line, and the setting."""
    stage, words = None if one.chain is None else one.chain.then, f"{one.name}: {row.title}"
    if stage is None:
        words += ", replaces 1 of 1,000 good readings" if one.gate is None else ", at the gate of the filter"
    elif stage.lag is not None:
        words += f", lag {lag_in_full(stage.lag + row.late, period)}"
        if row.has_noise:
            words += f", noise {decibels(10.0 * math.log10(stage.noise_gain))}"
    if period is not None:
        words += f"; for a reading every {duration(period)}"
    values = {
        name: str(value) if isinstance(value, int) else number_text(float(f"{value:.4g}"))
        for name, value in row.values(stage, math.nan if period is None else period, one).items()
    }
    known = re.fullmatch(r"(sensor|binary_sensor|input_number)\.[a-z0-9_]+", one.name)
    entity = one.name if known else f"sensor.{word}"
    text = row.text.format(name=comment_text(one.name, 40), entity=entity, **values)
    return f"# {comment_text(words, 200)}\n{text}"
