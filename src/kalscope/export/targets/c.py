"""C99 with the tuned constants, in double, or float by a macro: `kalscope_filter`, or `kalscope_fusion`."""

from __future__ import annotations

from dataclasses import asdict

from kalscope.errors import BadSetting
from kalscope.export.float32 import Float32Params, float32_text, float32_tuning, runs_kalman
from kalscope.export.job import ExportJob, about, about_channel, commented, fill_template, start_of
from kalscope.export.names import number_text
from kalscope.export.targets.stages import WHOLE, code_in_c, tuning_values
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.filtering.steady import step_constants
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
    code = code_in_c(job)
    texts = {
        "about": _commented(about(job)),
        "first": names[0],
        "name": names[-1],
        "words": ", ".join(job.sensor_identifiers),
        "count": str(count),
        "reading": job.reading("tuning->"),
        "gate_limit": str(GATE_LIMIT),
        "types": code.types,
        "functions": code.functions,
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
    held, guard = None, ""
    try:
        held = float32_tuning(one)
    except BadSetting:
        guard = f'#ifdef KALSCOPE_FLOAT\n#error "float cannot hold the values of {name}: use double"\n#endif\n'
    kalman = _kalman(job, one, held) if runs_kalman(one) else {}
    values = {
        field: value if field in WHOLE else f"({real}){value}"
        for field, value in tuning_values(job, one, kalman, number_text).items()
    }
    for field, each in job.sensor_values.items() if job.fuses else ():
        if field != "gain" or one.has_gains:
            values[field] = f"{{{', '.join(f'({real}){number_text(value)}' for value in each)}}}"
    fields = "".join(f"    .{field} = {value},\n" for field, value in values.items())
    said = _commented(about_channel(job, one))
    return f"{said}\n{guard}const kalscope_{kind} kalscope_{kind}_{name} = {{\n{fields}}};\n"


def _kalman(job: ExportJob, one: ChannelTuning, held: Float32Params | None) -> dict[str, str]:
    """The numbers of a Kalman filter; `held` is what float makes of them, None where it cannot."""
    unset = {"p0": "INFINITY", "x0": "NAN", "gate": "0.0"}
    values = {name: number_text(value, unset.get(name, "")) for name, value in start_of(one).items()}
    if not one.sensors:
        values["settled_gain"] = "0.0"
        if held is not None and held.settled_gain > 0:
            gain = float32_text(held.settled_gain)
            values["settled_gain"] = f"(sizeof(kalscope_real) == sizeof(float) ? (kalscope_real){gain} : 0)"
    if job.has_momentum:
        step = asdict(step_constants(one.q, one.momentum))
        values |= {field: number_text(value) for field, value in step.items()}
    return values
