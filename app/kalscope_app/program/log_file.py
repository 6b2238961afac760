"""The log: warnings on the terminal, everything in a file if requested. Never the token."""

from __future__ import annotations

import logging
import logging.handlers
import os
import re
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import TextIOWrapper
from pathlib import Path

from kalscope.common.text import CONTROL
from kalscope.errors import BadSetting

FILE_BYTES = 2**20
"""Size at which a new log file is begun."""
OLD_FILES = 2
"""Full files kept beside the current one, as FILE.1 and FILE.2."""

_ENTRY = re.compile(rb"[0-9]{4}-[0-9]{2}-[0-9]{2} [0-9:,]{12} [A-Z]+ [^ ]+: |\Z")
"""What a log begins with; an empty file is as good."""
_SECRET = re.compile(r"(token=|kalscope_\d+=)[A-Za-z0-9_-]+")


class Lines(logging.Formatter):
    """One entry per line; text from outside can neither begin an entry of its own nor move the cursor."""

    def __init__(self, pattern: str, hidden: list[str], *, with_traceback: bool) -> None:
        super().__init__(pattern)
        self._hidden, self._with_traceback = hidden, with_traceback

    def format(self, record: logging.LogRecord) -> str:
        """The entry, with further lines indented."""
        if self._with_traceback:
            text = super().format(record)
        else:
            bare = {"exc_info": None, "exc_text": None, "stack_info": None}
            text = super().format(logging.makeLogRecord(record.__dict__ | bare))
        text = _SECRET.sub(r"\1…", text)
        for secret in self._hidden:
            text = text.replace(secret, "…")
        return "\n    ".join(CONTROL.sub("·", line) for line in text.split("\n"))


class _Quiet:
    """A log that cannot be written (a full disk, a closed terminal) must not become an error of its own."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """Drop the entry."""


class _Terminal(_Quiet, logging.StreamHandler):  # pyright: ignore[reportMissingTypeArgument]
    pass


class _File(_Quiet, logging.handlers.RotatingFileHandler):
    def _open(self) -> TextIOWrapper:
        """For this user only: other users of the machine must not learn the names of files."""
        handle = os.open(self.baseFilename, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
        return open(handle, "a", encoding="utf-8", errors="backslashreplace")


@dataclass(frozen=True)
class Log:
    """The running log."""

    file: Path | None
    """The file that holds everything."""
    hidden: list[str] = field(default_factory=list[str])
    """Texts that are replaced by an ellipsis wherever they occur; add the token."""


def _check_own(path: Path) -> None:
    """Refuse a file that is no log of Kalscope: it would be appended to, and removed once there are newer ones."""
    if path.is_file():
        with path.open("rb") as file:
            if not _ENTRY.match(file.read(200)):
                raise BadSetting(f"--log must name a new file or a log of Kalscope (got {str(path)!r})")


@contextmanager
def logging_to(file: Path | None = None, *, verbose: bool = False) -> Generator[Log]:
    """Log on standard error, and into `file`, while the block runs.

    Args:
        file: gets everything, with tracebacks; at most `(1 + OLD_FILES) * FILE_BYTES`; None for no file.
        verbose: the terminal shows what happens (who connects, what is refused), not only what went wrong.

    Raises:
        OSError: the file cannot be written.
        BadSetting: the file, or an old one beside it, exists and is not such a log.
    """
    if file is not None:
        for path in (file, *(Path(f"{file}.{number}") for number in range(1, OLD_FILES + 1))):
            _check_own(path)
    log, on_terminal = Log(file), _Terminal(sys.stderr)
    on_terminal.setFormatter(Lines("kalscope: %(message)s", log.hidden, with_traceback=verbose))
    on_terminal.setLevel(logging.INFO if verbose else logging.WARNING)
    if not verbose:  # libraries report each broken request of a port scan as an error, with its traceback
        on_terminal.addFilter(lambda record: record.name.startswith("kalscope"))
    handlers: list[logging.Handler] = [on_terminal]
    if file is not None:
        in_file = _File(file, maxBytes=FILE_BYTES, backupCount=OLD_FILES)
        pattern = "%(asctime)s %(levelname)s %(name)s: %(message)s"
        in_file.setFormatter(Lines(pattern, log.hidden, with_traceback=True))
        handlers.append(in_file)
    root, level = logging.getLogger(), logging.getLogger().level
    for handler in handlers:
        root.addHandler(handler)
    root.setLevel(logging.INFO if file is not None or verbose else logging.WARNING)
    logging.captureWarnings(True)
    try:
        yield log
    finally:
        logging.captureWarnings(False)
        root.setLevel(level)
        for handler in handlers:
            root.removeHandler(handler)
            handler.close()
