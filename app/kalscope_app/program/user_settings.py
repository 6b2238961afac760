"""What is kept between starts: the folders for it on each system, and the file of settings. No viser here."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

import platformdirs

from kalscope.common.files import write_atomic

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
        return self._read().get("tour_seen") is True

    @property
    def map_shown(self) -> bool:
        """Whether the tuning map was open when it was last opened or closed."""
        return self._read().get("map_shown") is True

    def keep(self, **values: bool) -> None:
        """Write some of the settings above, by their names; the others stay.

        Raises:
            OSError: the file cannot be written.
        """
        kept = {name: value for name, value in self._read().items() if isinstance(value, bool)}
        lines = "".join(f"{name} = {str(value).lower()}\n" for name, value in sorted({**kept, **values}.items()))
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(self.path, f"{HEADER}{lines}".encode())

    def _read(self) -> dict[str, object]:
        try:
            if not self.path.is_file():  # a pipe or a device would be read forever
                return {}
            with self.path.open("rb") as file:
                found = tomllib.loads(file.read(MAX_BYTES).decode())
        except (OSError, ValueError, RecursionError):
            return {}
        return {name: value for name, value in found.items() if name in KNOWN}
