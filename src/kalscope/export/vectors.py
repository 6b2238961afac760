"""Test vectors: what the exported filter must output for the user's own samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kalscope.errors import BadSetting
from kalscope.export.job import ExportJob
from kalscope.recording import Recording
from kalscope.tuning.tuning import ChannelTuning

DEFAULT_ROWS = 1000
"""Rows of a vector file: the start is among them, and more rows would prove no more."""

HEADER = "time,raw,filtered,gain"


def vector_files(job: ExportJob, recording: Recording, rows: int = DEFAULT_ROWS) -> dict[str, str]:
    """`groundtruth.csv`, or `groundtruth_IDENTIFIER.csv` for each of several channels.

    The first rows of the recording through the filter without time (dt = None), as a device runs it; float64
    digits that read back bit for bit; a missing sample is `nan`, and so are x before the first sample and the gain
    of a classic filter. With momentum a last column has the filtered velocity, unit per sample. A fusion has a
    column for each sensor, then the fused value and its variance.

    Args:
        job: The filters, or a fusion.
        recording: Has a channel of each name; where both have only one, the names may differ.
        rows: Most rows, ≥ 1.

    Raises:
        BadSetting: The recording has no such channel or no rows.
    """
    if rows < 1 or not len(recording):
        raise BadSetting(f"test vectors must have at least one row (got {min(rows, len(recording))})")
    if job.fuses:
        header = ",".join(("time", *job.sensor_identifiers, "filtered", "variance"))
        return {"groundtruth.csv": _text(job.fusion, recording, header, rows)}
    if len(job.channels) == 1:
        (channel,) = job.channels
        name = recording.names[0] if len(recording.names) == 1 else channel.name
        return {"groundtruth.csv": _text(replace(channel, name=name), recording, HEADER, rows)}
    return {
        f"groundtruth_{word}.csv": _text(channel, recording, HEADER, rows) for word, channel in job.named_channels
    }


def _text(one: ChannelTuning, recording: Recording, header: str, rows: int) -> str:
    z = np.ascontiguousarray(one.readings(recording)[:rows])
    result = one.filter.run(z)
    columns = [recording.time[:rows], *np.atleast_2d(z.T), result.x, result.p if one.sensors else result.k]
    if result.velocity is not None:
        header, columns = f"{header},velocity", [*columns, result.velocity]
    lines = (",".join(map(repr, row)) for row in zip(*(c.tolist() for c in columns), strict=True))
    return "\n".join((header, *lines, ""))
