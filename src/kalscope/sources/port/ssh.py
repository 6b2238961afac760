"""ssh://host/path: how ssh is called, and the port or the file that is open on the other machine."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from queue import Empty, Full, Queue
from shutil import which
from typing import IO, Any, Protocol, cast
from urllib.parse import unquote

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.port import far_side, growing_file
from kalscope.sources.port.transport import (
    MAX_READ_BYTES,
    READ_TIMEOUT,
    Endpoint,
    OpenPort,
    Transport,
    quoted,
    short,
)

# Errors of ssh and of the other machine, each as one sentence that says what to do.


_CONNECTION_FAILED = 255
"""Exit status of ssh where it is the connection that failed."""
_NOT_FOUND = 127


class Address(Protocol):
    """The parts of an address that messages name."""

    host: str
    device: str

    @property
    def login(self) -> str:
        """What is typed after ssh."""
        ...


def failure_words(address: Address, status: int, said: str) -> str:
    """Why ssh ended.

    Args:
        address: The address that was to be opened.
        status: Its exit status.
        said: What it wrote to standard error.
    """
    host, login = address.host, address.login
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    last = short(lines[-1]) if lines else f"status {status}"
    if status != _CONNECTION_FAILED:
        if status == _NOT_FOUND or re.search("python3: (command )?not found", said, re.IGNORECASE):
            return f"{host} has no python3, which reads the port there: sudo apt install python3"
        gone = f"{address.device} is gone: the board was unplugged, or the file was replaced"
        return f"ssh to {host} ended ({last})" if status else gone
    known = {
        "IDENTIFICATION HAS CHANGED": f"{host} shows another host key than the one that ssh knows: if it was set up"
        f" again, ssh-keygen -R {host}, else somebody may be listening",
        "Host key verification failed": f"the host key of {host} is not known here: run ssh {login} once and"
        " compare its fingerprint",
        "Permission denied": f"{host} accepts none of your keys, and a password cannot be asked for here: run"
        f" ssh-copy-id {login} once",
    }
    silent = ("ssh: connect to", "Could not resolve", "banner exchange", "kex_exchange")
    otherwise = f"{host} does not answer ({last})" if any(words in said for words in silent) else ""
    found = (words for mark, words in known.items() if mark in said)
    return next(found, otherwise or f"the connection to {host} was cut ({last})")


def refusal_words(why: str, path: str, host: str) -> str:
    """Why the other machine did not open a path; `why` as `growing_file.Unusable` has it."""
    words = {
        "missing": f"there is no {path} on {host}",
        "denied": f"no permission to open {path} on {host} (for a port, there: sudo usermod -aG dialout $USER)",
        "busy": f"{path} is in use by another program on {host}",
        "no port": f"{path} on {host} is not a serial port",
        "irregular": f"{path} on {host} is neither a serial port nor a file",
    }
    return words.get(why, f"{path} cannot be opened on {host} ({short(why)})")


# A running ssh, and how it is called.


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


# ssh://host/path: what it names, and the port or the file that is open.
#
# Nothing is installed there and no port is opened: ssh runs a Python there, which is given `far_side.py` to read.
# The address is data all the way: ssh gets a user and, after `--`, a host of few kinds of characters, the other
# machine's shell a command that is always the same, and the path goes through standard input. Keys, names and
# proxies are those of the user's own ssh settings; there are no prompts, and a host whose key is not known is
# refused.


CONNECT_TIMEOUT = 20.0
"""Seconds within which the other machine must have answered; a Raspberry Pi starts Python in one."""
_ALIVE_EVERY = 3.0
"""Seconds between two keep-alive lines; far_side.MAX_SILENCE is five times as long."""
_MAX_GREETING = 1 << 16
"""Bytes that a login shell may print before the first answer."""
_ADDRESS = re.compile(
    r"ssh://(?:([A-Za-z0-9_][A-Za-z0-9_.-]*)@)?(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9_][A-Za-z0-9_.-]*)(?::([0-9]{1,5}))?(/.+)",
    re.IGNORECASE | re.DOTALL,
)


def _matched(address: str) -> re.Match[str]:
    """The parts of an address: user, host, port and path; raises BadSetting where it is malformed."""
    match = _ADDRESS.fullmatch(address)
    if match is None:
        raise BadSetting(
            "an address must be ssh://host/path, ssh://user@host:port/path, with letters, digits and . _ - in"
            f" user and host (got {quoted(address)})"
        )
    if match[3] and not 1 <= int(match[3]) <= 65_535:
        raise BadSetting(
            f"the port of an ssh address must be from 1 to 65535 (got {match[3]} in {quoted(address)})"
        )
    if any(character < " " or character == "\x7f" for character in unquote(match[4])):
        raise BadSetting(f"the path of an ssh address must have no control characters (got {quoted(address)})")
    return match


class SshEndpoint(Endpoint):
    """A path of another machine. A file continues where the last opening left it."""

    def __init__(self, address: str, baud: int, reset: bool) -> None:
        """Args: as PortSpec; raises BadSetting as `_matched`."""
        match = _matched(address)
        self.device = address
        self.user, self.host, self.port = match[1] or "", match[2].strip("[]"), match[3] or ""
        path = unquote(match[4])
        self.path = path[1:] if path.startswith("/~/") else path
        self._baud, self._reset = baud, reset
        self.position, self.before = 0, b""
        self._opened = False

    @property
    def login(self) -> str:
        """The other machine as it is typed after ssh."""
        port = f"-p {self.port} " if self.port else ""
        return f"{port}{self.user}@{self.host}" if self.user else f"{port}{self.host}"

    def arguments(self, program: str) -> list[str]:
        """The command line of ssh."""
        user = ["-l", self.user] if self.user else []
        port = ["-p", self.port] if self.port else []
        return [program, *OPTIONS, *user, *port, "--", self.host, COMMAND]

    def request(self) -> bytes:
        """What is to be opened, for `far_side.py`."""
        fields = {"path": self.path, "baud": self._baud, "reset": self._reset}
        place = {"position": self.position, "before": self.before.hex()}
        return json.dumps(fields | place).encode("ascii") + b"\n"

    def open(self, is_ended: Callable[[], bool]) -> OpenPort:
        """Connect; see Endpoint."""
        program = which("ssh")
        if program is None:
            raise BadDevice(f"{self.device} needs the program ssh, which is not installed on this computer")
        link = SshLink(self.arguments(program), _program() + self.request())
        try:
            answer = self._answer(link, is_ended)
            if "error" in answer:
                raise BadDevice(refusal_words(str(answer["error"]), self.path, self.host))
            if answer.get("kind") == "device":
                return SshDevice(self, link)
            resumed = self._opened and answer["position"] == self.position
            self.position = answer["position"]
            self.before = self.before if self.position else b""  # of a file that is gone
            self._opened = True
            return SshFile(self, link, resumed=resumed)
        except BaseException:
            link.close()
            raise

    def _answer(self, link: SshLink, is_ended: Callable[[], bool]) -> dict[str, Any]:
        """The first answer of the other machine."""
        end, greeting = time.monotonic() + CONNECT_TIMEOUT, b""
        while not is_ended():
            data = link.fetch()
            if data is None:
                raise BadDevice(self.failure(link, greeting))
            greeting += data
            _, mark, rest = greeting.partition(far_side.MARK)
            answer, newline, surplus = rest.partition(b"\n")
            if mark and newline:
                link.unread(surplus)
                return self._checked(answer)
            if len(greeting) > _MAX_GREETING:
                raise BadDevice(self._no_answer)
            if time.monotonic() > end:
                raise BadDevice(f"{self.host} let ssh in, but did not answer within {CONNECT_TIMEOUT:g} s")
        raise BadDevice(f"{self.device} was closed before it had opened")

    def _checked(self, answer: bytes) -> dict[str, Any]:
        with suppress(ValueError, RecursionError):  # deep brackets
            found = json.loads(answer)
            if isinstance(found, dict):
                fields = cast("dict[str, Any]", found)
                is_place = type(fields.get("position")) is int
                if is_place or "error" in fields or fields.get("kind") == "device":
                    return fields
        raise BadDevice(self._no_answer)

    @property
    def _no_answer(self) -> str:
        return f"{self.host} sends something other than the answer of Python"

    def failure(self, link: SshLink, greeting: bytes = b"") -> str:
        """Why ssh ended without the port."""
        return failure_words(self, link.status(), link.errors() or greeting.decode("utf-8", "replace"))


class SshDevice(OpenPort):
    """A serial port of the other machine."""

    def __init__(self, endpoint: SshEndpoint, link: SshLink) -> None:
        """Args: the address; its ssh."""
        self._endpoint, self._link = endpoint, link
        self._alive_at = time.monotonic()

    def fetch(self) -> bytes:
        """Bytes that have arrived; see OpenPort."""
        now = time.monotonic()
        if now - self._alive_at > _ALIVE_EVERY:
            self._alive_at = now
            self._link.send(b"\n")
        data = self._link.fetch()
        if data is None:
            raise BadDevice(self._endpoint.failure(self._link))
        return data

    def waiting(self) -> int:
        """Pieces that wait."""
        return self._link.waiting()

    def write(self, data: bytes) -> None:
        """Send to the board."""
        self._link.send(data.hex().encode("ascii") + b"\n")

    def close(self) -> None:
        """End ssh."""
        self._link.close()


class SshFile(SshDevice):
    """A file of the other machine, line by line; nothing can be written to it."""

    keeps = True

    def __init__(self, endpoint: SshEndpoint, link: SshLink, *, resumed: bool) -> None:
        """Args: the address; its ssh; whether it continues where the last opening ended."""
        super().__init__(endpoint, link)
        self.starts = "where it stopped" if resumed else "at a line"
        self._rest = b""

    def fetch(self) -> bytes:
        """Whole lines that have arrived: half of one would arrive twice after a disconnect."""
        data = self._rest + super().fetch()
        end = max(data.rfind(b"\n"), data.rfind(b"\r")) + 1
        if not end and len(data) > growing_file.MAX_PIECE:
            end = len(data)
        lines, self._rest = data[:end], data[end:]
        self._endpoint.position += end
        self._endpoint.before = (self._endpoint.before + lines)[-growing_file.MAX_BEFORE :]
        return lines

    write = OpenPort.write


@cache
def _program() -> bytes:
    """One line of Python that runs `far_side.py` where there is no Kalscope."""
    inner = Path(growing_file.__file__).read_text(encoding="utf-8")
    outer = Path(far_side.__file__).read_text(encoding="utf-8")
    text = (
        "import sys, types\n"
        f"module = sys.modules[{growing_file.__name__!r}] = types.ModuleType('growing_file')\n"
        f"exec({inner!a}, module.__dict__)\n"
        f"exec({outer!a})\n"
    )
    return f"exec({text!a})\n".encode("ascii")


SSH = Transport(("ssh://",), "ssh://host/dev/ttyACM0@115200", _matched, SshEndpoint, has_baud=True)
"""A port or a file of another machine."""
