"""The note that a run writes when it begins: its results can be looked at before its end, and opened again."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kalscope.common.checks import above_zero
from kalscope.common.files import write_atomic
from kalscope.errors import BadFile, BadSetting, KalscopeError
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions, option_texts, options_from_text

NAME = "run.json"
"""Name of the note in the folder of a fleet; each run writes it again, before `fleet.json`."""
TABLE = "fleet.parquet"
"""Name of the table in it."""
TUNING = "tuning.toml"
"""The tuning of the filter for all, an ordinary tuning file."""
SUMMARY = "fleet.json"
"""The answer for programs, the last but one file that a run writes."""
MAX_BYTES = 10_000_000
"""Bytes of a file with JSON, at most; fleet.json with all its lists has less than one million."""


@dataclass(frozen=True)
class Begun:
    """The note."""

    units: int | None = None
    """Files or row groups of the fleet; None where it is not known."""
    options: str = ""
    """Hash of the options."""
    since: int = 0
    """When the first run with these options began, ns since 1970: older parts belong to other options."""
    pooled: bool = True
    """Whether the filter for all is the most likely one; False where a goal was given."""
    reading: ReadOptions = DEFAULTS
    """How files are read."""
    sample_period: float | None = None
    """Sample period in s in place of that of the recordings."""


def check_own(folder: Path) -> None:
    """Refuse a folder in which a run would overwrite files that no fleet wrote.

    Raises:
        BadSetting: there is such a file.
    """
    foreign: str | None = None
    if (folder / NAME).exists():
        try:
            read_begun(folder)
        except BadFile:
            foreign = NAME
    else:
        foreign = next((name for name in (TABLE, SUMMARY, TUNING) if (folder / name).exists()), None)
    if foreign is not None:
        raise BadSetting(
            f"-o must name a new folder or that of a fleet (got {str(folder)!r}, whose {foreign} no fleet wrote)"
        )


def note_begun(
    folder: Path, units: int, options: str, reading: ReadOptions, sample_period: float | None, *, pooled: bool
) -> None:
    """Write the note of a run that begins in a folder that has passed `check_own`.

    Args:
        folder: Of the fleet, which this run holds.
        units: Files or row groups.
        options: The fingerprint of the options.
        reading: How files are read.
        sample_period: In s, in place of that of the recordings.
        pooled: Whether the filter for all is the most likely one.
    """
    own, since = hashlib.sha256(options.encode("utf-8", "surrogatepass")).hexdigest(), time.time_ns()
    before = read_begun(folder)
    content = {
        "units": units,
        "options": own,
        "since": before.since if before.options == own else since,
        "pooled": pooled,
        "reading": option_texts(reading),
        "sample_period": sample_period,
    }
    write_atomic(folder / NAME, (json.dumps(content, indent=1) + "\n").encode())


def read_begun(folder: Path) -> Begun:
    """The note of the last run; an empty one where there is none.

    Raises:
        BadFile: the file exists and is not such a note.
    """
    path = folder / NAME
    if not path.exists():
        return Begun()
    content = read_json(path)
    try:
        texts = {str(name): [str(text) for text in several] for name, several in content["reading"].items()}
        missing = texts.pop("missing", [])
        single: dict[str, Any] = {name: several[0] for name, several in texts.items()}
        if "day_first" in single:
            single["day_first"] = single["day_first"] == "day"
        period = content["sample_period"]
        return Begun(
            int(content["units"]),
            str(content["options"]),
            int(content["since"]),
            bool(content["pooled"]),
            options_from_text(**single, missing=missing),
            None if period is None else above_zero("sample_period", period),
        )
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError, KalscopeError) as error:
        raise BadFile(f"{str(path)!r} must be the note of a run of kalscope fleet (got {error!r:.100})") from None


def read_json(path: Path) -> dict[str, Any]:
    """An object in JSON from a file that any program may have written.

    Raises:
        BadFile: it cannot be read, is too large, or is not an object.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ValueError("more than 10 MB")
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise BadFile(f"{str(path)!r} must be an object in JSON (got {str(error)[:100]})") from None
    if not isinstance(content, dict):
        raise BadFile(f"{str(path)!r} must be an object in JSON (got a {type(content).__name__})")
    return content  # pyright: ignore[reportUnknownVariableType]
