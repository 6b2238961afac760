"""C99 with the tuned constants, in double, or float by a macro; and fixed gains, for C and Arduino."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from kalscope.errors import BadSetting
from kalscope.export.float32 import (
    MIN_NORMAL,
    Float32Params,
    float32_params,
    float32_text,
    float32_tuning,
    runs_kalman,
)
from kalscope.export.job import ExportJob, about, about_channel, commented, fill_template, step_of
from kalscope.export.names import comment_text, number_text
from kalscope.export.targets.stages import WHOLE, code_in_c, tuning_values
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.filtering.steady import step_constants
from kalscope.tuning.tuning import ChannelTuning

# C99 with the tuned constants, in double, or float by a macro: `kalscope_filter`, or `kalscope_fusion`.


MAX_SENSORS = 32
"""Bits of the mask that says which sensors have a reading."""


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.h` and `.c`. What float cannot hold stops the compiler where float is asked for."""
    names = job.identifiers
    code = code_in_c(job)
    header = fill_template(
        "c/kalscope_filter.h",
        job.marks,
        about=_commented(about(job)),
        first=names[0],
        types=code.types,
        declarations="\n".join(f"extern const kalscope_tuning kalscope_tuning_{name};" for name in names),
    )
    source = fill_template(
        "c/kalscope_filter.c",
        job.marks,
        about=_commented(about(job)),
        gate_limit=str(GATE_LIMIT),
        functions=code.functions,
        tunings="\n".join(_constant(job, *named) for named in job.named_channels),
    )
    return {"kalscope_filter.h": header, "kalscope_filter.c": source}


