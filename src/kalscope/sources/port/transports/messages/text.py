"""What whole messages hold, as lines for the line parser: samples of Teleplot, or lines as they are. Opens nothing.

A sender of datagrams leaves out the > with which a line of Teleplot begins on a serial port. Here it is put back,
so that one parser reads both.
"""

from __future__ import annotations

import re

from kalscope.sources.grammar.cells import MISSING, is_number
from kalscope.sources.grammar.line_format import split_teleplot, teleplot_flags

MAX_SHOWN = 200
"""Bytes of a binary message that are passed on, as one line that is then rejected."""

_BINARY = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f\x7f]")
_LINE_END = re.compile(r"[\r\n]+")
_SHAPE = re.compile(r"3D\|[^\s|]")


def is_binary(data: bytes) -> bool:
    """Whether a message holds bytes that no text has."""
    return _BINARY.search(data) is not None


def decoded(data: bytes) -> str:
    """A message as text: UTF-8, or where it is not, Latin-1, as the line parser reads it."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def one_line(data: bytes) -> bytes:
    """The beginning of a message on one line, with a NUL byte by which the parser rejects it, and its newline."""
    return b"\0" + data[:MAX_SHOWN].replace(b"\r", b" ").replace(b"\n", b" ") + b"\n"


def lines_of(data: bytes) -> bytes:
    r"""The lines of one message, each with its \n; b"" for none. A binary one is one line, to be rejected."""
    if is_binary(data):
        return one_line(data)
    lines = [_marked(line) for line in _LINE_END.split(decoded(data)) if line.strip()]
    return "".join(f"{line}\n" for line in lines).encode()


def _marked(line: str) -> str:
    """The line with the > of Teleplot before it, where it is one of Teleplot's and lacks it."""
    if line.lstrip().startswith(">"):
        return line
    marked = ">" + line.lstrip()
    plot = split_teleplot(marked)
    if plot is not None:
        values = [value for _, value in plot.samples]
        is_sample = any(is_number(value) for value in values) or all(value.lower() in MISSING for value in values)
        return line if is_number(plot.name) or not is_sample else marked
    return marked if not {"t", "xy"}.isdisjoint(teleplot_flags(marked)) or _SHAPE.match(line) else line
