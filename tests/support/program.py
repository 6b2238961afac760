"""The real program as a process: start it, read its link, end it."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
import subprocess
import sys
import threading

from tests.support.forked import Forked
from tests.support.waiting import PATIENCE

SCRIPT = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from kalscope.common import stopping
from kalscope_app import main
stopping.MAX_FINISH_S = {patience}
{change}
sys.argv = {argv!r}
main.main()
"""
"""A shell starts its background jobs with SIGINT ignored, and a process inherits that. A busy machine may take long
to finish what a command has to finish: `benchmarks/stopping.py` shows how long."""


@contextlib.contextmanager
def start(folder, *arguments, change="", env=None, source="demo", fresh=False):
    """The program, with `change` (Python) made to it first; it is killed if it still runs when the block ends.

    Its temporary files and its state are in `folder`. It is forked, or with `fresh` started as a user starts it.
    """
    argv = ["kalscope", *(["open", source] if source else []), *arguments]
    (folder / "tmp").mkdir(exist_ok=True)
    own = {"TMPDIR": str(folder / "tmp"), "XDG_STATE_HOME": str(folder / "state")}
    script, env = SCRIPT.format(change=change, argv=argv, patience=PATIENCE), {**os.environ, **own, **(env or {})}
    with (started if fresh else Forked)(script, folder, env) as program:
        try:
            yield program
        finally:
            program.kill()


COMMAND = """
import sys
from kalscope.cli.__main__ import main
sys.argv = {argv!r}
main()
"""


def command(*arguments, cwd=".", change=""):
    """A headless command, forked as `start` does; `change` (Python) is made first."""
    argv = ["kalscope", *map(str, arguments)]
    return Forked(change + COMMAND.format(argv=argv), cwd, os.environ)


def started(script, cwd, env):
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", script], cwd=cwd, env=env, stdout=pipe, stderr=pipe, text=True)


def next_line(program):
    """The next line of its output; a program that says nothing is killed, and the line is empty."""
    watchdog = threading.Timer(PATIENCE, program.kill)
    watchdog.start()
    try:
        return program.stdout.readline()
    finally:
        watchdog.cancel()


def link_of(program):
    """The link that it prints."""
    line = next_line(program)
    assert line.startswith("Kalscope: "), line or program.communicate(timeout=PATIENCE)
    return line.removeprefix("Kalscope: ").strip()


@contextlib.contextmanager
def running(folder, *arguments, **how):
    """The program and the link that it printed."""
    arguments = arguments if "--port" in arguments else (*arguments, "--port", "0")
    if "BROWSER" not in how.get("env", {}):
        arguments = (*arguments, "--no-browser")
    with start(folder, *arguments, **how) as program:
        yield program, link_of(program)


def port_of(url):
    return int(url.split(":")[2].split("/")[0])


def token_of(url):
    return url.partition("token=")[2]


def end(program, by=signal.SIGTERM):
    """Ask it to end; returns its status and further output."""
    program.send_signal(by)
    out, err = program.communicate(timeout=PATIENCE)
    return program.returncode, out, err


def is_free(port):
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", port))
    return True


def free_port(kind=socket.SOCK_STREAM):
    """A port that stays free: below those that the system gives to a program that asks for any."""
    while True:
        port = random.randrange(10_000, 30_000)
        with contextlib.suppress(OSError), socket.socket(socket.AF_INET, kind) as probe:
            probe.bind(("127.0.0.1", port))
            return port


def labels(guest):
    return {made.get("props", {}).get("label") for made in guest.widgets.values()}
