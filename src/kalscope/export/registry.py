"""Export: a tuning becomes the files of a target, with test vectors; all are written, or none."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Literal

import numpy as np

from kalscope.errors import BadSetting
from kalscope.export.float32 import float32_tuning, runs_kalman
from kalscope.export.job import ExportJob, job_of
from kalscope.export.settings import SETTINGS, Setting, files, matched
from kalscope.export.targets import arduino, c, esphome, parameters, scripts
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.recording import Recording
from kalscope.tuning.tuning import ChannelTuning, Tuning, rescaled_to_period

# Test vectors: what the exported filter must output for the user's own samples.


MAX_ROWS = 1000
"""Rows of a vector file: the start is among them, and more rows would prove no more."""


def vector_files(job: ExportJob, recording: Recording) -> dict[str, str]:
    """`groundtruth.csv`, or `groundtruth_IDENTIFIER.csv` for each of several channels.

    The first rows of the recording through the filter without time (dt = None), as a device runs it; float64
    digits that read back bit for bit; a missing sample is `nan`, and so are x before the first sample and the gain
    of a classic filter. With momentum a last column has the filtered velocity, unit per sample. A fusion has a
    column for each sensor, then the fused value and its variance.

    Args:
        job: The filters, or a fusion.
        recording: Has a channel of each name; where both have only one, the names may differ.

    Raises:
        BadSetting: The recording has no such channel or no rows.
    """
    if not len(recording):
        raise BadSetting("test vectors must have at least one row (got none)")
    read, last = (job.sensor_identifiers, "variance") if job.fuses else (("raw",), "gain")
    header, channels = ",".join(("time", *read, "filtered", last)), job.channels
    if len(channels) == len(recording.names) == 1:
        channels = (replace(channels[0], name=recording.names[0]),)
    endings = [f"_{word}" for word, _ in job.named_channels] if len(channels) > 1 else [""]
    return {
        f"groundtruth{ending}.csv": _text(channel, recording, header)
        for ending, channel in zip(endings, channels, strict=True)
    }


def _text(one: ChannelTuning, recording: Recording, header: str) -> str:
    z = np.ascontiguousarray(one.readings(recording)[:MAX_ROWS])
    result = one.filter.run(z)
    columns = [recording.time[:MAX_ROWS], *np.atleast_2d(z.T), result.x, result.p if one.sensors else result.k]
    if result.velocity is not None:
        header, columns = f"{header},velocity", [*columns, result.velocity]
    lines = (",".join(map(repr, row)) for row in zip(*(c.tolist() for c in columns), strict=True))
    return "\n".join((header, *lines, ""))


# Export: a tuning becomes the files of a target, the same filter everywhere.
#
# Each module has `files(job) -> dict of file name -> text`; names are constants or identifiers, texts ASCII.


@dataclass(frozen=True)
class Target:
    """One entry of the registry."""

    files: Callable[..., dict[str, str]]
    """Writes it: the texts by file name."""
    title: str
    """Its name on screen, a few words."""
    what: str
    """What it is, one sentence."""
    lacks: tuple[Literal["momentum", "chain", "two_speeds"], ...] = ()
    """What its filters cannot have."""
    is_float32: bool = False
    """Whether it computes in float32, at least on an AVR board."""
    can_calibrate: bool = False
    """Whether it has code that measures r on the device, `files(job, calibration=True)`."""
    setting: Setting | None = None
    """What it is where it is a setting of another program's filter: each channel gets that filter first."""


