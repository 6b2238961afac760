"""Lines that differ in their digits only: the first few of each shape are judged for all of them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

ANY_DIGIT = str.maketrans("123456789", "000000000")
"""Makes a shape of a text: each digit becomes 0."""
_MAX_SHAPES = 64
"""With more shapes, those that differ only in the lengths of their numbers become one."""
_MAX_OF_SHAPE = 4
"""Lines by which all of one shape are judged: 0,123 and 1,234 may be read differently."""
_NUMBER = re.compile("00+")


class HeadLine(NamedTuple):
    """One line that may hold data; thousands are made for each file, and a dataclass is slow to make."""

    number: int
    """Line number, from 1; beyond the head for lines from further down the file."""
    text: str
    """The line without stamp and checksum."""
    stamp: str = ""
    """The stamp that a monitor wrote before it; "" where there is none."""
    shape: str = ""
    """What is the same in all lines that differ in their digits only: the text with 0 for each, or for each run."""


def shaped(lines: Sequence[HeadLine]) -> list[HeadLine]:
    """The lines with their shapes."""
    shapes = [line.text.translate(ANY_DIGIT) for line in lines]
    exact = set(shapes)
    if len(exact) > _MAX_SHAPES:
        coarse = {shape: _NUMBER.sub("0", shape) for shape in exact}
        shapes = [coarse[shape] for shape in shapes]
    return [HeadLine(line.number, line.text, line.stamp, shape) for line, shape in zip(lines, shapes, strict=True)]


def first_of_each_shape(lines: Iterable[HeadLine]) -> dict[str, Sequence[str]]:
    """The texts of the first few lines of each shape."""
    found: dict[str, list[str]] = {}
    for line in lines:
        texts = found.get(line.shape)
        if texts is None:
            found[line.shape] = [line.text]
        elif len(texts) < _MAX_OF_SHAPE:
            texts.append(line.text)
    return {shape: tuple(texts) for shape, texts in found.items()}
