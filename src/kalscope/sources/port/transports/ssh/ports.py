"""ssh://host/path: what it names, and the port or the file that is open.

Nothing is installed there and no port is opened: ssh runs a Python there, which is given `far_side.py` to read. The
address is data all the way: ssh gets a user and, after `--`, a host of few kinds of characters, the other machine's
shell a command that is always the same, and the path goes through standard input. Keys, names and proxies are
those of the user's own ssh settings; there are no prompts, and a host whose key is not known is refused.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from shutil import which
from typing import Any, cast
from urllib.parse import unquote

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.port.transports import growing_file
from kalscope.sources.port.transports.ssh import far_side
from kalscope.sources.port.transports.ssh.link import COMMAND, OPTIONS, SshLink
from kalscope.sources.port.transports.ssh.words import failure_words, refusal_words
from kalscope.sources.port.transports.transport import Endpoint, OpenPort, Transport
from kalscope.sources.port.transports.words import quoted

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
