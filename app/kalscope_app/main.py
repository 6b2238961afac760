"""The program `kalscope`. It can be stopped before it imports anything that takes long."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
import threading
import warnings
from contextlib import suppress

MIN_NEW_OBJECTS = 300_000
"""New objects after which Python collects garbage, in place of 700: almost all of them stay in use, and collecting
the others takes a seventh of the run time of `kalscope tune`."""


def main() -> None:
    """Entry point: without a command the dashboard opens on the demo recording."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # until more is imported Ctrl+C shows no traceback
    gc.set_threshold(MIN_NEW_OBJECTS)
    from kalscope.common.stopping import ended_by_signals

    with ended_by_signals():
        from kalscope.cli.app import run
        from kalscope.cli.console import plain_diagnostics

        add_dashboard()
        plain_diagnostics()
        warnings.simplefilter("ignore", RuntimeWarning)  # of numpy: what overflows is refused or reported in words
        status = run(sys.argv[1:] or ["open"])
    leave(status)


def add_dashboard() -> None:
    """Add `open` to the commands."""
    from kalscope.cli.app import COMMANDS

    COMMANDS["open"] = ("Open the dashboard in a browser.", "kalscope_app.open_command:open_dashboard")


def leave(status: int) -> None:
    """End the program, even while something hangs that nothing can interrupt (a device, a network file).

    A normal exit of Python would first collect garbage among all objects, for 0.3 s.
    """
    if threading.active_count() <= 2:  # the main one, and the one that watches for signals: nothing hangs
        atexit._run_exitfuncs()  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
    with suppress(OSError):  # the terminal is gone
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(status)


if __name__ == "__main__":
    main()
