"""Settings kept beside the present one: pinned as A, B, C … with a colour, at most eight a channel. Pure."""

from __future__ import annotations

import string
from dataclasses import dataclass
from typing import TYPE_CHECKING

from kalscope.errors import BadSetting

if TYPE_CHECKING:
    from collections.abc import Iterable

    from kalscope.tuning.tuning import ChannelTuning

LIMIT = 8
"""Variants of one channel: more lines than that nobody tells apart."""

LONGEST_NAME = 20
"""Letters of a name that fit into a legend."""

DRAWN_NAMES = frozenset({"now", "raw", "filtered", "truth", "best offline", "board's own", "−2√p", "+2√p"})
"""What the chart and the table call their own lines."""

RGB = tuple[int, int, int]

LIGHT: tuple[RGB, ...] = (
    (51, 34, 136),
    (68, 170, 153),
    (170, 68, 153),
    (140, 140, 40),
    (86, 180, 233),
    (17, 119, 51),
    (136, 34, 85),
    (122, 92, 0),
)
"""Colours on a light ground: the muted scheme of P. Tol, which colour-blind people tell apart, darkened twice."""

DARK: tuple[RGB, ...] = (
    (150, 135, 240),
    (95, 208, 188),
    (224, 127, 208),
    (204, 204, 85),
    (136, 204, 238),
    (79, 183, 106),
    (212, 96, 143),
    (201, 162, 74),
)
"""The same hues on a dark ground."""


@dataclass(frozen=True)
class Variant:
    """A setting of one channel that was pinned."""

    name: str
    """What it is called: a letter, or what the person made of it; distinct among those of its channel."""
    colour: int
    """Number of its colour, 0 … 7."""
    tuning: ChannelTuning
    """The setting; `tuning.name` is the channel it belongs to."""

    def rgb(self, *, dark: bool = False) -> RGB:
        """Its colour in a theme, 0 … 255 each."""
        return (DARK if dark else LIGHT)[self.colour % LIMIT]


def css(rgb: RGB) -> str:
    """A colour as charts and pages take it: #rrggbb."""
    return "#" + "".join(f"{part:02x}" for part in rgb)


def next_name(taken: Iterable[str]) -> str:
    """The first letter that no variant is called; a freed one comes again.

    Raises:
        BadSetting: all 26 are taken.
    """
    used = set(taken)
    for letter in string.ascii_uppercase:
        if letter not in used:
            return letter
    raise BadSetting("a letter from A to Z must be free for another variant (got none)")


def pinned(tuning: ChannelTuning, variants: tuple[Variant, ...]) -> Variant:
    """A new variant of a channel that has `variants` already.

    Raises:
        BadSetting: there are as many as can be told apart.
    """
    if len(variants) >= LIMIT:
        raise BadSetting(f"a channel must have at most {LIMIT} pinned settings: delete one first (got {LIMIT})")
    used = {variant.colour for variant in variants}
    colour = next(number for number in range(LIMIT) if number not in used)
    return Variant(next_name(variant.name for variant in variants), colour, tuning)


def checked_name(name: str, others: Iterable[str]) -> str:
    """A name as it is kept, without blanks around it.

    Raises:
        BadSetting: it is empty, too long, not printable, that of a line drawn anyway, or one of the others'.
    """
    bare = " ".join(name.split())
    if not bare or len(bare) > LONGEST_NAME or not bare.isprintable():
        raise BadSetting(f"a variant's name must have 1 to {LONGEST_NAME} letters (got {name[:40]!r})")
    if bare in DRAWN_NAMES:
        raise BadSetting(f"a variant's name must not be one of the chart's own lines (got {bare!r})")
    if bare in set(others):
        raise BadSetting(f"a variant's name must be a new one (got {bare!r}, which another has)")
    return bare