TARGETS = MappingProxyType(
    {
        "arduino": Target(
            arduino.files,
            "Arduino sketch",
            "A sketch for the Arduino IDE and its C++ header (float32).",
            is_float32=True,
            can_calibrate=True,
        ),
        "c": Target(c.files, "C99", "The filter in C99, in double or float."),
        "python": Target(
            scripts.python_files,
            "Python",
            "A small Python class without dependencies.",
        ),
        "matlab": Target(
            scripts.matlab_files,
            "MATLAB, Octave",
            "A script for MATLAB and Octave, in the letters of Ma'arif 2019.",
            ("chain",),
        ),
        "javascript": Target(
            scripts.javascript_files,
            "JavaScript",
            "An ES module with a small class without dependencies.",
            ("chain",),
        ),
        "json": Target(parameters.json_files, "JSON", "The parameters as JSON."),
        "esphome": Target(
            esphome.files,
            "ESPHome sensor",
            "A Kalman combination sensor of ESPHome, in standard deviations per second.",
            ("momentum", "chain", "two_speeds"),
            is_float32=True,
        ),
    }
    | {name: Target(partial(files, name, row), row.title, row.what, setting=row) for name, row in SETTINGS.items()}
)
"""The targets, by name."""

_NEEDS = (
    ("chain", "a median, a notch and classic filters", "use the Kalman filter alone in every channel"),
    ("momentum", "momentum", "set the momentum to 0"),
    ("two_speeds", "two speeds, which no single q and r replace", "fit one speed"),
)
"""What some targets lack, in words, and what to do without it."""


def export_tuning(
    tuning: Tuning,
    target: str,
    *,
    channel: str | None = None,
    vectors: Recording | None = None,
    sample_period: float | None = None,
    calibration: bool = False,
    minimal: bool = False,
) -> dict[str, str]:
    """The files of one target.

    Args:
        tuning: What was found.
        target: A name of `TARGETS`.
        channel: Export the filter of this channel only; None = the fusion of the tuning, or all channels if it has
            none.
        vectors: The recording whose first samples, filtered, are added as `groundtruth.csv`; None = none.
        sample_period: Time between two samples on the device, s: q is converted to it; None = the tuning's.
        calibration: Add code that measures r on the device on command (arduino).
        minimal: Leave out the commands and the exact digits (arduino): filter and loop only.

    Returns:
        The texts by file name. A name is one plain word without a folder; a text is ASCII.

    Raises:
        BadSetting: No such target or channel; the target does not run such a filter (the message says which do);
            the recording lacks a channel; calibration for another target, a fusion, a chain or r = 0; the period is
            not positive, or the tuning does not know its own.
    """
    if target not in TARGETS:
        near = "".join(f"; did you mean {name}?" for name in get_close_matches(target, TARGETS, 1))
        raise BadSetting(f"target must be one of {', '.join(TARGETS)} (got {target!r}{near})")
    chosen = tuning.only(channel)
    chosen = chosen if sample_period is None else rescaled_to_period(chosen, sample_period)
    if (setting := TARGETS[target].setting) is not None:
        chosen = matched(chosen, setting, vectors)
    job = job_of(chosen)
    for need, words, instead in _NEEDS:
        if getattr(job, f"has_{need}") and need in TARGETS[target].lacks:
            can = (name for name, each in TARGETS.items() if need not in each.lacks and each.setting is None)
            able = ", ".join(can)
            raise BadSetting(f"target must support {words} (got {target}): choose {able}, or {instead}")
    if calibration and (job.fuses or not TARGETS[target].can_calibrate):
        able = " or ".join(name for name, each in TARGETS.items() if each.can_calibrate)
        got = "fused sensors" if job.fuses else target
        raise BadSetting(f"calibration must be for {able} and the filters of channels (got {got})")
    if minimal and (calibration or job.fuses or target != "arduino"):
        got = "calibration" if calibration else "fused sensors" if job.fuses else target
        raise BadSetting(f"minimal must be for arduino, the filters of channels and no calibration (got {got})")
    extra = {name: True for name, on in (("calibration", calibration), ("minimal", minimal)) if on}
    texts = TARGETS[target].files(job, **extra)
    return texts if vectors is None else texts | vector_files(job, vectors)


# What float32 cannot do, reported before the export.


STALLING_GAIN = 7e-6
"""Below this settled gain the variance rounds to a stop where the gain is off by 1 % and more: measured."""

UNO_COUNTS = 1023.0
"""Largest value of analogRead() on an Uno: the signal, where none is known."""


