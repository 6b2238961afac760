"""Write exported files into a folder, and report the limits of a device."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kalscope.tuning.tuning import Tuning

UNO_COUNTS = 1023.0
"""Largest value of analogRead() on an Uno: the signal, where none is known."""


def limits_of(
    tuning: Tuning,
    channel: str | None,
    target: str,
    level: Callable[[str], float] = lambda _: UNO_COUNTS,
    *,
    fixed_gains: bool = False,
) -> list[str]:
    """What differs on a target that computes in float32, one sentence each.

    Args:
        tuning: What is exported.
        channel: Only this channel; None = the fusion, or all where there is none.
        target: A name of `TARGETS`.
        level: Largest size of the signal of a channel, or of the reading of a sensor, unit, by its name.
        fixed_gains: Whether only the settled filter is exported: no variance can stall, and it is faster.
    """
    from kalscope.export.registry import TARGETS

    precision = TARGETS[target].precision
    if precision == "float64":
        return []

    from kalscope.export.device_limits import not_in_counts, tuning_limits

    chosen = tuning.only(channel)
    filters = chosen.channels if chosen.fusion is None else (chosen.fusion,)
    found = tuning_limits(
        filters,
        levels=[level(name) for one in filters for name in one.sensors or (one.name,)],
        sample_period=chosen.sample_period,
        constant_gain=precision == "float32, gain kept",
    )
    others = not_in_counts(filters)
    said = [limit.message for limit in found if limit.kind == "estimate" or not fixed_gains]
    others = " and ".join(f"{one.name} is in {one.unit}" for one in others)
    if target == "arduino" and others and not fixed_gains:
        said.append(f"the sketch reads counts, but {others}: it compiles once you have written readSensor().")
    return list(dict.fromkeys(said))


def sketch_name(files: dict[str, str]) -> str:
    """Name of the Arduino sketch among the files, "" where there is none.

    The Arduino IDE opens a sketch only from a folder of its name.
    """
    return next((PurePosixPath(name).stem for name in files if name.endswith(".ino")), "")


def in_sketch_folder(files: dict[str, str]) -> dict[str, str]:
    """The files of an Arduino sketch below a folder of its name; other files as they are."""
    sketch = sketch_name(files)
    return {f"{sketch}/{name}": text for name, text in files.items()} if sketch else files


def existing_files(files: dict[str, str], folder: Path) -> list[str]:
    """Those of the names that are in the folder already.

    Raises:
        BadSetting: A name leads out of the folder.
    """
    from kalscope.common.files import check_inside

    return [name for name in files if check_inside(name, folder).exists()]


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
