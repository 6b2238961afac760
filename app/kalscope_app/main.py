"""The program `kalscope`: the headless commands, and `open`, the dashboard."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import threading

from kalscope.cli.app import app, run
from kalscope.cli.console import end_when_interrupted
from kalscope.cli.offers import Function, offers

__all__ = ["app", "main", "run"]


@offers("open", "Open the dashboard in a browser.")
def _open() -> Function:
    from kalscope_app.open_command import open_dashboard

    return open_dashboard


MIN_NEW_OBJECTS = 50_000
"""New objects after which Python looks for garbage, in place of 700: almost all of them stay, and looking for the
others takes a seventh of the time in which `kalscope tune` answers."""


def main() -> None:
    """Entry point: without a command the dashboard opens on the demo recording."""
    gc.set_threshold(MIN_NEW_OBJECTS)
    end_when_interrupted()
    arguments = sys.argv[1:]
    leave(run(arguments or ["open", "demo"]))


def leave(status: int) -> None:
    """End the program, even while something hangs that nothing can interrupt (a device, a network file)."""
    gc.freeze()  # before it drops all objects Python would look for garbage among them: 0.3 s
    if threading.active_count() > 2:  # the main one, and the one that watches for Ctrl+C
        with contextlib.suppress(OSError):  # the terminal is gone
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


if __name__ == "__main__":
    main()