def fused_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_fusion.h` and `.c`; what float cannot hold stops the compiler as in `files`.

    Raises:
        BadSetting: More sensors than a mask has bits.
    """
    names = job.sensor_identifiers
    if len(names) > MAX_SENSORS:
        raise BadSetting(f"a fusion in C must have at most {MAX_SENSORS} sensors (got {len(names)}): fuse fewer")
    reading = "(readings[i] - tuning->offset[i]) / tuning->gain[i]"
    header = fill_template(
        "fused/kalscope_fusion.h",
        job.marks,
        about=_commented(about(job)),
        words=", ".join(names),
        name=job.identifiers[-1],
        count=str(len(names)),
    )
    source = fill_template(
        "fused/kalscope_fusion.c",
        job.marks,
        about=_commented(about(job)),
        gate_limit=str(GATE_LIMIT),
        tuning=_fusion_constant(job),
        reading=reading if job.fusion.has_gains else "readings[i] - tuning->offset[i]",
    )
    return {"kalscope_fusion.h": header, "kalscope_fusion.c": source}


def _fusion_constant(job: ExportJob) -> str:
    fusion = job.fusion
    values = _starting_values(fusion) | {name: number_text(value) for name, value in step_of(fusion).items()}
    fields = "".join(f"    .{field} = (kalscope_fusion_real){value},\n" for field, value in values.items())
    each = {"r": job.noise, "offset": fusion.offset} | ({"gain": fusion.gain} if job.fusion.has_gains else {})
    for field, numbers in each.items():
        listed = ", ".join(f"(kalscope_fusion_real){number_text(number)}" for number in numbers)
        fields += f"    .{field} = {{{listed}}},\n"
    guard = ""
    try:
        float32_params(fusion.params)
    except BadSetting:
        guard = _float_guard(job.identifiers[-1])
    said, name = _commented(about_channel(job, job.fusion)), f"kalscope_fusion_tuning_{job.identifiers[-1]}"
    return f"{said}\n{guard}const kalscope_fusion_tuning {name} = {{\n{fields}}};\n"


def _starting_values(one: ChannelTuning) -> dict[str, str]:
    return {
        "q": number_text(one.q),
        "p0": number_text(one.p0, "INFINITY"),
        "x0": number_text(one.x0, "NAN"),
        "gate": number_text(one.gate or 0.0),
    }


def _float_guard(name: str) -> str:
    return f'#ifdef KALSCOPE_FLOAT\n#error "float cannot hold the values of {name}: use double"\n#endif\n'


def _commented(lines: tuple[str, ...]) -> str:
    return f"/*\n{commented(lines, ' *')} */"


def _constant(job: ExportJob, name: str, channel: ChannelTuning) -> str:
    """The constant of one channel. A double rounded to float by the compiler is the float of `float32_params`."""
    guard = ""
    try:
        held = float32_tuning(channel)
    except BadSetting:
        held, guard = None, _float_guard(name)
    kalman = _kalman(job, channel, held) if runs_kalman(channel) else {}
    values = tuning_values(job, channel, kalman, number_text)
    fields = "".join(
        f"    .{field} = {value},\n" if field in WHOLE else f"    .{field} = (kalscope_real){value},\n"
        for field, value in values.items()
    )
    said = _commented(about_channel(job, channel))
    return f"{said}\n{guard}const kalscope_tuning kalscope_tuning_{name} = {{\n{fields}}};\n"


def _kalman(job: ExportJob, channel: ChannelTuning, held: Float32Params | None) -> dict[str, str]:
    """The numbers of a Kalman filter; `held` is what float makes of them, None where it cannot."""
    start = _starting_values(channel)
    values = {"q": start.pop("q"), "r": number_text(channel.r), **start, "settled_gain": "0.0"}
    if job.has_momentum:
        step = asdict(step_constants(channel.q, channel.momentum))
        values |= {field: number_text(value) for field, value in step.items()}
    if held is not None and held.settled_gain > 0:
        gain = float32_text(held.settled_gain)
        values["settled_gain"] = f"(sizeof(kalscope_real) == sizeof(float) ? (kalscope_real){gain} : 0)"
    return values


# Fixed gains, for C and Arduino: what the filter settles to, one to three multiplications a sample.
#
# One header in C99 that C++ compiles as well. With momentum its state is x and the step that x will make, f times
# the velocity, so that f needs no multiplication of its own.


_FLOAT = "typedef float kalscope_fixed_real;\n"
_EITHER = """\
#ifdef KALSCOPE_FLOAT
typedef float kalscope_fixed_real;
#else
typedef double kalscope_fixed_real;
#endif
"""


@dataclass(frozen=True)
class FixedGains:
    """The settled filter: ahead = x + step, v = z - ahead, x = ahead + k v, step = e step + l v."""

    k: float
    """Share of each innovation that is added to x, above 0."""
    l: float  # noqa: E741  as in the formulas and in the exported code
    """Share that is added to the step; 0 without momentum."""
    e: float
    """Share of the step that is left after a sample; 0 without momentum."""


def fixed_gains(job: ExportJob, channel: ChannelTuning) -> FixedGains:
    """The gains of one channel.

    Raises:
        BadSetting: The filter does not settle to gains, or has an outlier gate.
    """
    steady, step = job.steady(channel), step_constants(channel.q, channel.momentum)
    gain = steady.gain
    if gain < MIN_NORMAL:
        raise BadSetting(
            f"q of {comment_text(channel.name)} must be above 0 for fixed gains (got {channel.q:.6g}, whose gain"
            " falls to 0): leave that option out"
        )
    if channel.gate is not None:
        raise BadSetting(
            f"the outlier gate of {comment_text(channel.name)} must be off for fixed gains (got"
            f" {channel.gate:.6g}): switch it off, or leave that option out"
        )
    return FixedGains(gain, step.f * steady.velocity_gain, step.e)


def arduino_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_fixed_gains.h` in float32; errors as `fixed_gains`."""
    return _files(job, _FLOAT, lambda value: float32_text(np.float32(value)))


def c_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_fixed_gains.h` in double, or float by a macro; errors as `fixed_gains`."""
    return _files(job, _EITHER, lambda value: f"(kalscope_fixed_real){number_text(value)}")


def _files(job: ExportJob, real: str, written: Callable[[float], str]) -> dict[str, str]:
    constants: list[str] = []
    for word, channel in job.named_channels:
        gains = fixed_gains(job, channel)
        start = "NAN" if channel.x0 is None else written(channel.x0)
        values = [written(gains.k), start]
        if job.has_momentum:
            values[1:] = [written(gains.l), written(gains.e), start, written(0.0)]
        constants.append(
            _fixed_gains_commented(about_channel(job, channel))
            + f"#define KALSCOPE_FIXED_{word.upper()} {{{', '.join(values)}}}\n"
        )
    text = fill_template(
        "c/kalscope_fixed_gains.h",
        job.marks,
        about=_fixed_gains_commented(about(job, for_one_period=True)).rstrip(),
        first=job.identifiers[0].upper(),
        real=real,
        constants="\n".join(constants),
    )
    return {"kalscope_fixed_gains.h": text}


def _fixed_gains_commented(lines: tuple[str, ...]) -> str:
    return f"/*\n{commented(lines, ' *')} */\n"
