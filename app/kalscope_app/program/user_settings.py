"""What is kept between starts: the folders for it on each system, and the file of settings. No viser here."""

from __future__ import annotations

import hashlib
import os
import tomllib
from contextlib import suppress
from pathlib import Path

import platformdirs

from kalscope.common.files import write_atomic, write_private
from kalscope.errors import BadFile, BadSetting
from kalscope.tuning.file import dumps, load_tuning
from kalscope.tuning.tuning import Tuning

FOLDER_VARIABLE = "KALSCOPE_CONFIG_DIR"
"""Environment variable that names one folder for settings and state, in place of the system's."""

MAX_BYTES = 65_536
"""Bytes of the file that are read, at most."""

KNOWN = ("map_shown", "tour_seen")
"""The settings that the file may hold; all others are dropped."""

HEADER = "# Settings of Kalscope. This file may be deleted: the tour is then shown again.\n"


def config_folder() -> Path:
    """The folder for settings; OSError without a home folder."""
    return _folder(platformdirs.user_config_dir("kalscope", appauthor=False, roaming=True))


def state_folder() -> Path:
    """The folder for what must survive a restart, such as the link's token; OSError without a home folder."""
    return _folder(platformdirs.user_state_dir("kalscope", appauthor=False))


def _folder(default: str) -> Path:
    named = os.environ.get(FOLDER_VARIABLE)
    if not named and not os.path.isabs(default):  # "~" could not be resolved
        raise OSError("this account has no home folder")
    return Path(named or default)


class UserSettings:
    """Reads and writes the file; one that cannot be read counts as empty."""

    def __init__(self, folder: Path | None = None) -> None:
        """Args: its folder; None = the user's."""
        self._folder = folder

    @property
    def path(self) -> Path:
        """The file."""
        return (self._folder or config_folder()) / "settings.toml"

    @property
    def tour_seen(self) -> bool:
        """Whether the user asked not to see the tour again."""
        return self._read().get("tour_seen", False)

    @property
    def map_shown(self) -> bool:
        """Whether the tuning map was open when it was last opened or closed."""
        return self._read().get("map_shown", False)

    def keep(self, **values: bool) -> None:
        """Write some of the settings above, by their names; the others stay.

        Raises:
            OSError: the file cannot be written.
        """
        kept = sorted({**self._read(), **values}.items())
        lines = "".join(f"{name} = {str(value).lower()}\n" for name, value in kept)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(self.path, f"{HEADER}{lines}".encode())

    def _read(self) -> dict[str, bool]:
        try:
            if not self.path.is_file():  # a pipe or a device would be read forever
                return {}
            with self.path.open("rb") as file:
                found = tomllib.loads(file.read(MAX_BYTES).decode())
        except (OSError, ValueError, RecursionError):
            return {}
        return {name: value for name, value in found.items() if name in KNOWN and isinstance(value, bool)}


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
    return (
        _kept_tunings_folder() / f"{hashlib.sha256(source.encode(errors='surrogateescape')).hexdigest()[:32]}.toml"
    )


def _newest_first(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.toml"), key=lambda file: file.stat().st_mtime_ns, reverse=True)
