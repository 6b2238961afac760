"""Export: a tuning becomes the files of a target, the same filter everywhere. One module a target.

Each module has `files(job) -> dict of file name -> text`; names are constants or identifiers, texts ASCII.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from kalscope.errors import BadSetting
from kalscope.export.job import ExportJob, job_of
from kalscope.export.names import comment_text
from kalscope.export.targets import arduino, c, fixed_gains, javascript, json_file, matlab, platformio, python, ros2
from kalscope.export.targets.libraries import bachagas, esphome, kalmanjs, linuxcnc
from kalscope.export.targets.libraries.nearest import refusal_of_chain, refusal_of_fusion, refusal_of_momentum
from kalscope.export.targets.libraries.refused import GYVER_FILTERS, SIMPLE_KALMAN_FILTER
from kalscope.recording import Recording
from kalscope.tuning.device_period import rescaled_to_period
from kalscope.tuning.tuning import Tuning

Precision = Literal["float64", "float32", "float32, gain kept"]


@dataclass(frozen=True)
class Target:
    """One entry of the registry."""

    files: Callable[[ExportJob], dict[str, str]]
    """Writes it: the texts by file name."""
    title: str
    """Its name on screen, a few words."""
    what: str
    """What it is, one sentence."""
    fixed_gains: Callable[[ExportJob], dict[str, str]] | None = None
    """Writes the settled filter instead; None = the target has no such option."""
    calibration: Callable[[ExportJob], dict[str, str]] | None = None
    """Writes the filter and what measures r on the device; None = the target has no such option."""
    fused: Callable[[ExportJob], dict[str, str]] | None = None
    """Writes the filter that fuses several sensors; None = the target takes one reading per sample."""
    chains: bool = False
    """Whether it can hold a chain or a classic filter in place of the Kalman filter."""
    momentum: bool = True
    """Whether it can hold a filter with momentum."""
    precision: Precision = "float64"
    """How it computes, at least on an AVR board. "float32, gain kept": where float32 cannot settle, it continues
    with the settled gain."""
    is_offered: bool = True
    """Whether a user can choose it; False: it only explains why these values would give a different filter."""
    is_common: bool = False
    """Whether it is in the short list that is shown first."""


TARGETS = MappingProxyType(
    {
        "arduino": Target(
            arduino.files,
            "Arduino sketch",
            "A sketch for the Arduino IDE and its C++ header (float32).",
            fixed_gains.arduino_files,
            arduino.calibrated_files,
            arduino.fused_files,
            chains=True,
            precision="float32, gain kept",
            is_common=True,
        ),
        "c": Target(
            c.files,
            "C99",
            "The filter in C99, in double or float.",
            fixed_gains.c_files,
            fused=c.fused_files,
            chains=True,
            is_common=True,
        ),
        "python": Target(
            python.files,
            "Python",
            "A small Python class without dependencies, and the same with Kalscope.",
            fused=python.fused_files,
            chains=True,
            is_common=True,
        ),
        "matlab": Target(
            matlab.files,
            "MATLAB, Octave",
            "A script for MATLAB and Octave, in the letters of Ma'arif 2019.",
            fused=matlab.fused_files,
        ),
        "javascript": Target(
            javascript.files,
            "JavaScript",
            "An ES module with a small class without dependencies.",
            fused=javascript.fused_files,
        ),
        "json": Target(
            json_file.files,
            "JSON",
            "The parameters as JSON.",
            fused=json_file.fused_files,
            chains=True,
            is_common=True,
        ),
        "ros2": Target(ros2.files, "ROS 2 parameters", "A ROS 2 parameter file (YAML).", fused=ros2.fused_files),
        "platformio": Target(
            platformio.files,
            "PlatformIO flags",
            "Compiler flags for PlatformIO, in a file for extra_configs.",
            precision="float32",
        ),
        "esphome": Target(
            esphome.files,
            "ESPHome sensor",
            "A Kalman combination sensor of ESPHome, in standard deviations per second.",
            fused=esphome.fused_files,
            momentum=False,
            precision="float32",
            is_common=True,
        ),
        "bachagas": Target(
            bachagas.files,
            "bachagas/Kalman.h",
            "The constructor of bachagas/Kalman.h, which has the same formula.",
            momentum=False,
            precision="float32",
        ),
        "kalmanjs": Target(
            kalmanjs.files,
            "kalmanjs",
            "The constructor of kalmanjs: the same filter, its letters Q and R swapped.",
            momentum=False,
        ),
        "linuxcnc": Target(
            linuxcnc.files,
            "LinuxCNC",
            "A HAL file for LinuxCNC's filter_kalman, whose manual page swaps Qk and Rk; its code does not.",
            momentum=False,
        ),
        "simplekalmanfilter": Target(
            SIMPLE_KALMAN_FILTER.files,
            "SimpleKalmanFilter",
            "SimpleKalmanFilter uses q differently, so these values would give a different filter.",
            is_offered=False,
        ),
        "gyverfilters": Target(
            GYVER_FILTERS.files,
            "GyverFilters",
            "GKalman of GyverFilters uses q differently, so these values would give a different filter.",
            is_offered=False,
        ),
    }
)
"""The targets, by name."""


def export_tuning(
    tuning: Tuning,
    target: str,
    *,
    channel: str | None = None,
    vectors: Recording | None = None,
    sample_period: float | None = None,
    fixed_gains: bool = False,
    calibration: bool = False,
) -> dict[str, str]:
    """The files of one target.

    Args:
        tuning: What was found.
        target: A name of `TARGETS`.
        channel: Export the filter of this channel only; None = the fusion of the tuning, or all channels if it has
            none.
        vectors: The recording whose first samples, filtered, are added as `groundtruth.csv`; None = none.
        sample_period: Time between two samples on the device, s: q is converted to it; None = the tuning's.
        fixed_gains: Write only the settled filter, whose gains never change (`kalscope_fixed_gains.h`).
        calibration: Add code that measures r on the device on command (arduino).

    Returns:
        The texts by file name. A name is one plain word without a folder; a text is ASCII.

    Raises:
        BadSetting: No such target or channel; the target cannot hold this filter (the message says what can);
            the recording lacks a channel; fixed gains for another target, a fusion, a chain, vectors, a gate or
            q = 0; calibration for another target, a fusion, a chain, fixed gains or r = 0; the period is not
            positive, or the tuning does not know its own.
    """
    if target not in TARGETS:
        raise BadSetting(f"target must be one of {', '.join(TARGETS)} (got {target!r})")
    chosen = tuning.only(channel)
    chosen = chosen if sample_period is None else rescaled_to_period(chosen, sample_period)
    job = job_of(chosen)
    if fixed_gains and not calibration:
        return _fixed(target, job, vectors)
    if calibration:
        files = _calibrated(target, job, fixed_gains=fixed_gains)
    else:
        files = _fused(target, job) if job.fuses else _channels(target, job)
    if vectors is not None:
        from kalscope.export.vectors import vector_files

        files |= vector_files(job, vectors)
    return files


def _able(can: Callable[[Target], object]) -> list[str]:
    """Names of the targets that a user can choose and that can do it."""
    return [name for name, each in TARGETS.items() if each.is_offered and can(each)]


def _channels(target: str, job: ExportJob) -> dict[str, str]:
    if job.has_chain and not TARGETS[target].chains:
        raise refusal_of_chain(job, target, _able(lambda each: each.chains))
    if job.has_momentum and not TARGETS[target].momentum:
        raise refusal_of_momentum(job, target, _able(lambda each: each.momentum))
    return TARGETS[target].files(job)


def _fused(target: str, job: ExportJob) -> dict[str, str]:
    write = TARGETS[target].fused
    if not TARGETS[target].is_offered:
        return TARGETS[target].files(job.as_single)  # says why these values would give a different filter
    if write is None:
        raise refusal_of_fusion(job, target, _able(lambda each: each.fused))
    if job.has_momentum and not TARGETS[target].momentum:
        raise refusal_of_momentum(job.as_single, target, _able(lambda each: each.fused and each.momentum))
    return write(job)


def _fixed(target: str, job: ExportJob, vectors: Recording | None) -> dict[str, str]:
    if job.fuses:
        raise BadSetting(
            f"fixed gains must be of one sensor (got the fusion {comment_text(job.fusion.name)}, whose gains change"
            " with the sensors that answer): leave that option out, or choose a channel"
        )
    if job.has_chain:
        raise refusal_of_chain(job, f"fixed gains for {target}", ("arduino or c without that option",))
    write = TARGETS[target].fixed_gains
    if write is None:
        able = " or ".join(_able(lambda each: each.fixed_gains))
        raise BadSetting(f"target must be {able} for fixed gains (got {target}): leave that option out")
    if vectors is not None:
        raise BadSetting(
            "test vectors must be left out with fixed gains (got a recording): they are those of the whole filter,"
            " which fixed gains equal only once it has settled"
        )
    return write(job)


def _calibrated(target: str, job: ExportJob, *, fixed_gains: bool) -> dict[str, str]:
    write = TARGETS[target].calibration
    if write is None:
        able = " or ".join(_able(lambda each: each.calibration))
        raise BadSetting(f"target must be {able} for calibration (got {target}): leave that option out")
    if job.fuses:
        raise BadSetting(
            f"calibration must be of channels (got the fusion {comment_text(job.fusion.name)}): leave that option"
            " out, or choose a channel"
        )
    if fixed_gains:
        raise BadSetting("calibration must be without fixed gains, which r does not change (got both): choose one")
    return write(job)
