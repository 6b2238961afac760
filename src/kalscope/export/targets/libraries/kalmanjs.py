"""kalmanjs: the same filter, but it calls the process noise R and the measurement noise Q.

Its gain is p·(1/s) and its variance p − k·p, so it agrees to the last digits, not in every bit.
"""

from __future__ import annotations

from kalscope.errors import BadSetting
from kalscope.export.header_text import about, about_channel, commented, fill_template
from kalscope.export.job import ExportJob
from kalscope.export.names import comment_text, number_text
from kalscope.tuning.tuning import ChannelTuning

MIN_INNOVATION_VARIANCE = 1e-300
"""Smallest q + r: kalmanjs divides 1 by the variance of the innovation."""


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_kalmanjs.mjs`.

    Raises:
        BadSetting: q + r is too small for its division.
    """
    filters = "".join(_entry(job, *pair) for pair in job.named_channels)
    text = fill_template("libraries/kalscope_kalmanjs.mjs", about=commented(about(job), "//"), filters=filters)
    return {"kalscope_kalmanjs.mjs": text}


def _entry(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    if channel.q + channel.r < MIN_INNOVATION_VARIANCE:
        raise BadSetting(
            f"q + r must be at least {MIN_INNOVATION_VARIANCE:g} for kalmanjs, which divides by it"
            f" (got {channel.q + channel.r:g} of {comment_text(channel.name)})"
        )
    x0 = number_text(channel.x0, "NaN")
    p0 = number_text(channel.p0, "NaN")
    gate = number_text(channel.gate, "Infinity")
    made = f"new KalmanFilter({{R: {number_text(channel.q)}, Q: {number_text(channel.r)}}})"
    state = f"{{x: {x0}, cov: {p0}, gate: {gate}, refused: 0}}"
    return commented(about_channel(job, channel), "  //") + f'  "{word}": Object.assign({made}, {state}),\n'
