"""JavaScript: an ES module with a small class that needs nothing but the language."""

from __future__ import annotations

from kalscope.export.header_text import about, about_channel, commented, fill_template
from kalscope.export.job import ExportJob, step_of
from kalscope.export.names import number_text
from kalscope.tuning.tuning import ChannelTuning


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.mjs`."""
    text = fill_template(
        "kalscope_filter.mjs",
        job.marks,
        about=commented(about(job), "//"),
        first=job.identifiers[0],
        filters="".join(_entry(job, *named) for named in job.named_channels),
    )
    return {"kalscope_filter.mjs": text}


def fused_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_fusion.mjs`."""
    single, each = job.arguments
    given = {name: number_text(value) for name, value in single.items()}
    given |= {name: f"[{', '.join(map(number_text, numbers))}]" for name, numbers in each.items()}
    text = fill_template(
        "fused/kalscope_fusion.mjs",
        job.marks,
        about=commented((*about(job), *about_channel(job, job.fusion)), "//"),
        words=", ".join(job.sensor_identifiers),
        values="".join(f"  {name}: {value},\n" for name, value in given.items()),
    )
    return {"kalscope_fusion.mjs": text}


def _entry(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    values = {name: getattr(channel, name) for name in ("q", "r", "p0", "x0", "gate")} | step_of(channel)
    given = ", ".join(f"{name}: {number_text(value)}" for name, value in values.items() if value is not None)
    return commented(about_channel(job, channel), "  //") + f"  {word}: new KalmanFilter({{ {given} }}),\n"
