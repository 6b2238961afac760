"""The instruments and loggers whose files are read by their own rules."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from kalscope.sources.instruments import loggers, oscilloscopes, physiology
from kalscope.sources.instruments.preface import Preface, plain_head

_INSTRUMENTS: tuple[Callable[[Sequence[str]], Preface | None], ...] = (
    oscilloscopes.recognise_rigol,
    physiology.recognise_empatica,
    loggers.recognise_sample_rate,
)


def find_preface(head: Sequence[str]) -> Preface | None:
    """What the first lines of a file say by the rules of the instrument that wrote it; None where none is known.

    Args:
        head: The first lines of the file, without their newlines.
    """
    plain = plain_head(head)
    found = (recognise(plain.lines) for recognise in _INSTRUMENTS)
    preface = next((preface for preface in found if preface is not None), None)
    if preface is not None:
        return plain.restored(preface)
    return Preface("", delimiter=plain.told, notes=("line 1 names the delimiter",)) if plain.told else None
