"""ROS 2: a parameter file, written by hand because each value's type must be plain to its reader.

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
    period = "" if job.sample_period is None else f"      sample_period: {_number(job.sample_period)}\n"
    text = fill_template(
        "kalscope_parameters.yaml",
        about=commented(about(job), "#"),
        period=period,
        names=", ".join(map(quoted, job.identifiers)),
        channels="".join(_channel(job, *named) for named in job.named_channels),
    )
    return {"kalscope_parameters.yaml": text}


def _channel(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    """A parameter cannot be null or unset: a bool says what is automatic, and the number is left out."""
    known = {
        "start_variance_known": ("start_variance_p0", channel.p0),
        "start_value_known": ("start_value_x0", channel.x0),
        "outlier_gate_on": ("outlier_gate", channel.gate),
    }
    rest = "".join(
        f"        {switch}: {'false' if value is None else 'true'}\n"
        + ("" if value is None else f"        {name}: {_number(value)}\n")
        for switch, (name, value) in known.items()
    )
    return _CHANNEL.format(
        about=commented(about_channel(job, channel), "      #"),
        word=f"channel_{word}",  # no name of a channel is a word of the level above
        name=quoted(comment_text(channel.name)),  # harmless: launch files may substitute "$(…)"
        q=_number(channel.q),
        r=_number(channel.r),
        rest=rest + "".join(_momentum_lines(channel)),
    )


def _momentum_lines(channel: ChannelTuning) -> Iterator[str]:
    for name, value in step_of(channel).items():
        yield f"        {name if name == 'momentum' else f'momentum_{name}'}: {_number(value)}\n"


def _number(value: float) -> str:
    if 0.0 < abs(value) < sys.float_info.min:
        raise BadSetting(
            f"numbers for ROS 2 must be 0 or at least {sys.float_info.min:.3g} (got {value!r}: its parser takes"
            " smaller ones for texts)"
        )
    return number_text(value)
