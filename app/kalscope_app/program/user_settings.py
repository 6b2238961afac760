"""What is kept between starts, and the folder for it on each system. No viser here."""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from pathlib import Path

import platformdirs

from kalscope.common.files import write_private
from kalscope.errors import BadFile, BadSetting
from kalscope.tuning.file import dumps, load_tuning
from kalscope.tuning.tuning import Tuning

FOLDER_VARIABLE = "KALSCOPE_CONFIG_DIR"
"""Environment variable that names the folder, in place of the system's."""


def state_folder() -> Path:
    """The folder for what must survive a restart, such as the link's token; OSError without a home folder."""
    named, default = os.environ.get(FOLDER_VARIABLE), platformdirs.user_state_dir("kalscope", appauthor=False)
    if not named and not os.path.isabs(default):  # "~" could not be resolved
        raise OSError("this account has no home folder")
    return Path(named or default)


class UserSettings:
    """What the user has switched on or seen, such as `tour_seen`: each is an empty file of that name."""

    def __init__(self, folder: Path | None = None) -> None:
        """Args: where they are; None = the user's folder."""
        self._folder = folder

    def has(self, name: str) -> bool:
        """Whether it is kept; False where the folder cannot be read."""
        with suppress(OSError):
            return ((self._folder or state_folder()) / name).is_file()
        return False

    def keep(self, **values: bool) -> None:
        """Keep those that are true, and no longer those that are false; the others stay.

        Raises:
            OSError: the folder cannot be written.
        """
        folder = self._folder or state_folder()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for name, value in values.items():
            if value:
                (folder / name).touch()
            else:
                (folder / name).unlink(missing_ok=True)


# The filters of each file as they were left, kept between starts.


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
            source = load_tuning(_newest_first(_kept_tunings_folder())[0]).source
            return source if Path(source).is_file() else ""
        return ""


def _kept_tunings_folder() -> Path:
    return state_folder() / "tunings"


def _file_of(source: str) -> Path:
    digest = hashlib.sha256(source.encode(errors="surrogateescape")).hexdigest()
    return _kept_tunings_folder() / f"{digest[:32]}.toml"


def _newest_first(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.toml"), key=lambda file: file.stat().st_mtime_ns, reverse=True)
