"""file:PATH and ssh://host/path: files that grow, and the serial ports and files of another machine.

Nothing is installed there and no port is opened: ssh runs a Python there, which is given `far_side.py` to read.
The address is data all the way: ssh gets a user and, after `--`, a host of few kinds of characters, the other
machine's shell a command that is always the same, and the path goes through standard input. Keys, names and
proxies are those of the user's own ssh settings; there are no prompts, and a host whose key is not known is
refused.
"""

from __future__ import annotations

import json
import re
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import Empty, Queue
from shutil import which
from typing import IO, TYPE_CHECKING, cast
from urllib.parse import unquote

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.port import far_side
from kalscope.sources.port.far_side import DEVICE, MARK, GrowingFile, moved
from kalscope.sources.port.reader import MAX_READ_BYTES, READ_TIMEOUT, OpenPort, quoted, short

if TYPE_CHECKING:
    from kalscope.sources.port.registry import PortSpec

# file:PATH: a file of this computer that another program still writes.


FILE_PREFIX = "file:"
"""How the address of a file that is followed begins."""


class FilePort(GrowingFile, OpenPort):
    """A file that is read as it grows. It continues where the last one ended, or at its beginning if replaced."""

    prefixes = (FILE_PREFIX,)
    keeps = True

    def __init__(self, spec: PortSpec, _is_ended: Callable[[], bool], last: OpenPort | None) -> None:
        """Open the file; see OpenPort."""
        self.device = spec.url[len(FILE_PREFIX) :]
        super().__init__(self.device, last.place if isinstance(last, FilePort) else (0, b""))
        self.starts = "where it stopped" if self.place[0] else "at a line"

    @staticmethod
    def check(address: str) -> object:
        """Refuse an address that names no file; see OpenPort."""
        if not address[len(FILE_PREFIX) :].strip():
            raise BadSetting(f"the address of a file must be {FILE_PREFIX}PATH (got {address!r})")

    def fetch(self) -> bytes:
        """Bytes that were added; see OpenPort."""
        data = self.read()
        if not data:
            time.sleep(READ_TIMEOUT)
        return data


# ssh://host/path.


CONNECT_TIMEOUT = 20.0
"""Seconds within which the other machine must have answered; a Raspberry Pi starts Python in one."""
COMMAND = """exec python3 -I -c 'f=open(0,"rb",0,closefd=0);exec(f.readline())'"""
"""What the login shell of the other machine runs: every shell parses it alike, and nothing is ever inserted."""
_SETTINGS = """
BatchMode=yes StrictHostKeyChecking=yes ConnectTimeout=10 ServerAliveInterval=5 ServerAliveCountMax=3
ControlMaster=no ClearAllForwardings=yes ForwardAgent=no ForwardX11=no PermitLocalCommand=no RemoteCommand=none
"""  # ControlMaster would outlive this program; one that runs already is used
OPTIONS = ("-T", "-enone", *(f"-o{setting}" for setting in _SETTINGS.split()))
_END_S = 0.5
"""Seconds that ssh has to end by itself."""
_CONNECTION_FAILED = 255
"""Exit status of ssh where it is the connection that failed."""
_ADDRESS = re.compile(
    r"ssh://(?:([A-Za-z0-9_][A-Za-z0-9_.-]*)@)?(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9_][A-Za-z0-9_.-]*)(?::([0-9]{1,5}))?(/.+)",
    re.IGNORECASE | re.DOTALL,
)


def ssh_parts(address: str) -> re.Match[str]:
    """The parts of an address: user, host, port and path; raises BadSetting where it is malformed."""
    match = _ADDRESS.fullmatch(address)
    if match is None or not 1 <= int(match[3] or 22) <= 65_535 or not unquote(match[4]).isprintable():
        raise BadSetting(f"an address must be ssh://[user@]host[:port]/path (got {quoted(address)})")
    return match


def ssh_arguments(program: str, address: str) -> list[str]:
    """The command line of ssh."""
    user, host, port, _ = ssh_parts(address).groups()
    options = (["-l", user] if user else []) + (["-p", port] if port else [])
    return [program, *OPTIONS, *options, "--", host.strip("[]"), COMMAND]


def ssh_failure(address: str, status: int, errors: str) -> str:
    """Why ssh ended, with this exit status and this text on its standard error."""
    user, host, _, _ = ssh_parts(address).groups()
    last = short(errors.strip().rpartition("\n")[2]) or f"status {status}"
    if status == 0:
        return f"{address} is gone: the board was unplugged, or the file was replaced"
    if status != _CONNECTION_FAILED:
        return f"{host} cannot read it there: {last} (a port needs your user in the group dialout, and python3)"
    login = f"{user}@{host}" if user else host
    return (
        f"there is no connection to {host} ({last}): does ssh {login} work in a terminal? Compare and accept the"
        f" host key there, and copy your key by ssh-copy-id {login}: no password can be typed here"
    )


