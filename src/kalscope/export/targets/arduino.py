"""Arduino: a C++ class in float32 with the tuned constants, and a sketch that uses it; also for a fusion."""

from __future__ import annotations

import math
import re
import zlib

import numpy as np

from kalscope.errors import BadSetting
from kalscope.estimation.noise import SPIKE
from kalscope.estimation.still import GROUPS, MAX_DRIFT, MIN_SAMPLES, SURE
from kalscope.export.board import LAST_POWER
from kalscope.export.float32 import float32_text, float32_tuning, to_float32
from kalscope.export.job import ExportJob, about, about_channel, commented, fill_template
from kalscope.export.names import comment_text
from kalscope.export.targets.c import code_in_c, tuning_values
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.tuning.tuning import ChannelTuning

ANALOGUE_PINS = 6
"""Of an Uno: A0 … A5."""

DEFAULT_PERIOD_US = 5000
"""Where the tuning has no sample period: 200 samples a second."""

MAX_PERIOD_US = 2_000_000_000
"""Half the time in which micros() wraps around."""

COUNTS = frozenset(("count", "counts", "lsb", "lsbs", "adc", "adu", "digit", "digits", "raw"))
"""Units of what analogRead() returns."""

UNIT_CHECK = """\
#ifndef KALSCOPE_UNITS_DONE
#error "analogRead() returns counts, not the unit above: change readSensor(), then delete these three lines"
#endif
"""
"""Stops the compiler until the sketch reads what its filter was tuned for; constant, without names from outside."""


def files(job: ExportJob, *, calibration: bool = False, minimal: bool = False) -> dict[str, str]:
    """`KalscopeFilter.h` and `kalscope_filter.ino`, or `KalscopeFusion.h` and `kalscope_fusion.ino`.

    Args:
        job: The filters, or a fusion.
        calibration: With a sketch that measures r itself, and `KalscopeCalibration.h`; not for a fusion.
        minimal: With a sketch that only reads, filters and prints; not for a fusion.

    Raises:
        BadSetting: float32 cannot hold a value, an Uno does not have enough analogue pins, or the period is out of
            the range that it can count; r of a channel is 0, so that calibration has no ratio of q to it.
    """
    count, what = (len(job.fusion.sensors), "sensors") if job.fuses else (len(job.channels), "channels")
    if count > ANALOGUE_PINS:
        raise BadSetting(f"the sketch must read 1 to {ANALOGUE_PINS} {what} (got {count}): take fewer, or export c")
    name = "Fusion" if job.fuses else "Filter"
    sketch = _sketch(job, calibration=calibration, minimal=minimal)
    return {
        f"Kalscope{name}.h": _header(job),
        f"kalscope_{name.lower()}.ino": sketch,
        **({"KalscopeCalibration.h": _calibration(job)} if calibration else {}),
    }


def _calibration(job: ExportJob) -> str:
    values = [
        f"const KalscopeTuning  = {{{', '.join(_fields(job, channel).values())}}};" for channel in job.channels
    ]
    stamp = zlib.crc32(repr((job.identifiers, values, _period(job)[0])).encode()) & 0x7FFFFFFF
    return fill_template(
        "arduino/KalscopeCalibration.h", ratios=_ratios(job), stamp=f"0x{stamp:08X}UL", **_limits_of_stillness()
    )


def _limits_of_stillness() -> dict[str, str]:
    """Those of `find_still_stretch`, for the means and variances of as many groups."""
    sizes = {
        "spike": SPIKE,
        "wander_sure": GROUPS - 2 + SURE * math.sqrt(2.0 * (GROUPS - 2)) + 3.0,
        "drift_squared": MAX_DRIFT**2,
        "uneven_sure": GROUPS * (2.0 * SURE) ** 2,
        "sure_squared": SURE**2,
    }
    texts = {name: float32_text(np.float32(size)) for name, size in sizes.items()}
    return {"groups": str(GROUPS), "min_readings": str(MIN_SAMPLES), **texts}


def _fields(job: ExportJob, one: ChannelTuning) -> dict[str, str]:
    try:
        float32_tuning(one)
    except BadSetting as error:
        raise BadSetting(f"{comment_text(one.name)}: {error}") from None
    return tuning_values(job, one, lambda value: float32_text(np.float32(value)))


def _ratios(job: ExportJob) -> str:
    """A constant for each channel: q over r, which is the lag that was chosen."""
    lines: list[str] = []
    for name, channel in job.named_channels:
        if channel.chain is not None:
            raise BadSetting(
                f"{comment_text(channel.name)} must have the Kalman filter alone for a sketch that measures r (got"
                f" {channel.chain.words}): choose another filter, or leave that option out"
            )
        if channel.r == 0.0:
            raise BadSetting(
                f"r of {comment_text(channel.name)} must be above 0 for a sketch that measures it (got 0: the"
                " lag, which follows from q/r, is not known): tune r, or leave that option out"
            )
        ratio = float32_text(to_float32("q / r", channel.q / channel.r))
        lines.append(f"const float {_ratio_name(name)} = {ratio};\n")
    return "".join(lines)


