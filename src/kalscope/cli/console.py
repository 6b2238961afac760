"""What every command shares: messages, exit statuses, standard streams, numbers of options."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import typer

from kalscope.errors import BadSetting, KalscopeError, describe

USER_ERROR = 2
"""Exit status when something the user gave cannot be used; stderr then has one line."""


INTERRUPTED = 130
"""Exit status after Ctrl-C, as a shell counts it."""


LONGEST_LINE = 65_536
"""Bytes of one line on stdin, hundreds of channels; a longer one is no line of numbers."""


def number_option(name: str, text: str) -> Any:
    """An option that takes a number or one special word, parsed by `number_from_option`."""
    return typer.Option(name, metavar="NUMBER", help=text)


def number_from_option(option: str, text: str, word: str | None = None) -> float:
    """The number of an option. Typer's own message does not say what came."""
    try:
        return float(text)
    except ValueError:
        must = "a number" if word is None else f'a number or "{word}"'
        raise BadSetting(f"{option} must be {must} (got {text!r})") from None


def bounded_lines(stream: BinaryIO) -> Iterator[bytes]:
    """The lines of a stream, none longer than LONGEST_LINE."""
    while line := stream.readline(LONGEST_LINE):
        if len(line) < LONGEST_LINE or line.endswith(b"\n"):
            yield line
            continue
        while (rest := stream.readline(LONGEST_LINE)) and not rest.endswith(b"\n"):
            pass
        yield line[:60] + b" and so on"  # the rest was dropped, so it must not read as numbers


def write_output(chunks: Iterator[str], output: Path | None) -> None:
    """Write text to a file, whole or not at all, or to stdout."""
    from kalscope.common.files import atomic_file

    with open_stdout() if output is None else atomic_file(output) as file:
        for chunk in chunks:
            file.write(chunk.encode("utf-8", "replace"))


@contextmanager
def open_stdout() -> Iterator[BinaryIO]:
    """Standard output as bytes (Windows would add carriage returns), quiet when its reader goes away."""
    try:
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
    except OSError as error:
        # What is left in the buffer would raise once more when Python ends, where nobody can catch it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # `kalscope filter … | head` has all it wants
            raise typer.Exit(0) from None
        raise


def say(message: str) -> None:
    """One line on stderr."""
    print(f"kalscope: {' '.join(message.split())}", file=sys.stderr, flush=True)


def user_message(error: Exception) -> str | None:
    """What to tell the user; None for an exception that is not theirs to mend."""
    if isinstance(error, KalscopeError | OSError):
        return describe(error)
    # Typer's usage errors; it brought its own copy of click's classes in 0.2x, the method is common to both.
    usage = getattr(error, "format_message", None)
    return str(usage()) if callable(usage) else None
