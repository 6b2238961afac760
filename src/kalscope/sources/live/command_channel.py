"""Commands to a board: one line is sent, the lines with # that follow are the reply."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.lines.line_reader import LineEvent

MAX_COMMAND_BYTES = 63
"""Bytes of one line to the board, newline included: the ring of an AVR that receives them holds 64."""
_REPLY_PAUSE = 0.05
"""Seconds without another line with # after which a reply is complete."""


class CommandChannel:
    """Sends one command at a time; `on_events` takes every line that arrives."""

    def __init__(self, write: Callable[[bytes], None]) -> None:
        """Set up the channel; `write` sends bytes to the board."""
        self._write = write
        self._one_at_a_time = threading.Lock()
        self._replies: list[str] = []
        self._is_pending = False
        self._replied = threading.Condition()

    def send(self, line: str, timeout: float) -> tuple[str, ...]:
        """Send a line and wait for the reply; arguments and errors as `LiveSource.send`."""
        data = line.encode("utf-8") + b"\n"
        if len(data) > MAX_COMMAND_BYTES or not line.isprintable():
            raise BadSetting(
                f"what is sent must be one line of at most {MAX_COMMAND_BYTES - 1} bytes"
                f" (got {len(data) - 1} in {line[:80]!r})"
            )
        with self._one_at_a_time:
            with self._replied:
                self._replies.clear()
                self._is_pending = True
            try:
                self._write(data)
                return self._reply(timeout)
            finally:
                self._is_pending = False

    def on_events(self, events: Iterable[LineEvent]) -> None:
        """Collect the comment lines among these while a reply is expected."""
        if not self._is_pending:
            return
        found = [event.text for event in events if event.kind == "comment" and event.text.startswith("#")]
        if found:
            with self._replied:
                self._replies += found
                self._replied.notify_all()

    def _reply(self, timeout: float) -> tuple[str, ...]:
        with self._replied:
            if not self._replied.wait_for(lambda: bool(self._replies), timeout):
                raise BadDevice(f"the board did not answer within {timeout:g} s: is the exported sketch on it?")
            known = 0
            while len(self._replies) > known:
                known = len(self._replies)
                self._replied.wait(_REPLY_PAUSE)
            return tuple(self._replies)
