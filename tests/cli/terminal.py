"""A name for a pseudo-terminal that no other one can get."""

import tempfile
from pathlib import Path


def link_to(terminal: str) -> Path:
    """A link to /dev/pts/N in a folder of its own; unlink it before the terminal is closed.

    The system gives the number N to the next terminal at once, and what waits for the old one would open that.
    """
    link = Path(tempfile.mkdtemp(prefix="tty")) / "tty"
    link.symlink_to(terminal)
    return link
