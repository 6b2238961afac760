"""The instruments and loggers whose files are read by their own rules."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from kalscope.sources.instruments import actigraph, campbell, empatica, openbci, physiology, sample_rate, shimmer
from kalscope.sources.instruments.dialect import dialect_of
from kalscope.sources.instruments.metadata import MAX_LINES
from kalscope.sources.instruments.oscilloscopes import keysight, others, rigol, siglent, tektronix
from kalscope.sources.instruments.preface import Preface

_INSTRUMENTS: tuple[Callable[[Sequence[str]], Preface | None], ...] = (
    campbell.recognise,
    openbci.recognise,
    physiology.recognise,
    actigraph.recognise,
    rigol.recognise,
    tektronix.recognise,
    keysight.recognise,
    siglent.recognise,
    others.recognise,
    empatica.recognise,
    shimmer.recognise,
    sample_rate.recognise,
)
_MAX_LENGTH = 1 << 14
"""No instrument writes a longer line above its samples; a table so wide is none."""
_DELIMITERS = {",": ",", ";": ";", "\t": "\t", "\\t": "\t", "|": "|", "": "\t"}


def find_preface(head: Sequence[str]) -> Preface | None:
    """What the first lines of a file say by the rules of the instrument that wrote it; None where none is known.

    Args:
        head: The first lines of the file, without their newlines.
    """
    if not head:
        return None
    lines = [line[:_MAX_LENGTH] for line in head[:MAX_LINES]]
    lines[0] = lines[0].removeprefix("\ufeff")
    delimiter = _separator_line(lines[0])
    if delimiter is not None:
        lines[0] = ""  # the line numbers stay
    dialect = dialect_of(lines[1:] if delimiter is not None else lines)
    plain = dialect.plain(lines)
    found = (recognise(plain) for recognise in _INSTRUMENTS)
    preface = next((dialect.restored(preface) for preface in found if preface is not None), None)
    if delimiter is None:
        return preface
    if preface is None:
        return Preface("", delimiter=delimiter, notes=("line 1 names the delimiter",))
    return preface if preface.delimiter else replace(preface, delimiter=delimiter)


def _separator_line(line: str) -> str | None:
    """The delimiter that a first line `sep=;` tells Excel; None for any other line."""
    text = line[:12].strip(' "\r').lower() if len(line) < 12 else ""
    return _DELIMITERS.get(text[4:]) if text.startswith("sep=") else None
