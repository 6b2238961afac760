"""Exported files into a folder, and the limits of a device that are worth a note."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from kalscope.errors import BadSetting
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
        channel: Only this channel; None = all.
        target: A name of `TARGETS`.
        level: Largest size of the signal of a channel, unit, by its name.
        fixed_gains: Whether only the settled filter is exported: no variance can stall, and it is faster.
    """
    from kalscope.export.device_limits import FLOAT32_TARGETS, device_limits

    if target not in FLOAT32_TARGETS:
        return []

    chosen = tuning.channels if channel is None else (tuning.channel(channel),)
    said = [
        limit.message
        for one in chosen
        for limit in device_limits(
            one.params,
            level=level(one.name),
            sample_period=tuning.sample_period,
            channels=len(chosen),
            constant_gain=FLOAT32_TARGETS[target],
        )
        if limit.kind == "estimate" or not fixed_gains
    ]
    return list(dict.fromkeys(said))


def write_files(files: dict[str, str], folder: Path, *, force: bool = False) -> list[Path]:
    """Write the files of an export into a folder, which is made if it is missing; each whole or not at all.

    Args:
        files: Texts by file name, as `export_tuning` gives them.
        folder: Where to.
        force: Replace files that are there.

    Returns:
        What was written, as paths in `folder`.

    Raises:
        BadSetting: A name leads out of the folder; or a file is there and `force` is off: none is written then.
        OSError: The folder or a file cannot be written; files before it are.
    """
    from kalscope.common.files import check_inside, write_atomic

    targets = {name: check_inside(name, folder) for name in files}
    there = [name for name, path in targets.items() if path.exists()]
    if there and not force:
        raise BadSetting(f"-o must be a folder without {', '.join(there)}, or give --force (got {str(folder)!r})")
    folder.mkdir(parents=True, exist_ok=True)
    for name, path in targets.items():
        write_atomic(path, files[name].encode())
    return [folder / name for name in files]
