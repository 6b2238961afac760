"""MATLAB and Octave: one script a channel, or of a fusion, in the style of Ma'arif et al. (2019)."""

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
        job.marks,
        about=commented((*about(job), *about_channel(job, channel)), "%"),
        r=number_text(channel.r),
        **_values(channel),
    )


def fused_files(job: ExportJob) -> dict[str, str]:
    """`kalman_fusion_IDENTIFIER.m`."""
    each = {"r": job.noise, "offset": job.fusion.offset, "gain": job.fusion.gain}
    text = fill_template(
        "fused/kalman_fusion.m",
        job.marks,
        about=commented((*about(job), *about_channel(job, job.fusion)), "%"),
        **{name: ", ".join(map(number_text, numbers)) for name, numbers in each.items()},
        **_values(job.fusion),
    )
    return {f"kalman_fusion_{job.identifiers[-1]}.m": text}


def _values(one: ChannelTuning) -> dict[str, str]:
    return {
        "q": number_text(one.q),
        "p0": number_text(one.p0, "Inf"),
        "x0": number_text(one.x0, "NaN"),
        "gate": number_text(one.gate, "Inf"),
        **{name: number_text(value) for name, value in step_of(one).items()},
    }
