"""Fixed gains, for C and Arduino: what the filter settles to, one to three multiplications a sample.

One header in C99 that C++ compiles as well. With momentum its state is x and the step that x will make, f times the
velocity, so that f needs no multiplication of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kalscope.errors import BadSetting
from kalscope.export.float32 import MIN_NORMAL, float32_text
from kalscope.export.header_text import about, about_channel, commented, fill_template
from kalscope.export.job import ExportJob
from kalscope.export.names import comment_text, number_text
from kalscope.filtering.momentum.constants import step_constants
from kalscope.tuning.tuning import ChannelTuning

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
            _commented(about_channel(job, channel))
            + f"#define KALSCOPE_FIXED_{word.upper()} {{{', '.join(values)}}}\n"
        )
    text = fill_template(
        "c/kalscope_fixed_gains.h",
        job.marks,
        about=_commented(about(job, for_one_period=True)).rstrip(),
        first=job.identifiers[0].upper(),
        real=real,
        constants="\n".join(constants),
    )
    return {"kalscope_fixed_gains.h": text}


def _commented(lines: tuple[str, ...]) -> str:
    return f"/*\n{commented(lines, ' *')} */\n"
