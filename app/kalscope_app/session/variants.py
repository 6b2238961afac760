"""Settings kept beside the current one: pinned as A, B, C … with a colour, at most eight a channel."""

from __future__ import annotations

import string
from collections.abc import Iterable
from dataclasses import dataclass

from kalscope.errors import BadSetting
from kalscope.tuning.tuning import ChannelTuning

MAX_VARIANTS = 8
"""Variants of one channel: more lines cannot be told apart."""

MAX_NAME_LENGTH = 20
"""Characters of a name that fit into a legend."""

DRAWN_NAMES = frozenset({"now", "raw", "filtered", "truth", "smoother", "board's filter", "−2√p", "+2√p"})
"""What the chart and the table call their own lines."""

LIGHT = ("#332288", "#41a392", "#aa4499", "#8c8c28", "#1e9be2", "#117733", "#882255", "#7a5c00")
"""Colours on a light background: the muted scheme of P. Tol, which colour-blind people can distinguish, four of
them darkened."""

DARK = ("#9687f0", "#5fd0bc", "#e07fd0", "#cccc55", "#88ccee", "#4fb76a", "#d4608f", "#c9a24a")
"""The same hues on a dark background."""


@dataclass(frozen=True)
class Variant:
    """A setting of one channel that was pinned."""

    name: str
    """What it is called: a letter, or the name that the user gave it; distinct among those of its channel."""
    colour: int
    """Number of its colour, 0 … 7."""
    tuning: ChannelTuning
    """The setting; `tuning.name` is the channel it belongs to."""

    def css(self, *, dark: bool = False) -> str:
        """Its colour in a theme, #rrggbb."""
        return (DARK if dark else LIGHT)[self.colour % MAX_VARIANTS]


def next_name(taken: Iterable[str]) -> str:
    """The first letter that no variant has; a freed letter is used again.

    Raises:
        BadSetting: all 26 are taken.
    """
    used = set(taken)
    for letter in string.ascii_uppercase:
        if letter not in used:
            return letter
    raise BadSetting("all letters from A to Z name pinned settings: delete one first")


def pinned(tuning: ChannelTuning, variants: tuple[Variant, ...]) -> Variant:
    """A new variant of a channel that has `variants` already.

    Raises:
        BadSetting: there are as many as can be told apart.
    """
    if len(variants) >= MAX_VARIANTS:
        raise BadSetting(
            f"a channel must have at most {MAX_VARIANTS} pinned settings: delete one first (got {MAX_VARIANTS})"
        )
    used = {variant.colour for variant in variants}
    colour = next(number for number in range(MAX_VARIANTS) if number not in used)
    return Variant(next_name(variant.name for variant in variants), colour, tuning)


def checked_name(name: str, others: Iterable[str]) -> str:
    """A name as it is kept, without blanks around it.

    Raises:
        BadSetting: it is empty, too long, not printable, that of another line of the chart, or one of the others'.
    """
    bare = " ".join(name.split())
    if not bare or len(bare) > MAX_NAME_LENGTH or not bare.isprintable():
        raise BadSetting(f"the name must have 1 to {MAX_NAME_LENGTH} characters (got {name[:40]!r})")
    if bare in DRAWN_NAMES:
        raise BadSetting(f"the name must differ from those of the lines in the chart (got {bare!r})")
    if bare in set(others):
        raise BadSetting(f"the name must be new (got {bare!r}, which another pinned setting has)")
    return bare
