"""The programs that `slider_budget.py` watches, each with a clock at every step of a slider move.

    python benchmarks/budget_server.py kalscope|viser MARKS SOURCE [options of `kalscope open`]

When it ends it writes to MARKS what happened when: [seconds since 1970, name, bytes].
"""

from __future__ import annotations

import functools
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import viser.infra._infra as viser_infra
from peer_servers import serve_viser
from viser.infra import _messages
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.asyncio.server import ServerConnection

MARKS: list[tuple[float, str, int]] = []


def mark(name: str, size: int = 0) -> None:
    MARKS.append((time.time(), name, size))


def marked(owner: Any, name: str, before: str = "", after: str = "") -> None:
    """Set a mark before and after each call of a function of `owner`."""
    function: Callable[..., Any] = getattr(owner, name)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        if before:
            mark(before)
        try:
            return function(*args, **kwargs)
        finally:
            if after:
                mark(after)

    setattr(owner, name, call)


def watch_viser() -> None:
    """Mark what comes from the browser, the arrays of each chart, and what goes to the browser."""
    marked(viser_infra.WebsockMessageHandler, "_handle_incoming_message", before="handled")
    marked(_messages.Message, "as_serializable_dict", before="taken")
    push, send = AsyncMessageBuffer.push, ServerConnection.send

    def push_and_mark(buffer: AsyncMessageBuffer, message: Any) -> None:
        data = getattr(message, "updates", {}).get("data", ())
        if isinstance(data, tuple):
            size = sum(one.nbytes for one in data if isinstance(one, np.ndarray))
            mark(f"pushed {message.uuid}" if size else "push", size)
        push(buffer, message)

    async def send_and_mark(connection: ServerConnection, message: Any, *rest: Any) -> None:
        mark("sending", len(message))
        await send(connection, message, *rest)

    for owner, name, watched in (
        (AsyncMessageBuffer, "push", push_and_mark),
        (ServerConnection, "send", send_and_mark),
    ):
        setattr(owner, name, watched)


def serve_kalscope(arguments: list[str]) -> None:
    from kalscope.cli.app import run
    from kalscope_app.engine import engine
    from kalscope_app.guard.messages import MessageFilter
    from kalscope_app.main import add_dashboard
    from kalscope_app.session.session import Session

    marked(MessageFilter, "_dispatch", before="arrived")
    marked(Session, "request", before="requested")
    marked(Session, "apply_requests", before="turn", after="applied")
    marked(engine, "compute_frame", after="computed")
    add_dashboard()
    run(["open", *arguments])


def serve_bare(source: str) -> None:
    """Bare viser with the same two lines of as many points, and a slider that filters."""
    marked(viser_infra.WebsockMessageHandler, "_handle_incoming_message", before="arrived")  # no guard
    serve_viser(source, mark)


def main() -> None:
    kind, marks, source, *options = sys.argv[1:]
    watch_viser()
    if kind == "viser":
        serve_bare(source)
    else:
        serve_kalscope([source, *options])
    Path(marks).write_text(json.dumps(MARKS), encoding="utf-8")
    os._exit(0)


if __name__ == "__main__":
    main()
