"""A running ssh, and how it is called."""

from __future__ import annotations

import subprocess
import sys
import threading
from contextlib import suppress
from queue import Empty, Full, Queue
from typing import IO, Any, cast

from kalscope.errors import BadDevice
from kalscope.sources.port.transports.limits import MAX_READ_BYTES, READ_TIMEOUT
from kalscope.sources.port.transports.words import short

_MAX_WAITING = 64
"""Pieces of at most MAX_READ_BYTES that wait to be fetched."""
_MAX_ERRORS = 4096
_END_S = 0.5
"""Seconds that ssh has to end by itself."""

COMMAND = """exec python3 -I -c 'f=open(0,"rb",0,closefd=0);exec(f.readline())'"""
"""What the login shell of the other machine runs: every shell parses it alike, and nothing is ever inserted."""
OPTIONS = (
    "-T",
    *("-e", "none"),
    *("-o", "BatchMode=yes"),
    *("-o", "StrictHostKeyChecking=yes"),
    *("-o", "ConnectTimeout=10"),
    *("-o", "ServerAliveInterval=5"),
    *("-o", "ServerAliveCountMax=3"),
    *("-o", "ControlMaster=no"),  # it would outlive this program; one that runs already is used
    *("-o", "ClearAllForwardings=yes"),
    *("-o", "ForwardAgent=no"),
    *("-o", "ForwardX11=no"),
    *("-o", "PermitLocalCommand=no"),
    *("-o", "RemoteCommand=none"),
)


class SshLink:
    """A running ssh: bytes out of it and into it, neither of which ever waits. Works on Windows, too."""

    def __init__(self, arguments: list[str], first: bytes) -> None:
        """Start it and give it its first bytes."""
        # A process group of its own: this program handles Ctrl+C.
        alone: dict[str, Any] = {"start_new_session": True}
        if sys.platform == "win32":
            alone = {"creationflags": subprocess.CREATE_NO_WINDOW | subprocess.CREATE_NEW_PROCESS_GROUP}
        pipe = subprocess.PIPE
        try:
            self._ssh = subprocess.Popen(arguments, stdin=pipe, stdout=pipe, stderr=pipe, bufsize=0, **alone)
        except OSError as error:
            raise BadDevice(f"the program ssh does not start ({short(str(error))})") from error
        self._input = cast("IO[bytes]", self._ssh.stdin)  # a pipe, because one was asked for
        self._pieces: Queue[bytes] = Queue(_MAX_WAITING)
        self._unread = b""
        self._errors = b""
        self._closed = threading.Event()
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._pump, self._note)]
        for thread in self._threads:
            thread.start()
        self.send(first)

    def fetch(self) -> bytes | None:
        """Bytes that have arrived; b"" after READ_TIMEOUT without any; None after the last."""
        if self._unread:
            data, self._unread = self._unread[:MAX_READ_BYTES], self._unread[MAX_READ_BYTES:]
            return data
        try:
            data = self._pieces.get(timeout=READ_TIMEOUT)
        except Empty:
            return b""
        if not data:
            self._pieces.put(b"")  # the end marker stays at the end
            return None
        return data

    def unread(self, data: bytes) -> None:
        """Put bytes back before all others."""
        self._unread = data + self._unread

    def waiting(self) -> int:
        """About how many bytes wait."""
        return len(self._unread) + self._pieces.qsize()

    def send(self, data: bytes) -> None:
        """Give bytes to ssh; those that it no longer accepts are lost."""
        with suppress(OSError, ValueError):
            self._input.write(data)

    def status(self) -> int:
        """The exit status of an ssh that has closed its output."""
        try:
            return self._ssh.wait(_END_S)
        except subprocess.TimeoutExpired:
            return -1

    def errors(self) -> str:
        """What ssh and the other machine wrote to standard error."""
        self._threads[1].join(_END_S)
        return self._errors.decode("utf-8", "replace").strip()

    def close(self) -> None:
        """End ssh and what it runs on the other machine, which ends with its standard input."""
        self._closed.set()
        ssh = self._ssh
        with suppress(OSError):
            self._input.close()
        ssh.terminate()
        try:
            ssh.wait(_END_S)
        except subprocess.TimeoutExpired:
            ssh.kill()
            ssh.wait()
        for thread in self._threads:
            thread.join(_END_S)
        for stream in (ssh.stdout, ssh.stderr):
            if stream is not None:
                stream.close()

    def _pump(self) -> None:
        data = b"begin"
        while data and not self._closed.is_set():
            data = self._read(self._ssh.stdout, MAX_READ_BYTES)
            while not self._closed.is_set():
                with suppress(Full):
                    self._pieces.put(data, timeout=READ_TIMEOUT)
                    break

    def _note(self) -> None:
        while data := self._read(self._ssh.stderr, 1024):
            self._errors = (self._errors + data)[-_MAX_ERRORS:]

    @staticmethod
    def _read(stream: Any, size: int) -> bytes:
        try:
            return stream.read(size) or b""
        except (OSError, ValueError):
            return b""
