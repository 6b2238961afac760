"""C99 with the tuned constants, in double, or float by a macro: `kalscope_filter`, or `kalscope_fusion`.

`templates/c/stages` has a file a filter, in C99 that C++ compiles as well: its numbers in the tuning, its state,
how to start it, and what it does with a sample. An export has those that it uses.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import asdict

from kalscope.errors import BadSetting
from kalscope.export.float32 import float32_tuning, runs_kalman
from kalscope.export.job import (
    ExportJob,
    about,
    about_channel,
    commented,
    fill_sections,
    fill_template,
    start_of,
)
from kalscope.export.names import number_text
from kalscope.filtering.classic import Butterworth, Exponential, Median, MovingAverage, Notch, OneEuro, Stage
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.filtering.steady import step_constants
from kalscope.filtering.two_speeds import LASTING, NEVER, SHARE, SPIKE
from kalscope.tuning.tuning import ChannelTuning

MAX_SENSORS = 32
"""Bits of the mask that says which sensors have a reading."""

_FIELD = re.compile(r"^    (?:int|kalscope_real) +(\w+);", re.MULTILINE)


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


# The filters of an export, piece by piece, for C and C++.


_PIECES: dict[type[Stage | Notch], tuple[str, tuple[str, ...]]] = {
    MovingAverage: ("moving_average", ("window",)),
    Exponential: ("exponential", ("alpha",)),
    Median: ("median", ("window",)),
    Butterworth: ("butterworth", ("to_slope", "decay", "to_level")),
    OneEuro: ("one_euro", ("slowest", "growth", "of_speed")),
    Notch: ("notch", ("gain", "turn", "decay")),
}
"""Each filter's piece of code, and the numbers of its tuning."""


def piece_of(channel: ChannelTuning) -> str:
    """The piece of code that is the last filter of a channel."""
    stage = None if channel.chain is None else channel.chain.then
    if channel.fast is not None:
        return "two_speeds"
    return "kalman" if stage is None else _PIECES[type(stage)][0]


def numbers_of(stage: Stage | Notch) -> dict[str, int | float]:
    """What a classic filter computes with, by the names that its code has for it."""
    if isinstance(stage, MovingAverage | Median):
        return {"window": stage.window}
    return dict(zip(_PIECES[type(stage)][1], stage.constants, strict=False))


def used_pieces(job: ExportJob) -> tuple[str, ...]:
    """The pieces of code that an export needs for its last filters, in a fixed order."""
    used = set(map(piece_of, job.channels))
    order = ("kalman", "two_speeds", *dict.fromkeys(name for name, _ in _PIECES.values()))
    return tuple(name for name in order if name in used)


def code_in_c(job: ExportJob, linkage: str = "") -> dict[str, str]:
    """The filters of an export: the `types` of the tuning and the state, and the `functions` start and update.

    Args:
        job: the export.
        linkage: what precedes the two functions that a user calls: "static " in a header.
    """
    if job.fuses:
        offset = "readings[i] - tuning->offset[i]"
        reading = f"({offset}) / tuning->gain[i]" if job.fusion.has_gains else offset
        return fill_sections("c/stages/fusion.c", job.marks, linkage=linkage, reading=reading)
    used, prefix, update = used_pieces(job), "kalscope_", "static kalscope_real kalscope_kalman"
    if not job.has_kinds:
        prefix, update = "", f"{linkage}kalscope_real kalscope_update"
    first = tuple(f"first_{name}" for name in ("median", "notch") if name in job.marks)
    middle = ("middle",) if job.has_median or "median" in used else ()
    windows = {name: str(n) for name, n in windows_of(job).items()} | two_speeds_of(lambda value: f"{value:.17g}")
    parts = [
        fill_sections(f"c/stages/{name}.c", job.marks, prefix=prefix, update=update, **windows)
        for name in (*first, *middle, *used)
    ]
    types = fill_template(
        "c/types.h",
        job.marks,
        kinds=", ".join(f"KALSCOPE_{name.upper()}" for name in used),
        tuning_fields=_merged(part.get("tuning", "") for part in parts),
        state_fields=_merged(part.get("state", "") for part in parts),
    )
    functions = fill_template(
        "c/functions.c",
        job.marks,
        linkage=linkage,
        starts=_merged(part.get("start", "") for part in parts),
        updates="".join(part.get("update", "") for part in parts).removesuffix("\n"),
        before="".join(part.get("before", "") for part in parts),
        cases="".join(f"    case KALSCOPE_{name.upper()}: return kalscope_{name}(filter, z);\n" for name in used),
    )
    return {"types": types, "functions": functions}


def two_speeds_of(number: Callable[[float], str]) -> dict[str, str]:
    """The constants of every filter with two speeds, as texts."""
    constants = {"share": SHARE, "lasting": LASTING, "spike": SPIKE, "never": NEVER, "even": 1.0 / 3072.0}
    return {name: number(value) for name, value in constants.items()}


def windows_of(job: ExportJob) -> dict[str, int]:
    """How many samples each buffer of a channel holds: the longest window that any channel needs."""
    chains = [channel.chain for channel in job.channels if channel.chain is not None]
    last = [chain.then for chain in chains if isinstance(chain.then, MovingAverage | Median)]
    return {
        "first_window": max((chain.median for chain in chains), default=1),
        "window": max((stage.window for stage in last), default=1),
        "ordered": max((stage.window for stage in last if isinstance(stage, Median)), default=1),
    }


def _merged(pieces: Iterable[str]) -> str:
    """The lines of all pieces, each line once."""
    return "".join(dict.fromkeys(line for piece in pieces for line in piece.splitlines(keepends=True)))


def tuning_values(job: ExportJob, one: ChannelTuning, number: Callable[[float], str]) -> dict[str, str]:
    """The fields of the tuning of one filter in their order as texts; "0" where a filter beside it has this field.

    Args:
        job: the export.
        one: a channel of it, or the fusion.
        number: how the language writes a number that is not whole.
    """
    values = _kalman_values(job, one, number) if runs_kalman(one) else {"x0": number(math.nan)}
    if not job.has_kinds:
        return values
    chain = one.chain
    median, last, notch = (1, None, None) if chain is None else (chain.median, chain.then, chain.notch)
    values |= {"filter": f"KALSCOPE_{piece_of(one).upper()}", "median": str(median)}
    if notch is not None:
        values |= {f"notch_{name}": number(value) for name, value in numbers_of(notch).items()}
    if last is not None:
        values |= {name: str(n) if isinstance(n, int) else number(n) for name, n in numbers_of(last).items()}
    fields = code_in_c(job)["types"].partition("} kalscope_tuning;")[0]
    return {field: values.get(field, "0") for field in _FIELD.findall(fields)}


def _kalman_values(job: ExportJob, one: ChannelTuning, number: Callable[[float], str]) -> dict[str, str]:
    unset = {"p0": math.inf, "x0": math.nan, "gate": 0.0}
    values = {name: number(unset[name] if value is None else value) for name, value in start_of(one).items()}
    if job.has_momentum:
        values |= {name: number(value) for name, value in asdict(step_constants(one.q, one.momentum)).items()}
    for name, each in job.sensor_values.items() if one.sensors else ():
        if name != "gain" or one.has_gains:
            values[name] = f"{{{', '.join(map(number, each))}}}"
    return values
