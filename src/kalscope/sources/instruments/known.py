"""The instruments and loggers whose files are read by their own rules."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from kalscope.sources.instruments.preface import Preface

_INSTRUMENTS: tuple[Callable[[Sequence[str]], Preface | None], ...] = ()


def find_preface(head: Sequence[str]) -> Preface | None:
    """What the first lines of a file say by the rules of the instrument that wrote it; None where none is known.

    Args:
        head: The first lines of the file, without their newlines.
    """
    found = (recognise(head) for recognise in _INSTRUMENTS)
    return next((preface for preface in found if preface is not None), None)
