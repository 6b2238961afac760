"""MATLAB and Octave: one script a channel in the style of the appendix of Ma'arif et al. (2019)."""

from __future__ import annotations

from dataclasses import replace

from kalscope.export.header_text import about, about_channel, commented, fill_template
from kalscope.export.job import ExportJob, step_of
from kalscope.export.names import number_text
from kalscope.tuning.tuning import ChannelTuning


def files(job: ExportJob) -> dict[str, str]:
    """`kalman_IDENTIFIER.m`, one a channel: the workspace of a script has one filter."""
    return {f"kalman_{word}.m": _script(job, channel) for word, channel in job.named_channels}


def _script(whole: ExportJob, channel: ChannelTuning) -> str:
    job = replace(whole, channels=(channel,))
    return fill_template(
        "kalman_channel.m",
        has_momentum=job.has_momentum,
        about=commented((*about(job), *about_channel(job, channel)), "%"),
        q=number_text(channel.q),
        r=number_text(channel.r),
        p0=number_text(channel.p0, "Inf"),
        x0=number_text(channel.x0, "NaN"),
        gate=number_text(channel.gate, "Inf"),
        **{name: number_text(value) for name, value in step_of(channel).items()},
    )
