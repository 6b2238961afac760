"""file:PATH: a file of this computer that another program still writes."""

from __future__ import annotations

import time
from collections.abc import Callable

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.port.growing_file import GrowingFile, Replaced, Unusable
from kalscope.sources.port.transport import READ_TIMEOUT, Endpoint, OpenPort, Transport, short

PREFIX = "file:"
"""How the address of a file that is followed begins."""


def _check(address: str) -> None:
    if not address[len(PREFIX) :].strip():
        raise BadSetting(f"the address of a file must be {PREFIX}PATH (got {address!r})")


class FileEndpoint(Endpoint):
    """A file, over all its openings: one that was replaced is read from its beginning."""

    def __init__(self, address: str, _baud: int, _reset: bool) -> None:
        """Take an address that was checked."""
        self.path = address[len(PREFIX) :]
        self.device = self.path
        self._file: GrowingFile | None = None

    def open(self, is_ended: Callable[[], bool]) -> OpenPort:
        """Open the file where the last opening ended; see Endpoint."""
        del is_ended  # a file opens at once
        last = self._file
        try:
            file = GrowingFile(self.path, last.position, last.before) if last else GrowingFile(self.path)
        except Unusable as error:
            words = {
                "missing": f"there is no file {self.path}",
                "denied": f"no permission to read {self.path}",
                "irregular": f"{self.path} must be a file, not a folder or a device",
            }
            why = words.get(str(error), f"{self.path} cannot be read ({short(str(error))})")
            raise BadDevice(why) from None
        self._file = file
        return FilePort(self.path, file, resumed=last is not None and file.position == last.position)


class FilePort(OpenPort):
    """A file that is read as it grows."""

    keeps = True

    def __init__(self, path: str, file: GrowingFile, *, resumed: bool) -> None:
        """Args: its name; the open file; whether it continues where the last opening ended."""
        self._path, self._file = path, file
        self.starts = "where it stopped" if resumed else "at a line"

    def fetch(self) -> bytes:
        """Whole lines that were added; see OpenPort."""
        try:
            lines = self._file.read()
        except Replaced:
            raise BadDevice(f"{self._path} was replaced or cut short: it is read from its beginning") from None
        except OSError as error:
            raise BadDevice(f"{self._path} can no longer be read ({short(str(error))})") from error
        if not lines:
            time.sleep(READ_TIMEOUT)
        return lines

    def waiting(self) -> int:
        """Always 0: the file keeps what was not read."""
        return 0

    def close(self) -> None:
        """Close the file."""
        self._file.close()


FILE = Transport((PREFIX,), "file:log.csv", _check, FileEndpoint)
"""A file that grows."""