def _ratio_name(name: str) -> str:
    return f"KALSCOPE_RATIO_{name.upper()}"


def _constant_name(job: ExportJob, word: str) -> str:
    return f"KALSCOPE_{'FUSION' if job.fuses else 'TUNING'}_{word.upper()}"


def _header(job: ExportJob) -> str:
    kind = "KalscopeFusionTuning" if job.fuses else "KalscopeTuning"
    parts: list[str] = []
    for word, one in job.named_channels:
        fields = "".join(f"  {value},  // {name}\n" for name, value in _fields(job, one).items())
        constant = f"const {kind} {_constant_name(job, word)} = {{\n{fields}}};\n"
        parts.append(f"{commented(about_channel(job, one), '//')}{constant}")
    count = len(job.fusion.sensors)
    momentum = fill_template("arduino/set_momentum.h", last_power=str(LAST_POWER)) if job.has_momentum else ""
    return fill_template(
        f"arduino/Kalscope{'Fusion' if job.fuses else 'Filter'}.h",
        job.marks,
        about=commented(about(job), "//").rstrip(),
        first=_constant_name(job, job.named_channels[0][0]),
        tunings="\n".join(parts),
        gate_limit=str(GATE_LIMIT),
        set_momentum=momentum,
        **code_in_c(job, "static "),
        words=", ".join(job.sensor_identifiers),
        all_bits="1" * (count - 1) + "0",
        count=str(count),
    )


def _sketch(job: ExportJob, *, calibration: bool = False, minimal: bool = False) -> str:
    marks = job.marks.union(["calibration"] if calibration else [])
    names, foreign = job.identifiers, any(map(is_not_in_counts, job.channels))
    read = job.sensor_identifiers if job.fuses else names
    columns, units = "raw,filtered", ", ".join(f"{name} in {_unit(one.unit)}" for name, one in job.named_channels)
    if job.fuses:
        columns, units = ",".join(names), f"{', '.join(read)}, for a fused value in {_unit(job.fusion.unit)}"
    elif len(names) > 1:
        columns = ",".join(f"{name},{name}_filtered" for name in names)
    pins = [f"A{i}" for i in range(len(read))]
    period_us, period_words = _period(job)
    letters = f"qr{'t' * job.has_momentum}p{'c' * calibration}"
    constants = [_constant_name(job, word) for word, _ in job.named_channels]
    ratio_names = ", ".join(map(_ratio_name, names))
    return fill_template(
        "arduino/minimal.ino" if minimal else f"arduino/kalscope_{'fusion' if job.fuses else 'filter'}.ino",
        marks,
        about=commented(about(job), "//").rstrip(),
        pin_words=" ".join(pins),
        columns=columns,
        period_us=str(period_us),
        period_words=period_words,
        pins=", ".join(pins),
        print_float=fill_template("arduino/print_float.ino"),
        commands=fill_template(
            f"arduino/{'commands' if job.has_kalman else 'no_commands'}.ino",
            marks,
            letters=letters,
            more="c SECONDS, k, f, " if calibration else "",
        ),
        calibrate=fill_template("arduino/calibrate.ino", marks, ratio_names=ratio_names) if calibration else "",
        readings="0, -INFINITY, INFINITY" if foreign else "1, 0, 1023",
        names=", ".join(f'"{name}"' for name in names),
        first=constants[0],
        filters=", ".join(f"KalscopeFilter({name})" for name in constants),
        units=units,
        unit_check=UNIT_CHECK if foreign else "",
    )


def is_not_in_counts(channel: ChannelTuning) -> bool:
    """Whether its unit is one such as g or V, which analogRead() does not return; an unknown unit may be counts."""
    return channel.unit != "" and COUNTS.isdisjoint(re.findall(r"[^\W\d_]+", channel.unit.lower()))


def _unit(unit: str) -> str:
    return comment_text(unit, 20) or "its own unit"


def _period(job: ExportJob) -> tuple[int, str]:
    """Microseconds between samples, and a remark on them."""
    if job.sample_period is None:
        return DEFAULT_PERIOD_US, " a guess: the tuning has no sample period"
    period_us = round(job.sample_period * 1e6)
    if not 1 <= period_us <= MAX_PERIOD_US:
        raise BadSetting(f"the sample period must be 1e-6 to 2000 s for a board (got {job.sample_period:.6g} s)")
    return period_us, " the period that q belongs to"
