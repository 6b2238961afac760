"""C99: `kalscope_filter.h` and `kalscope_filter.c`, double, or float by a macro, with the tuned constants."""

from __future__ import annotations

from dataclasses import asdict

from kalscope.errors import BadSetting
from kalscope.export.float32 import float32_params, float32_text
from kalscope.export.header_text import about, about_channel, commented, fill_template
from kalscope.export.job import ExportJob
from kalscope.export.names import number_text
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.filtering.momentum.constants import step_constants
from kalscope.tuning.tuning import ChannelTuning


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.h` and `.c`. What float cannot hold stops the compiler where float is asked for."""
    names = job.identifiers
    header = fill_template(
        "kalscope_filter.h",
        has_momentum=job.has_momentum,
        about=_commented(about(job)),
        first=names[0],
        declarations="\n".join(f"extern const kalscope_tuning kalscope_tuning_{name};" for name in names),
    )
    source = fill_template(
        "kalscope_filter.c",
        has_momentum=job.has_momentum,
        about=_commented(about(job)),
        gate_limit=str(GATE_LIMIT),
        tunings="\n".join(_constant(job, *named) for named in job.named_channels),
    )
    return {"kalscope_filter.h": header, "kalscope_filter.c": source}


def _commented(lines: tuple[str, ...]) -> str:
    return f"/*\n{commented(lines, ' *')} */"


def _constant(job: ExportJob, name: str, channel: ChannelTuning) -> str:
    """The constant of one channel. A double rounded to float by the compiler is the float of `float32_params`."""
    values = {
        "q": number_text(channel.q),
        "r": number_text(channel.r),
        "p0": number_text(channel.p0, "INFINITY"),
        "x0": number_text(channel.x0, "NAN"),
        "gate": number_text(channel.gate or 0.0),
        "settled_gain": "0.0",
    }
    if job.has_momentum:
        step = asdict(step_constants(channel.q, channel.momentum))
        values |= {field: number_text(value) for field, value in step.items()}
    guard = ""
    try:
        gain = float32_params(channel.params).settled_gain
    except BadSetting:
        guard = f'#ifdef KALSCOPE_FLOAT\n#error "float cannot hold the values of {name}: use double"\n#endif\n'
    else:
        if gain > 0:
            values["settled_gain"] = (
                f"(sizeof(kalscope_real) == sizeof(float) ? (kalscope_real){float32_text(gain)} : 0)"
            )
    fields = "".join(f"    .{field} = (kalscope_real){value},\n" for field, value in values.items())
    said = _commented(about_channel(job, channel))
    return f"{said}\n{guard}const kalscope_tuning kalscope_tuning_{name} = {{\n{fields}}};\n"