class SshPort(OpenPort):
    """A running ssh: a serial port of the other machine, or a file.

    A file continues where the last one ended, or at its beginning if it was replaced.
    """

    prefixes = ("ssh://",)
    has_baud = True
    check = staticmethod(ssh_parts)

    def __init__(self, spec: PortSpec, is_ended: Callable[[], bool], last: OpenPort | None) -> None:
        """Connect; see OpenPort."""
        self._address, program = spec.url, which("ssh")
        if program is None:
            raise BadDevice(f"{spec.url} needs the program ssh, which is not installed on this computer")
        self.place: tuple[int, bytes] = last.place if isinstance(last, SshPort) else (0, b"")
        """Of a file, as in `GrowingFile`."""
        self._alive_at = time.monotonic()
        self._pieces: Queue[bytes] = Queue(64)
        self._unread = b""
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 (until close): a pipe would need a thread of its own
        window = getattr(subprocess, "CREATE_NO_WINDOW", 0) | getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
        pipe = subprocess.PIPE
        self._ssh = subprocess.Popen(
            ssh_arguments(program, spec.url),
            stdin=pipe,
            stdout=pipe,
            stderr=self._errors,
            bufsize=0,
            start_new_session=True,  # this program handles Ctrl+C
            creationflags=window,  # the same on Windows
        )
        self._thread = threading.Thread(target=self._pump, daemon=True)
        self._thread.start()
        try:
            self._send(self._request(spec))
            position = self._answer(is_ended)
        except BaseException:
            self.close()
            raise
        self.keeps = position != DEVICE
        if self.keeps:
            self.starts = "where it stopped" if position else "at a line"
            self.place = position, self.place[1] if position else b""

    def _request(self, spec: PortSpec) -> bytes:
        """The program for the other machine, on one line, and what it is to open."""
        path = unquote(ssh_parts(spec.url)[4])
        path = path[1:] if path.startswith("/~/") else path
        request = {"path": path, "baud": spec.baud, "reset": spec.reset}
        request |= {"position": self.place[0], "before": self.place[1].hex()}
        script = Path(far_side.__file__).read_text(encoding="utf-8")
        return f"exec({script!a})\n{json.dumps(request)}\n".encode("ascii")

    def _answer(self, is_ended: Callable[[], bool]) -> int:
        """The position at which the other machine begins to read, or DEVICE."""
        end, greeting = time.monotonic() + CONNECT_TIMEOUT, b""
        while not is_ended() and time.monotonic() < end and len(greeting) < 1 << 16:
            greeting += self.fetch()
            answer = re.search(re.escape(MARK) + rb"(-?[0-9]{1,18})\n", greeting)
            if answer:
                self._unread = greeting[answer.end() :]
                return int(answer[1])
        raise BadDevice(f"{self._address} did not answer as Python does within {CONNECT_TIMEOUT:g} s")

    def _pump(self) -> None:
        """Queue what ssh sends, and b"" at its end."""
        output, data = cast("IO[bytes]", self._ssh.stdout), b"begin"
        while data:
            data = output.read(MAX_READ_BYTES)
            self._pieces.put(data)

    def _send(self, data: bytes) -> None:
        with suppress(OSError, ValueError):  # ssh has ended: its exit status says why
            cast("IO[bytes]", self._ssh.stdin).write(data)

    def fetch(self) -> bytes:
        """Bytes that have arrived; see OpenPort."""
        now = time.monotonic()
        if now - self._alive_at > far_side.MAX_SILENCE / 5:
            self._alive_at = now
            self._send(b"\0")
        data, self._unread = self._unread, b""
        if not data:
            try:
                data = self._pieces.get(timeout=READ_TIMEOUT)
            except Empty:
                return b""
            if not data:
                raise BadDevice(self._failure())
        if self.keeps:
            self.place = moved(self.place, data)
        return data

    def _failure(self) -> str:
        with suppress(subprocess.TimeoutExpired):
            self._ssh.wait(_END_S)
        status = _CONNECTION_FAILED if self._ssh.returncode is None else self._ssh.returncode
        self._errors.seek(0)
        return ssh_failure(self._address, status, self._errors.read().decode("utf-8", "replace"))

    def write(self, data: bytes) -> None:
        """Send to the board."""
        if self.keeps:
            super().write(data)
        self._send(data)

    def close(self) -> None:
        """End ssh and what it runs on the other machine, which ends with its standard input."""
        with suppress(OSError):
            cast("IO[bytes]", self._ssh.stdin).close()
        self._ssh.kill()
        self._ssh.wait()
        with suppress(Empty):
            while True:  # the thread may wait for room
                self._pieces.get_nowait()
        self._thread.join(_END_S)
        for file in (self._ssh.stdout, self._errors):
            cast("IO[bytes]", file).close()
