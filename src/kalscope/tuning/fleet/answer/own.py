"""Which tuning file in the folder of a fleet is the fleet's own: any other is never overwritten or removed."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from kalscope.errors import BadFile, BadSetting
from kalscope.tuning import toml_text as toml
from kalscope.tuning.fleet.store.begun import SUMMARY, TUNING, read_json

RECORD = "tuning_sha256"
"""Entry of fleet.json: the digests that tuning.toml may have, of the present file and of its successor."""


def digest_of(text: str) -> str:
    """The digest of the values of a tuning file: comments may be added."""
    values = json.dumps(toml.parse(text), sort_keys=True, default=str)
    return hashlib.sha256(values.encode("utf-8", "surrogatepass")).hexdigest()


def own_digest(folder: Path) -> str | None:
    """The digest of tuning.toml where the fleet has written it; None where there is none, or it is the user's."""
    try:
        found, known = digest_of(toml.read_text(folder / TUNING)), read_json(folder / SUMMARY)[RECORD]
    except (BadFile, KeyError):
        return None
    return found if isinstance(known, list) and found in known else None


def check_tuning(folder: Path) -> None:
    """Refuse a folder with a tuning file that no fleet wrote, or that was changed since.

    Raises:
        BadSetting: there is one.
    """
    path = folder / TUNING
    if path.exists() and own_digest(folder) is None:
        raise BadSetting(
            f"-o must name a folder without a {TUNING} of your own (got {str(path)!r}, which no fleet wrote or"
            " which was changed since): move it and run the same command again"
        )
