"""ROS 2: a parameter file, written by hand because each value's type must be unambiguous to its reader.

rcl's parser (rcl_yaml_param_parser/src/parse.c) takes `1` for an integer, on which a node that declared a
double stops; and what strtod reports as out of range, subnormal numbers too, for a text.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

from kalscope.errors import BadSetting
from kalscope.export.header_text import about, about_channel, commented, fill_template
from kalscope.export.job import ExportJob, step_of
from kalscope.export.names import comment_text, number_text, quoted
from kalscope.tuning.tuning import ChannelTuning

_CHANNEL = """\
{about}      {word}:
        name: {name}
        process_noise_q: {q}
        measurement_noise_r: {r}
{rest}"""


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_parameters.yaml`.

    Raises:
        BadSetting: A number is too small for the parser.
    """
    text = fill_template(
        "kalscope_parameters.yaml",
        about=commented(about(job), "#"),
        period=_period(job),
        names=", ".join(map(quoted, job.identifiers)),
        channels="".join(_channel(job, *named) for named in job.named_channels),
    )
    return {"kalscope_parameters.yaml": text}


def fused_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_fusion.yaml`; errors as `files`."""
    fusion = job.fusion
    values = zip(fusion.sensors, job.sensor_identifiers, fusion.r, fusion.offset, fusion.gain, strict=True)
    fused = {"name": quoted(comment_text(fusion.name)), "process_noise_q": _number(fusion.q)}
    lines = [*(f"        {name}: {value}\n" for name, value in fused.items()), *_rest(fusion)]
    text = fill_template(
        "fused/kalscope_fusion.yaml",
        about=commented((*about(job), *about_channel(job, job.fusion)), "#"),
        period=_period(job),
        fusion="".join(("      fused:\n", *lines)),
        names=", ".join(map(quoted, job.sensor_identifiers)),
        sensors="".join(
            f"      sensor_{word}:\n"
            f"        name: {quoted(comment_text(name))}\n"
            f"        measurement_noise_r: {_number(r)}\n"
            f"        offset: {_number(offset)}\n"
            f"        gain: {_number(gain)}\n"
            for name, word, r, offset, gain in values
        ),
    )
    return {"kalscope_fusion.yaml": text}


def _period(job: ExportJob) -> str:
    return "" if job.sample_period is None else f"      sample_period: {_number(job.sample_period)}\n"


def _channel(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    return _CHANNEL.format(
        about=commented(about_channel(job, channel), "      #"),
        word=f"channel_{word}",  # so that no channel's name equals a key of the level above
        name=quoted(comment_text(channel.name)),  # harmless: launch files may substitute "$(…)"
        q=_number(channel.q),
        r=_number(channel.r),
        rest="".join(_rest(channel)),
    )


def _rest(one: ChannelTuning) -> Iterator[str]:
    """A parameter cannot be null or unset: a bool says what is automatic, and the number is left out."""
    known = {
        "start_variance_known": ("start_variance_p0", one.p0),
        "start_value_known": ("start_value_x0", one.x0),
        "outlier_gate_on": ("outlier_gate", one.gate),
    }
    for switch, (name, value) in known.items():
        yield f"        {switch}: {'false' if value is None else 'true'}\n"
        if value is not None:
            yield f"        {name}: {_number(value)}\n"
    for name, value in step_of(one).items():
        yield f"        {name if name == 'momentum' else f'momentum_{name}'}: {_number(value)}\n"


def _number(value: float) -> str:
    if 0.0 < abs(value) < sys.float_info.min:
        raise BadSetting(
            f"numbers for ROS 2 must be 0 or at least {sys.float_info.min:.3g} (got {value!r}: its parser takes"
            " smaller ones for texts)"
        )
    return number_text(value)
