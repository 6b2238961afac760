"""The conversation with a board: one line goes out, the lines with # that come next are its answer."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from kalscope.errors import BadDevice, BadSetting

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from kalscope.sources.lines.line_reader import LineEvent

LONGEST_COMMAND = 63
"""Bytes of one line to the board, newline included: the ring of an AVR that receives them holds 64."""
_REPLY_GOES_ON = 0.05
"""Seconds without another line with # after which an answer is complete."""


class Talk:
    """Asks one thing at a time; `hear` is told of every line that comes."""

    def __init__(self, write: Callable[[bytes], None]) -> None:
        """Args: what sends bytes to the board."""
        self._write = write
        self._one_at_a_time = threading.Lock()
        self._replies: list[str] | None = None  # None while nothing is asked
        self._replied = threading.Condition()

    def ask(self, line: str, timeout: float) -> tuple[str, ...]:
        """Send a line and wait for the answer; arguments and errors as `LiveSource.send`."""
        data = line.encode("utf-8") + b"\n"
        if len(data) > LONGEST_COMMAND or not line.isprintable():
            raise BadSetting(
                f"what is sent must be one line of at most {LONGEST_COMMAND - 1} bytes"
                f" (got {len(data) - 1} in {line[:80]!r})"
            )
        with self._one_at_a_time:
            with self._replied:
                self._replies = []
            try:
                self._write(data)
                return self._answer(timeout)
            finally:
                with self._replied:
                    self._replies = None

    def hear(self, events: Iterable[LineEvent]) -> None:
        """Take the remarks among the lines that came, if an answer is waited for."""
        if self._replies is None:
            return
        found = [event.text for event in events if event.kind == "comment" and event.text.startswith("#")]
        if found:
            with self._replied:
                if self._replies is not None:
                    self._replies += found
                    self._replied.notify_all()

    def _answer(self, timeout: float) -> tuple[str, ...]:
        with self._replied:
            if not self._replied.wait_for(lambda: bool(self._replies), timeout):
                raise BadDevice(
                    f"the board must answer with a line that begins with # (got nothing in {timeout:g} s)"
                )
            known = -1
            while self._replies is not None and len(self._replies) > known:
                known = len(self._replies)
                self._replied.wait(_REPLY_GOES_ON)
            return tuple(self._replies or ())
