"""C99 with the tuned constants, in double, or float by a macro: `kalscope_filter`, or `kalscope_fusion`."""

from __future__ import annotations

import math

from kalscope.errors import BadSetting
from kalscope.export.float32 import float32_tuning
from kalscope.export.job import ExportJob, about, about_channel, commented, fill_template
from kalscope.export.names import number_text
from kalscope.export.targets.stages import code_in_c, tuning_values
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.tuning.tuning import ChannelTuning

MAX_SENSORS = 32
"""Bits of the mask that says which sensors have a reading."""


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.h` and `.c`, or `kalscope_fusion.h` and `.c`.

    What float cannot hold stops the compiler where float is asked for.

    Raises:
        BadSetting: More sensors than a mask has bits.
    """
    names, count = job.identifiers, len(job.fusion.sensors)
    if count > MAX_SENSORS:
        raise BadSetting(f"a fusion in C must have at most {MAX_SENSORS} sensors (got {count}): fuse fewer")
    texts = {
        "about": _commented(about(job)),
        "first": names[0],
        "name": names[-1],
        "words": ", ".join(job.sensor_identifiers),
        "count": str(count),
        "gate_limit": str(GATE_LIMIT),
        **code_in_c(job),
        "declarations": "\n".join(f"extern const kalscope_tuning kalscope_tuning_{name};" for name in names),
        "tunings": "\n".join(_constant(job, *named) for named in job.named_channels),
    }
    name = "kalscope_fusion" if job.fuses else "kalscope_filter"
    return {f"{name}.{ending}": fill_template(f"c/{name}.{ending}", job.marks, **texts) for ending in ("h", "c")}


def _commented(lines: tuple[str, ...]) -> str:
    return f"/*\n{commented(lines, ' *')} */"


def _constant(job: ExportJob, name: str, one: ChannelTuning) -> str:
    """The constant of one filter. A double rounded to float by the compiler is the float of `float32_params`."""
    kind, real = ("fusion_tuning", "kalscope_fusion_real") if job.fuses else ("tuning", "kalscope_real")
    guard = ""
    try:
        float32_tuning(one)
    except BadSetting:
        guard = f'#ifdef KALSCOPE_FLOAT\n#error "float cannot hold the values of {name}: use double"\n#endif\n'

    def number(value: float) -> str:
        word = "NAN" if math.isnan(value) else "INFINITY" if math.isinf(value) else number_text(value)
        return f"({real}){word}"

    values = tuning_values(job, one, number)
    fields = "".join(f"    .{field} = {value},\n" for field, value in values.items() if value != "0")
    head = _commented(about_channel(job, one))
    return f"{head}\n{guard}const kalscope_{kind} kalscope_{kind}_{name} = {{\n{fields}}};\n"
