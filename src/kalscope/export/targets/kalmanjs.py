"""kalmanjs: the same filter, but it calls the process noise R and the measurement noise Q.

Its gain is p·(1/s) and its variance p − k·p, so it agrees to the last digits, not in every bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kalscope.errors import BadSetting
from kalscope.export.header_text import about, about_channel, commented
from kalscope.export.names import comment_text, number_text

if TYPE_CHECKING:
    from kalscope.export.job import ExportJob
    from kalscope.tuning.tuning import ChannelTuning

SMALLEST = 1e-300
"""Smallest q + r: kalmanjs divides 1 by the variance of the innovation."""

_MODULE = """\
{about}//
// kalmanjs swaps the letters: its R is our process noise q, its Q our measurement noise r.
// It starts as a diffuse start does: the first sample sets x = z and p = r. After a NaN by itself it forgets
// everything and starts afresh; update() below predicts only, and adds a known start and the gate.
// Its last digits differ from ours (about 1e-12 of the signal), because it multiplies by 1/s.
import KalmanFilter from "kalmanjs";

export const filters = {{
{filters}}};

export function update(filter, z) {{
  if (Number.isNaN(z)) {{
    filter.cov += filter.R;
    return filter.x;
  }}
  if (Number.isNaN(filter.x) && !Number.isNaN(filter.cov)) filter.x = z;
  const v = z - filter.x;
  const s = filter.cov + filter.R + filter.Q;
  if (v * v > filter.gate * s && filter.refused < 5) {{
    filter.cov += filter.R;
    filter.refused += 1;
    return filter.x;
  }}
  filter.refused = 0;
  return filter.filter(z);
}}
"""


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_kalmanjs.mjs`.

    Raises:
        BadSetting: q + r is too small for its division.
    """
    filters = "".join(_entry(job, *pair) for pair in zip(job.identifiers, job.channels, strict=True))
    return {"kalscope_kalmanjs.mjs": _MODULE.format(about=commented(about(job), "//"), filters=filters)}


def _entry(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    if channel.q + channel.r < SMALLEST:
        raise BadSetting(
            f"q + r must be at least {SMALLEST:g} for kalmanjs, which divides by it"
            f" (got {channel.q + channel.r:g} of {comment_text(channel.name)})"
        )
    x0 = "NaN" if channel.x0 is None else number_text(channel.x0)
    p0 = "NaN" if channel.p0 is None else number_text(channel.p0)
    gate = "Infinity" if channel.gate is None else number_text(channel.gate)
    made = f"new KalmanFilter({{R: {number_text(channel.q)}, Q: {number_text(channel.r)}}})"
    state = f"{{x: {x0}, cov: {p0}, gate: {gate}, refused: 0}}"
    return commented(about_channel(job, channel), "  //") + f'  "{word}": Object.assign({made}, {state}),\n'
