"""Programs that are forked off one that has imported them: a start costs hundredths of a second, not two seconds.

A fork server for each test process imports the program once and runs what every dashboard runs; it has no threads.
Each program is then a process of its own, as one from `subprocess.Popen`, with its own arguments, folder,
environment and pipes. What only a true start can show asks for one by `program.start(..., fresh=True)`.
"""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from types import ModuleType

import pytest


@cache
def fork_server():
    """The context whose processes are forked off a server that has imported `warm_program`."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.support.warm_program", __name__])
    with pytest.MonkeyPatch.context() as patch:  # Python 3.11's server looks for what it preloads only there
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
        multiprocessing.forkserver.ensure_running()
    return context


class Forked:
    """What tests use of `Popen`, for `python -c script` in a forked process; a block's end kills it."""

    def __init__(self, script: str, cwd: Path, env: Mapping[str, str]) -> None:
        context = fork_server()
        out, err = (context.Pipe(duplex=False) for _ in range(2))
        self._process = context.Process(target=run, args=(script, str(cwd), dict(env), out[1], err[1]))
        self._process.start()
        self.pid = self._process.pid
        self.stdout, self.stderr = (os.fdopen(os.dup(pipe[0].fileno()), encoding="utf-8") for pipe in (out, err))
        for end in (*out, *err):
            end.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.kill()
        self.stdout.close()
        self.stderr.close()
        self._process.join()

    @property
    def returncode(self):
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        if self._process.is_alive():
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self.returncode is None:
            raise subprocess.TimeoutExpired("the program", timeout)
        return self.returncode

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """All further output, and wait for the end."""
        with concurrent.futures.ThreadPoolExecutor(2) as readers:
            said = [readers.submit(pipe.read) for pipe in (self.stdout, self.stderr)]
            if concurrent.futures.wait(said, timeout).not_done:
                self.kill()
                raise subprocess.TimeoutExpired("the program", timeout)
            self.wait(timeout)
            return said[0].result(), said[1].result()


def run(script: str, cwd: str, env: dict[str, str], out: Connection, err: Connection) -> None:
    """In the forked process: become what `python -c script` is in this folder and environment."""
    for number, pipe in ((1, out), (2, err)):
        os.dup2(pipe.fileno(), number)
        pipe.close()
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115  # those of the server cannot seek
    sys.stderr = open(2, "w", buffering=1, encoding="utf-8", closefd=False)  # noqa: SIM115
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(env)
    tempfile.tempdir = None  # TMPDIR counts again
    main = sys.modules["__main__"] = ModuleType("__main__")  # what it starts itself imports no pytest
    exec(compile(script, "<string>", "exec"), vars(main))
