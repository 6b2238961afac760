"""Where Kalscope keeps files of its own, by the custom of each system."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

FOLDER_VARIABLE = "KALSCOPE_CONFIG_DIR"
"""Environment variable that names one folder for all of them, in place of the system's."""


def config_folder() -> Path:
    """The folder for settings.

    Raises:
        OSError: the account has no home folder.
    """
    return _folder(platformdirs.user_config_dir("kalscope", appauthor=False, roaming=True))


def state_folder() -> Path:
    """The folder for what must survive a restart, such as the token of the link.

    Raises:
        OSError: the account has no home folder.
    """
    return _folder(platformdirs.user_state_dir("kalscope", appauthor=False))


def _folder(default: str) -> Path:
    named = os.environ.get(FOLDER_VARIABLE)
    if not named and not os.path.isabs(default):  # "~" could not be resolved
        raise OSError("this account has no home folder")
    return Path(named or default)
