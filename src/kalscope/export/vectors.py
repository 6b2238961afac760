"""Test vectors: what the exported filter must answer on the user's own samples."""

from __future__ import annotations

import numpy as np

from kalscope.errors import BadSetting
from kalscope.export.job import ExportJob
from kalscope.filtering.batch import kalman_filter
from kalscope.recording import Recording
from kalscope.tuning.tuning import ChannelTuning

DEFAULT_ROWS = 1000
"""Rows of a vector file: the start, and some thousand lines are no more proof than these."""

HEADER = "time,raw,filtered,gain"


def vector_files(job: ExportJob, recording: Recording, rows: int = DEFAULT_ROWS) -> dict[str, str]:
    """`groundtruth.csv`, or `groundtruth_IDENTIFIER.csv` for each of several channels.

    The first rows of the recording through the filter without time (dt = None), as a device runs it; float64
    digits that read back bit for bit; a missing sample is `nan`, and so is x before the first sample. With momentum
    a last column has the filtered velocity, unit per sample.

    Args:
        job: The filters.
        recording: Has a channel of each name; where both have only one, the names may differ.
        rows: Most rows, ≥ 1.

    Raises:
        BadSetting: The recording has no such channel or no rows.
    """
    if rows < 1 or not len(recording):
        raise BadSetting(f"test vectors must have at least one row (got {min(rows, len(recording))})")
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
    result = kalman_filter(z, channel.params)
    columns = [recording.time[:rows], z, result.x, result.k]
    header = HEADER
    if result.velocity is not None:
        columns.append(result.velocity)
        header += ",velocity"
    lines = (",".join(map(repr, row)) for row in zip(*(c.tolist() for c in columns), strict=True))
    return "\n".join((header, *lines, ""))
