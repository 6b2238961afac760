"""Test vectors: what the exported filter must output for the user's own samples."""

from __future__ import annotations

import numpy as np

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.export.job import ExportJob, FusionJob
from kalscope.filtering.filter import fuse
from kalscope.recording import Recording
from kalscope.tuning.tuning import ChannelTuning

DEFAULT_ROWS = 1000
"""Rows of a vector file: the start is among them, and more rows would prove no more."""

HEADER = "time,raw,filtered,gain"


def vector_files(job: ExportJob | FusionJob, recording: Recording, rows: int = DEFAULT_ROWS) -> dict[str, str]:
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
    if isinstance(job, FusionJob):
        return {"groundtruth.csv": _fused_text(job, recording, rows)}
    if len(job.channels) == 1:
        (channel,) = job.channels
        name = recording.names[0] if len(recording.names) == 1 else channel.name
        return {"groundtruth.csv": _text(channel, recording, name, rows)}
    return {
        f"groundtruth_{word}.csv": _text(channel, recording, channel.name, rows)
        for word, channel in job.named_channels
    }


def _text(channel: ChannelTuning, recording: Recording, name: str, rows: int) -> str:
    z = np.ascontiguousarray(recording.channel(name)[:rows])
    result = channel.filter.run(z)
    return _table(HEADER, [recording.time[:rows], z, result.x, result.k], result.velocity)


def _fused_text(job: FusionJob, recording: Recording, rows: int) -> str:
    z = np.column_stack([recording.channel(name)[:rows] for name in job.fusion.sensors])
    result = fuse(z, job.fusion.params)
    header = ",".join(("time", *job.sensor_identifiers, "filtered", "variance"))
    return _table(header, [recording.time[:rows], *z.T, result.x, result.p], result.velocity)


def _table(header: str, columns: list[Array], velocity: Array | None) -> str:
    if velocity is not None:
        header, columns = f"{header},velocity", [*columns, velocity]
    lines = (",".join(map(repr, row)) for row in zip(*(c.tolist() for c in columns), strict=True))
    return "\n".join((header, *lines, ""))
