"""The filters of each file as they were left, kept between starts."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path

from kalscope.common.files import write_private
from kalscope.errors import BadFile, BadSetting
from kalscope.tuning.tuning import Tuning
from kalscope.tuning.tuning_file import dumps, load_tuning
from kalscope_app.program.user_settings import state_folder

MAX_FILES = 100
"""Files whose filters are kept; those tuned longest ago are forgotten first."""


class KeptTunings:
    """One tuning file for each file that was opened by its path."""

    def of(self, source: str) -> Tuning | None:
        """What was kept for a file; None where nothing was, or it cannot be read."""
        with suppress(OSError, BadFile, BadSetting):
            return load_tuning(_file_of(source))
        return None

    def keep(self, tuning: Tuning) -> None:
        """Write it, as the newest.

        Raises:
            OSError: the file cannot be written.
        """
        file = _file_of(tuning.source)
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_private(file, dumps(tuning).encode())
        for old in _newest_first(file.parent)[MAX_FILES:]:
            old.unlink(missing_ok=True)

    def last(self) -> str:
        """The file that was open last, if it is still there; "" otherwise."""
        with suppress(OSError, BadFile, BadSetting, IndexError):
            source = load_tuning(_newest_first(_folder())[0]).source
            return source if Path(source).is_file() else ""
        return ""


def _folder() -> Path:
    return state_folder() / "tunings"


def _file_of(source: str) -> Path:
    return _folder() / f"{hashlib.sha256(source.encode(errors='surrogateescape')).hexdigest()[:32]}.toml"


def _newest_first(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.toml"), key=lambda file: file.stat().st_mtime_ns, reverse=True)
