"""The instruments and loggers whose files are read by their own rules."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from kalscope.sources.instruments import actigraph, campbell, empatica, openbci, physiology, sample_rate, shimmer
from kalscope.sources.instruments.dialect import plain_head
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
