"""The real program as a process: start it, read its link, end it."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time

BROKEN = """
import sys
from kalscope_app import main
{change}
sys.argv[1:] = {arguments!r}
main.main()
"""


def start(folder, *arguments, change=None, env=None, source="demo"):
    """The program, with `change` (Python) made to it first; its temporary files and its state lie in `folder`."""
    arguments = ["open", source, *arguments]
    command = [sys.executable, "-m", "kalscope_app.main", *arguments]
    if change is not None:
        command = [sys.executable, "-c", BROKEN.format(change=change, arguments=arguments)]
    (folder / "tmp").mkdir(exist_ok=True)
    own = {"TMPDIR": str(folder / "tmp"), "XDG_STATE_HOME": str(folder / "state")}
    return subprocess.Popen(
        command,
        cwd=folder,
        env={**os.environ, **own, **(env or {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@contextlib.contextmanager
def running(folder, *arguments, **how):
    """The program and the link that it printed."""
    arguments = arguments if "--port" in arguments else (*arguments, "--port", "0")
    if "BROWSER" not in how.get("env", {}):
        arguments = (*arguments, "--no-browser")
    with start(folder, *arguments, **how) as program:
        try:
            yield program, program.stdout.readline().removeprefix("Kalscope: ").strip()
        finally:
            if program.poll() is None:
                program.kill()


def port_of(url):
    return int(url.split(":")[2].split("/")[0])


def token_of(url):
    return url.partition("token=")[2]


def end(program, by=signal.SIGTERM):
    """Ask it to end; returns status, further output, and seconds."""
    begin = time.monotonic()
    program.send_signal(by)
    out, err = program.communicate(timeout=15)
    return program.returncode, out, err, time.monotonic() - begin


def is_free(port):
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", port))
    return True


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


def labels(guest):
    return {made.get("props", {}).get("label") for made in guest.widgets.values()}
