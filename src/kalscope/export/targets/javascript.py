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


def _entry(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    values = {name: getattr(channel, name) for name in ("q", "r", "p0", "x0", "gate")} | step_of(channel)
    given = ", ".join(f"{name}: {number_text(value)}" for name, value in values.items() if value is not None)
    return commented(about_channel(job, channel), "  //") + f"  {word}: new KalmanFilter({{ {given} }}),\n"
