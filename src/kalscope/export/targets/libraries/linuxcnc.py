"""LinuxCNC: the realtime component filter_kalman, whose manual page swaps its two variances.

Its code adds Qk to the variance before each sample, and Rk to that of the innovation, in double: Qk = q, Rk = r.
"""

from __future__ import annotations

from kalscope.export.header_text import about, about_channel, commented, fill_template
from kalscope.export.job import ExportJob
from kalscope.export.names import number_text
from kalscope.tuning.tuning import ChannelTuning


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_linuxcnc.hal`, which the INI file names by `HALFILE`."""
    text = fill_template(
        "libraries/kalscope_linuxcnc.hal",
        about=commented(about(job), "#"),
        names=",".join(job.identifiers),
        first=job.identifiers[0],
        filters="\n".join(_filter(job, *named) for named in job.named_channels),
    )
    return {"kalscope_linuxcnc.hal": text}


def _filter(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    return (
        commented(about_channel(job, channel), "#")
        + f"addf {word} servo-thread\n"
        + f"setp {word}.Qk {number_text(channel.q)}\n"
        + f"setp {word}.Rk {number_text(channel.r)}\n"
    )
