"""Commands to a board: one line is sent, lines with # that follow are the reply."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from queue import Full, Queue

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.reading.line_reader import LineEvent

MAX_COMMAND_BYTES = 63
"""Bytes of one line to the board, newline included: the receive buffer of an AVR holds 64."""
ANSWER_S = 5.0
"""Seconds within which a board answers."""
_TICK = 0.1
"""Seconds between two checks whether the caller still waits."""
_REPLY_PAUSE = 1.0
"""Seconds without any line after which a reply is complete; the next sample completes it at once."""
_MAX_REPLY_S = 2.0
"""Seconds after which it is taken as complete anyway: a board may send without end."""
_MAX_REMARKS = 1000
"""Remarks that may wait for a listener; further ones are dropped."""


class BoardGone(BadDevice):
    """The board was disconnected or unplugged before it answered."""


@dataclass(frozen=True)
class Remark:
    """A line with # and its place among the samples."""

    text: str
    """The line."""
    row: int
    """Samples that came before it, counted from the first of its generation."""
    generation: int
    """That of `Snapshot.generation`."""


class CommandChannel:
    """Sends one command at a time; `on_events` takes every line that arrives."""

    def __init__(self, write: Callable[[bytes], None]) -> None:
        """Set up the channel; `write` sends bytes to the board."""
        self._write = write
        self._one_at_a_time = threading.Lock()
        self._replies: list[str] = []
        self._is_reply: Callable[[str], bool] | None = None
        self._is_pending = False
        self._is_complete = False  # nothing more can come in reply
        self._replied = threading.Condition()
        self._listeners: tuple[Queue[Remark], ...] = ()

    def send(
        self,
        line: str,
        timeout: float | None = None,
        *,
        is_reply: Callable[[str], bool] | None = None,
        check: Callable[[], object] = bool,
    ) -> tuple[str, ...]:
        """Send a line and wait for the reply.

        Args:
            line: As for `LiveSource.send`, which also says what this returns and raises.
            timeout: Seconds to wait; None = ANSWER_S.
            is_reply: Whether a line with # belongs to the reply; None = every one.
            check: Called while it waits; what it raises ends the wait.
        """
        data = line.encode("utf-8") + b"\n"
        if len(data) > MAX_COMMAND_BYTES or not line.isprintable():
            raise BadSetting(
                f"what is sent must be one line of at most {MAX_COMMAND_BYTES - 1} bytes"
                f" (got {len(data) - 1} in {line[:80]!r})"
            )
        with self._one_at_a_time:
            with self._replied:
                self._replies.clear()
                self._is_reply = is_reply
                self._is_complete = False
                self._is_pending = True
            try:
                self._write(data)
                return self._reply(line, ANSWER_S if timeout is None else timeout, check)
            finally:
                self._is_pending = False

    @contextmanager
    def listen(self) -> Generator[Queue[Remark]]:
        """Every line with # that arrives while the block runs, asked for or not."""
        remarks = Queue[Remark](_MAX_REMARKS)
        self._listeners = (*self._listeners, remarks)
        try:
            yield remarks
        finally:
            self._listeners = tuple(one for one in self._listeners if one is not remarks)

    def on_events(self, events: Iterable[LineEvent], row: int = 0, generation: int = 0) -> None:
        """Collect the comment lines among these while a reply is expected or there is a listener.

        Args:
            events: The lines, in their order.
            row: Samples that came before them.
            generation: Of these samples.
        """
        if not (self._is_pending or self._listeners):
            return
        found: list[Remark] = []
        said: list[str | None] = []  # None for a sample
        for event in events:
            if event.kind == "row":
                row += len(event.rows)
                said.append(None)
            elif event.kind == "comment" and event.text.startswith("#"):
                found.append(Remark(event.text, row, generation))
                said.append(event.text)
        for remark in found:
            for listener in self._listeners:
                with suppress(Full):
                    listener.put_nowait(remark)
        with self._replied:
            if self._is_pending:
                self._collect(said)

    def _collect(self, said: Iterable[str | None]) -> None:
        """Take the reply from remarks and samples, up to the first sample after it."""
        for text in said:
            if self._is_complete:
                return
            if text is None:
                self._is_complete = bool(self._replies)
            elif self._is_reply is None or self._is_reply(text):
                self._replies.append(text)
            else:
                continue
            self._replied.notify_all()

    def on_disconnected(self) -> None:
        """End the wait for a reply that cannot come."""
        with self._replied:
            self._is_complete = True
            self._replied.notify_all()

    def _reply(self, line: str, timeout: float, check: Callable[[], object]) -> tuple[str, ...]:
        end = time.monotonic() + timeout
        while not self._begins_within(min(timeout, _TICK)):
            if time.monotonic() > end:
                raise BadDevice(
                    f"the board did not answer {line!r} within {timeout:g} s: is the exported sketch on it?"
                )
            check()  # without the lock: it may ask for the status, or wait for the terminal
        with self._replied:
            if not self._replies:
                raise BoardGone("the board was disconnected before it answered")
            known, end = 0, time.monotonic() + _MAX_REPLY_S
            while len(self._replies) > known and not self._is_complete and time.monotonic() < end:
                known = len(self._replies)
                self._replied.wait(_REPLY_PAUSE)
            return tuple(self._replies)

    def _begins_within(self, seconds: float) -> bool:
        with self._replied:
            return self._replied.wait_for(lambda: bool(self._replies) or self._is_complete, seconds)
