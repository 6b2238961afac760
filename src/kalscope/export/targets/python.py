"""Python: a small class that needs nothing but the language, and the call of Kalscope in a second file."""

from __future__ import annotations

from kalscope.export.header_text import about, about_channel, commented, fill_template
from kalscope.export.job import ExportJob
from kalscope.export.names import number_text
from kalscope.tuning.tuning import ChannelTuning


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.py` and `with_kalscope.py`.

    A hostile name could form an encoding line: the first two lines, where Python looks for one, are constant.
    """
    head = commented(about(job), "#")
    return {
        name: fill_template(f"{name}.txt", about=head, filters=_entries(job, maker))
        for name, maker in (("kalscope_filter.py", "KalmanFilter"), ("with_kalscope.py", "kalscope.FilterParams"))
    }


def _entries(job: ExportJob, maker: str) -> str:
    return "".join(
        commented(about_channel(job, channel), "    #") + f'    "{word}": {maker}({_arguments(channel)}),\n'
        for word, channel in job.named_channels
    )


def _arguments(channel: ChannelTuning) -> str:
    """The numbers that the tuning gives; a start or a gate that is left out is the automatic one in both."""
    names = ("q", "r", "p0", "x0", "gate")
    values = ((name, getattr(channel, name)) for name in names)
    return ", ".join(f"{name}={number_text(value)}" for name, value in values if value is not None)
