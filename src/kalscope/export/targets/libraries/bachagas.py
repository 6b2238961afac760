"""bachagas/Kalman.h: the same five lines, so its constructor takes the numbers unchanged.

Its own code supports neither missing samples nor an automatic start nor a gate; a short function adds them.
"""

from __future__ import annotations

from kalscope.export.header_text import about, about_channel, commented, fill_template
from kalscope.export.job import ExportJob
from kalscope.export.names import number_text
from kalscope.tuning.tuning import ChannelTuning


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_bachagas.h`, C++ as the Arduino compiles it."""
    channels = "\n".join(_channel(job, *pair) for pair in job.named_channels)
    text = fill_template("libraries/kalscope_bachagas.h", about=commented(about(job), "//"), channels=channels)
    return {"kalscope_bachagas.h": text}


def _channel(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    p0 = number_text(channel.p0, "INFINITY")
    x0 = number_text(channel.x0, "NAN")
    gate = number_text(channel.gate, "INFINITY")
    init = f"kalman_init({number_text(channel.q)}, {number_text(channel.r)}, {p0}, {x0})"
    return (
        commented(about_channel(job, channel), "//")
        + f"static kalscope_channel kalscope_filter_{word} = {{{init}, {gate}, 0}};\n"
    )
