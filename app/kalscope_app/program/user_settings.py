"""What is remembered from one start to the next: a small file in the user's config folder. No viser here."""

from __future__ import annotations

import os
import sys
import tomllib
from pathlib import Path

from kalscope.common.files import write_atomic

FOLDER_VARIABLE = "KALSCOPE_CONFIG_DIR"
"""Environment variable that names another folder than the system's."""

LARGEST = 65_536
"""Bytes of the file that are read at most."""

HEADER = "# What Kalscope remembers. It may be deleted: the tour is then shown again.\n"


def config_folder() -> Path:
    """Where the user's programs keep their settings on this system, and in it our folder."""
    named = os.environ.get(FOLDER_VARIABLE)
    if named:
        return Path(named)
    if os.name == "nt":
        return Path(os.environ.get("APPDATA") or Path.home()) / "kalscope"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "kalscope"
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "kalscope"


class Remembered:
    """Reads and writes the file; one that cannot be read counts as empty."""

    def __init__(self, folder: Path | None = None) -> None:
        """Args: its folder; None = the user's."""
        self.path = (folder or config_folder()) / "settings.toml"

    @property
    def tour_seen(self) -> bool:
        """Whether the person has asked not to see the tour again."""
        try:
            if not self.path.is_file():  # a pipe or a device would be read for ever
                return False
            with self.path.open("rb") as file:
                return tomllib.loads(file.read(LARGEST).decode()).get("tour_seen") is True
        except (OSError, ValueError, RecursionError):
            return False

    def forget_tour(self) -> None:
        """Do not show the tour again.

        Raises:
            OSError: the file cannot be written.
        """
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(self.path, f"{HEADER}tour_seen = true\n".encode())
