"""A list of files: one path per line, and after a comma or a tab the channel."""

from __future__ import annotations

import csv
import os

from kalscope.errors import BadFile, describe


def read_list(path: str) -> list[tuple[str, str | None]]:
    """The entries of a list, each a path and a channel or None.

    A line is PATH or PATH,CHANNEL, with a comma or a tab between them and quotes where a path contains one; a path
    is relative to the folder of the list. Empty lines and lines that begin with # are left out.

    Raises:
        BadFile: The list cannot be read, names nothing, or a line has three parts.
    """
    try:
        # str.splitlines would cut a path at a form feed.
        with open(path, encoding="utf-8-sig") as file:
            lines = file.readlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = describe(error) if isinstance(error, OSError) else "it must be text in UTF-8"
        raise BadFile(f"the list {path!r} cannot be read: {reason}") from None
    folder = os.path.dirname(os.path.abspath(path))
    entries = [_entry(line, i, path, folder) for i, line in enumerate(lines, 1) if _is_entry(line)]
    if not entries:
        raise BadFile(f"the list {path!r} must name at least one file (got {len(lines)} lines)")
    return entries


def _is_entry(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _entry(line: str, number: int, path: str, folder: str) -> tuple[str, str | None]:
    try:
        cells = next(csv.reader([line], delimiter="\t" if "\t" in line else ",", skipinitialspace=True))
    except csv.Error:  # longer than any path
        cells = []
    if len(cells) not in (1, 2) or not cells[0].strip():
        raise BadFile(f"line {number} of {path!r} must be PATH or PATH,CHANNEL (got {line.strip()[:80]!r})")
    channel = cells[1].strip() if len(cells) == 2 else ""
    return os.path.join(folder, cells[0].strip()), channel or None
