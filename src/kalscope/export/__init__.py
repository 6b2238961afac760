"""Export: a tuning becomes the files of a target, the same filter everywhere. One module a target.

Each module has `files(job) -> dict of file name -> text`; names are constants or identifiers, texts ASCII.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

from kalscope.errors import BadSetting
from kalscope.export.job import ExportJob, job_of
from kalscope.tuning import Tuning

if TYPE_CHECKING:
    from kalscope.recording import Recording


@dataclass(frozen=True)
class Target:
    """One entry of the registry."""

    module: str
    """Module of this package that writes it."""
    what: str
    """What it is, one sentence for a person."""


TARGETS = MappingProxyType(
    {
        "arduino": Target("arduino", "A C++ header without allocation (float32) and a sketch that uses it."),
        "c": Target("c", "The filter in C99, double or float by a macro."),
        "python": Target("python", "A small Python class without dependencies, and the call of Kalscope."),
        "matlab": Target("matlab", "A script for MATLAB and Octave in the style of the first paper."),
        "json": Target("json_file", "The parameters as JSON."),
        "ros2": Target("ros2", "A ROS 2 parameter file (YAML)."),
        "platformio": Target("platformio", "Compiler flags for PlatformIO, in a file that extra_configs pulls in."),
        "esphome": Target("esphome", "A kalman_combinator sensor of ESPHome: standard deviations, per second."),
        "bachagas": Target("bachagas", "The constructor of bachagas/Kalman.h, which has the same formula."),
        "kalmanjs": Target("kalmanjs", "The constructor of kalmanjs: the same filter with the letters swapped."),
        "simplekalmanfilter": Target("simplekalmanfilter", "Refused: SimpleKalmanFilter is another filter."),
        "gyverfilters": Target("gyverfilters", "Refused: GKalman of GyverFilters is another filter."),
    }
)
"""What can be asked for, by name."""


def export_tuning(
    tuning: Tuning, target: str, *, channel: str | None = None, vectors: Recording | None = None
) -> dict[str, str]:
    """The files of one target.

    Args:
        tuning: What was found.
        target: A name of `kalscope.export.TARGETS`.
        channel: Export this channel only; None = all.
        vectors: The recording whose first samples, filtered, come along as `groundtruth.csv`; None = none.

    Returns:
        The texts by file name. A name is one plain word without a folder; a text is ASCII.

    Raises:
        BadSetting: No such target or channel; the target cannot hold this filter (the message says what can);
            the recording lacks a channel.
    """
    if target not in TARGETS:
        raise BadSetting(f"target must be one of {', '.join(TARGETS)} (got {target!r})")
    job = job_of(tuning, channel)
    files: dict[str, str] = import_module(f"kalscope.export.{TARGETS[target].module}").files(job)
    if vectors is not None:
        from kalscope.export.vectors import vector_files

        files |= vector_files(job, vectors)
    return files


__all__ = ["TARGETS", "ExportJob", "Target", "export_tuning", "job_of"]
