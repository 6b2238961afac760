"""Names and numbers from outside, made harmless for source code and configuration files.

A channel may be called "*/ #define PWN 1". What a target writes as code is an identifier of this module, what
it writes into a comment went through `comment_text`; no other part of a name is written.
"""

from __future__ import annotations

import keyword
import re
import unicodedata
from collections.abc import Iterable

MAX_IDENTIFIER_LENGTH = 32
"""Longest identifier: C99 promises 31 significant characters and more, MATLAB 63."""
MAX_COMMENT_LENGTH = 60
"""Longest piece of a comment that comes from outside, characters."""

_SPELT = {
    "\u03bc": "u",
    "\u00b5": "u",
    "\u03a9": "Ohm",
    "\u2126": "Ohm",
    "°": "deg",
    "²": "^2",
    "³": "^3",
    "√": "sqrt ",
    "\u2212": "-",
}
"""The usual spelling of characters in units."""
_NOT_IN_COMMENTS = re.compile(r"[^A-Za-z0-9 _.,:;()+=@%^/<>-]")
_RESERVED = frozenset(keyword.kwlist).union(
    re.findall(
        r"\w+",
        "alignas alignof and_eq asm auto bitand bitor bool boolean byte case catch char class co_await "
        "co_return co_yield compl concept const consteval constexpr constinit const_cast decltype default "
        "delete do double dynamic_cast else end end_try_catch end_unwind_protect endfor endfunction endif "
        "endparfor endswitch endwhile enum explicit export extern false float for friend function goto high "
        "if inline input int isnan isinf loop long low main mutable namespace new noexcept nullptr operator "
        "or_eq otherwise output parfor persistent private protected public register reinterpret_cast requires "
        "restrict return setup short signed sizeof static static_assert static_cast struct switch template "
        "this thread_local throw true try typedef typeid typename union unsigned until unwind_protect using "
        "virtual void volatile wchar_t while word xor xor_eq null yes no on off nan inf arduino unix linux "
        "avr",
    )
)
"""Words of Python, C, C++, Arduino, MATLAB, JavaScript and YAML that may not be identifiers of channels."""


def identifier(name: str) -> str:
    """A name that every language accepts: a lower-case letter, then [a-z0-9_], at most 32 characters."""
    spelt = _ascii(name).lower().replace("^", "")
    word = re.sub(r"[^a-z0-9]+", "_", spelt).strip("_")[:MAX_IDENTIFIER_LENGTH].strip("_")
    if not word:
        return "channel"
    if not word[0].isalpha() or word in _RESERVED:
        word = f"ch_{word}"[:MAX_IDENTIFIER_LENGTH].strip("_")
    return word


def identifiers(names: Iterable[str]) -> tuple[str, ...]:
    """An identifier for each name, in order, no two alike: the second "temp" becomes temp_2.

    Nor does one equal another with `_filtered`, which is what sketches call the second column of a channel.
    """
    taken, chosen = set[str](), list[str]()
    for word in map(identifier, names):
        candidate, number = word, 1
        while not taken.isdisjoint((candidate, f"{candidate}_filtered")):
            number += 1
            ending = f"_{number}"
            candidate = word[: MAX_IDENTIFIER_LENGTH - len(ending)].rstrip("_") + ending
        taken.update((candidate, f"{candidate}_filtered"))
        chosen.append(candidate)
    return tuple(chosen)


def comment_text(text: str, length: int = MAX_COMMENT_LENGTH) -> str:
    """`text` as it may appear in a comment of any language: one line of harmless ASCII.

    Line ends, quotes, backslashes, braces, "*", "#", "$" and "?" (trigraphs) become "_"; what is longer than
    `length` is cut.
    """
    words = " ".join(_NOT_IN_COMMENTS.sub("_", " ".join(_ascii(text).split())).split())
    return words if len(words) <= length else f"{words[: length - 3].rstrip()}..."


def number_text(value: float | None, unset: str = "") -> str:
    """A finite double as all targets read it back bit for bit: always a point, a signed exponent (1.0e-05).

    ROS 2 takes `1` for an integer and stops; PyYAML takes `1e-05` and `1.0e22` for texts. None becomes `unset`.
    """
    if value is None:
        return unset
    digits, _, exponent = repr(float(value)).partition("e")
    if "." not in digits:
        digits += ".0"
    return f"{digits}e{exponent}" if exponent else digits


def _ascii(text: str) -> str:
    """`text` in ASCII in its usual spelling; "_" for what has no spelling."""
    plain = _spelt(unicodedata.normalize("NFKD", _spelt(text)))
    return "".join(c if c.isascii() else "_" for c in plain if not unicodedata.combining(c))


def _spelt(text: str) -> str:
    return "".join(_SPELT.get(character, character) for character in text)
