"""Python: a small class that needs nothing but the language, and the call of Kalscope in a second file."""

from __future__ import annotations

from kalscope.export.header_text import about, about_channel, about_fusion, commented, fill_template
from kalscope.export.job import ExportJob, FusionJob, step_of
from kalscope.export.names import number_text
from kalscope.tuning.tuning import ChannelTuning

FILES = (("kalscope_filter.py", "KalmanFilter", True), ("with_kalscope.py", "kalscope.FilterParams", False))
"""Each file, what makes its filters, and whether that takes the constants of a momentum."""


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.py` and `with_kalscope.py`.

    A hostile name could form an encoding line: the first two lines, where Python looks for one, are constant.
    """
    head = commented(about(job), "#")
    return {
        name: fill_template(f"python/{name}.txt", job.marks, about=head, filters=_entries(job, maker, whole))
        for name, maker, whole in FILES
    }


def fused_files(job: FusionJob) -> dict[str, str]:
    """`kalscope_fusion.py` and `fusion_with_kalscope.py`, whose first two lines are constant as well."""
    single, each = job.arguments
    own = _lines(single, each)
    constants = step_of(job.fusion).keys() - {"momentum"}
    known = {name: value for name, value in single.items() if name not in constants}
    kalscope = _lines(known, {**each, "r": job.fusion.r})
    return {
        name: fill_template(
            f"fused/{name}.txt",
            job.marks,
            about=commented((*about(job), *about_fusion(job)), "#"),
            words=", ".join(job.sensor_identifiers),
            values=values,
        )
        for name, values in (("kalscope_fusion.py", own), ("fusion_with_kalscope.py", kalscope))
    }


def _lines(values: dict[str, float], each: dict[str, tuple[float, ...]]) -> str:
    """Arguments, one a line."""
    listed = {name: f"[{', '.join(map(number_text, numbers))}]" for name, numbers in each.items()}
    single = {name: number_text(value) for name, value in values.items()}
    return "".join(f"    {name}={text},\n" for name, text in (single | listed).items())


def _entries(job: ExportJob, maker: str, own_filter: bool) -> str:
    return "".join(
        commented(about_channel(job, channel), "    #")
        + f'    "{word}": {maker}({_arguments(channel, own_filter)}),\n'
        for word, channel in job.named_channels
    )


def _arguments(channel: ChannelTuning, own_filter: bool) -> str:
    """The numbers that the tuning gives; a start or a gate that is left out is the automatic one in both."""
    values = {name: getattr(channel, name) for name in ("q", "r", "p0", "x0", "gate")}
    if channel.momentum > 0.0:
        values |= step_of(channel) if own_filter else {"momentum": channel.momentum}
    return ", ".join(f"{name}={number_text(value)}" for name, value in values.items() if value is not None)