def limits_of(tuning: Tuning, target: str, level: Callable[[str], float] = lambda _: UNO_COUNTS) -> list[str]:
    """What differs on a target that computes in float32, one sentence each.

    Args:
        tuning: What is exported.
        target: A name of `TARGETS`.
        level: Largest size of the signal of a channel, or of the reading of a sensor, unit, > 0, by its name.
    """
    if not TARGETS[target].is_float32:
        return []
    filters, limits = job_of(tuning).channels, list[str]()
    for one in filters:
        try:
            float32_tuning(one)
        except BadSetting as error:
            limits.append(f"{error}. Scale the signal, or export to a target with double.")
            continue
        if runs_kalman(one):
            readings = np.array([level(name) for name in one.sensors or (one.name,)])
            largest = float(np.max(readings / np.abs(one.params.gain)))
            limits += _stalls(one.params.as_single, largest)
    others = " and ".join(f"{one.name} is in {one.unit}" for one in filters if arduino.is_not_in_counts(one))
    if target == "arduino" and others:
        limits.append(f"the sketch reads counts, but {others}: it compiles once you have written readSensor().")
    return list(dict.fromkeys(limits))


def _stalls(params: FilterParams, level: float) -> Iterator[str]:
    """A gain that float32 does not settle to, and an estimate that stops moving.

    A correction below half the distance of two floats is lost: x no longer moves. With momentum the velocity
    collects what single corrections lose: a lasting innovation i drives it to τ L i.

    Args:
        params: Those of one sensor.
        level: Largest size of its signal, unit.
    """
    steady, r = steady_state(params), float(params.r)
    gain = float(steady.gain)
    if 0.0 < gain < STALLING_GAIN:
        yield (
            f"float32 cannot settle to a gain as small as {gain:.3g}: its variance stops changing too early."
            " Export c, in double, or take a larger q."
        )
    spread = math.sqrt(params.q if gain == 1.0 else r / (1.0 - gain))  # of the innovation: s = r / (1 - K)
    gain = max(gain, params.momentum * float(steady.velocity_gain))
    half_ulp = float(np.spacing(np.float32(level))) / 2.0
    if gain * spread >= half_ulp:
        return
    if gain > 0.0:
        where = f"the board's filtered value does not move while the signal is within {half_ulp / gain:.3g} of it"
    else:
        where = f"after {spread / half_ulp:.2g} samples the board's filtered value stops moving"
    yield (
        f"float32 steps by {2.0 * half_ulp:.2g} at {level:.4g}, more than a usual correction: {where}. Subtract "
        "the level before filtering, filter every n-th sample with n times q, or use a board with double."
    )


# Write exported files into a folder.


def sketch_name(files: dict[str, str]) -> str:
    """Name of the Arduino sketch among the files, "" where there is none.

    The Arduino IDE opens a sketch only from a folder of its name.
    """
    return next((PurePosixPath(name).stem for name in files if name.endswith(".ino")), "")


def in_sketch_folder(files: dict[str, str]) -> dict[str, str]:
    """The files of an Arduino sketch below a folder of its name; other files as they are."""
    sketch = sketch_name(files)
    return {f"{sketch}/{name}": text for name, text in files.items()} if sketch else files


def write_files(files: dict[str, str], folder: Path, *, force: bool = False) -> list[Path]:
    """Write the files of an export into a folder, which is created if it is missing: all of them or none.

    Args:
        files: Texts by file name, as `export_tuning` gives them; a name may begin with folders.
        folder: Where to.
        force: Replace files that are there.

    Returns:
        What was written, as paths in `folder`.

    Raises:
        BadSetting: A name leads out of the folder; or a file is there and `force` is off: none is written then.
        OSError: The folder or a file cannot be written.
    """
    from kalscope.common.files import atomic_file, check_inside, check_new, make_folder

    targets = {name: check_inside(name, folder) for name in files}
    check_new(*(folder / name for name in files), force=force)
    make_folder(folder)
    with ExitStack() as opened:  # all are on the disk before the first takes its name
        for name, path in targets.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            file = opened.enter_context(atomic_file(path))
            file.write(files[name].encode())
            file.flush()  # a full disk is found here, not when some names are taken
    return [folder / name for name in files]
