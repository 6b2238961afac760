"""What a regular expression costs at worst: the steps of a backtracking engine, counted, not timed.

A model of Python's own engine walks the parsed pattern and counts the characters it looks at. The worst texts are
made from the pattern itself: what leads to each of its unbounded repeats, then a long run of what that repeat
accepts, then a character that ends the hope of a match. An engine that tries again from every place of the run
shows itself by a count that is quadratic or worse in the length.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from re import _constants as code  # type: ignore[attr-defined]
from re import _parser as parser  # type: ignore[attr-defined]
from typing import Any

SAMPLES = ' 1a.,:;-"_/|[](#%=*\n§E'
"""Characters that a repeat is tried with, where it accepts them."""
BREAKERS = ("\x00", "x", "\n")
ANCHORED = ("match", "fullmatch")

Rest = Callable[[int], bool]


class TooManySteps(Exception):
    """The limit was passed."""


class Engine:
    """Counts the steps of one pattern on one text."""

    def __init__(self, pattern: re.Pattern[Any], text: str, limit: int) -> None:
        self.tree = parsed(pattern)
        self.ignore_case = bool(pattern.flags & re.IGNORECASE)
        self.dot_all = bool(pattern.flags & re.DOTALL)
        self.text, self.limit, self.steps = text, limit, 0

    def run(self, use: str) -> int:
        """Steps of `use`, a method of re.Pattern; TooManySteps above the limit."""
        size, at = len(self.text), 0
        ends: list[int] = []

        def end(place: int) -> bool:
            ends.append(place)
            return use != "fullmatch" or place == size

        while at <= size:
            ends.clear()
            found = self.match(self.tree, 0, at, end)
            if use in ANCHORED or (found and use == "search"):
                break
            at = max(at + 1, ends[-1]) if found else at + 1
        return self.steps

    def match(self, items: Any, i: int, at: int, rest: Rest) -> bool:  # noqa: PLR0911 (one return a kind of node)
        """Whether items[i:] match from `at` on, and `rest` from where they end."""
        if i == len(items):
            return rest(at)
        op, value = items[i]

        def go_on(place: int) -> bool:
            return self.match(items, i + 1, place, rest)

        if is_single(op):
            return self.look(op, value, at) and go_on(at + 1)
        if op in (code.MAX_REPEAT, code.MIN_REPEAT, code.POSSESSIVE_REPEAT):
            least, most, body = value
            if len(body) == 1 and is_single(body[0][0]):
                return self.run_of_one(op, least, most, body[0], at, go_on)
            return self.repeat(op, least, most, body, at, go_on, 0)
        if op is code.SUBPATTERN:
            return self.match(value[3], 0, at, go_on)
        if op is code.ATOMIC_GROUP:
            ends: list[int] = []
            return self.match(value, 0, at, lambda place: ends.append(place) is None) and go_on(ends[0])
        if op is code.BRANCH:
            return any(self.match(branch, 0, at, go_on) for branch in value[1])
        if op in (code.ASSERT, code.ASSERT_NOT):
            direction, body = value
            start = at if direction > 0 else at - body.getwidth()[0]
            found = start >= 0 and self.match(body, 0, start, lambda _: True)
            return found == (op is code.ASSERT) and go_on(at)
        if op is code.AT:
            return self.stands_at(value, at) and go_on(at)
        raise NotImplementedError(f"{op} {value}")

    def run_of_one(self, op: Any, least: int, most: Any, body: Any, at: int, rest: Rest) -> bool:
        """A repeat of one character: counted in one go, as the engine does, then given back one by one."""
        if op is code.MIN_REPEAT:
            count = 0
            while True:
                if count >= least and rest(at + count):
                    return True
                if count == most or not self.look(*body, at + count):
                    return False
                count += 1
        count = 0
        while count < most and self.look(*body, at + count):
            count += 1
        if op is code.POSSESSIVE_REPEAT:
            return count >= least and rest(at + count)
        return any(rest(at + n) for n in range(count, least - 1, -1))

    def repeat(self, op: Any, least: int, most: Any, body: Any, at: int, rest: Rest, count: int) -> bool:
        """A repeat of several characters."""

        def again(place: int) -> bool:
            return place > at and self.repeat(op, least, most, body, place, rest, count + 1)

        if op is code.MIN_REPEAT and count >= least and rest(at):
            return True
        if count < most and self.match(body, 0, at, again):
            return True
        return op is not code.MIN_REPEAT and count >= least and rest(at)

    def look(self, op: Any, value: Any, at: int) -> bool:
        """Look at one character: a step."""
        self.steps += 1
        if self.steps > self.limit:
            raise TooManySteps
        return at < len(self.text) and accepts(op, value, self.text[at], self.ignore_case, self.dot_all)

    def stands_at(self, where: Any, at: int) -> bool:
        """Whether an anchor holds; word boundaries always do here, which only makes the count larger."""
        if where in (code.AT_BEGINNING, code.AT_BEGINNING_STRING):
            return at == 0
        if where in (code.AT_END, code.AT_END_STRING):
            return at == len(self.text)
        return True


def is_single(op: Any) -> bool:
    """Whether a node takes exactly one character."""
    return op in (code.LITERAL, code.NOT_LITERAL, code.ANY, code.IN)


def accepts(op: Any, value: Any, char: str, ignore_case: bool, dot_all: bool) -> bool:
    """Whether a node of one character takes this one."""
    if op is code.ANY:
        return dot_all or char != "\n"
    variants = {char, char.lower(), char.upper()} if ignore_case else {char}
    if op is code.LITERAL:
        return chr(value) in variants
    if op is code.NOT_LITERAL:
        return chr(value) not in variants
    inside = any(in_set(item, variant) for item in value for variant in variants)
    return inside != (value[0][0] is code.NEGATE)


def in_set(item: tuple[Any, Any], char: str) -> bool:
    """Whether an item of a set holds a character."""
    op, value = item
    if op is code.LITERAL:
        return chr(value) == char
    if op is code.RANGE:
        return value[0] <= ord(char) <= value[1]
    if op is code.CATEGORY:
        name = str(value)
        kind = (
            char.isspace()
            if "SPACE" in name
            else char.isdigit()
            if "DIGIT" in name
            else char.isalnum() or char == "_"
        )
        return kind != ("_NOT_" in name)
    return False


def as_text(text: str | bytes) -> str:
    """A pattern as text."""
    return text.decode("latin-1") if isinstance(text, bytes) else text


@cache
def parsed(pattern: re.Pattern[Any]) -> Any:
    """The tree of a pattern."""
    return parser.parse(as_text(pattern.pattern), pattern.flags & ~re.UNICODE)


def worst_texts(pattern: re.Pattern[Any], size: int) -> Iterator[str]:
    """Texts of about `size` characters that lead into each repeat of a pattern and then fail."""
    flags = pattern.flags
    ignore_case, dot_all = bool(flags & re.IGNORECASE), bool(flags & re.DOTALL)
    runs = [("", char) for char in SAMPLES]
    runs += [("", pair) for pair in ("1 ", "1,", "a:", "a:1 ", "1.", "1-", ' "', "[]", "a b ", "a=1 ")]
    runs += into_repeats(parsed(pattern), "", ignore_case, dot_all)
    for lead, body in dict.fromkeys(runs):
        for breaker in BREAKERS:
            yield lead + body * (size // len(body)) + breaker


def into_repeats(items: Any, lead: str, ignore_case: bool, dot_all: bool) -> Iterator[tuple[str, str]]:
    """(what leads there, what is repeated) of each repeat without a near bound."""
    for op, value in items:
        if op in (code.MAX_REPEAT, code.MIN_REPEAT, code.POSSESSIVE_REPEAT):
            if value[1] > 50:
                yield from ((lead, body) for body in bodies(value[2], ignore_case, dot_all))
            yield from into_repeats(value[2], lead, ignore_case, dot_all)
        elif op is code.SUBPATTERN:
            yield from into_repeats(value[3], lead, ignore_case, dot_all)
        elif op is code.BRANCH:
            for branch in value[1]:
                yield from into_repeats(branch, lead, ignore_case, dot_all)
        lead += shortest([(op, value)], ignore_case, dot_all)


def bodies(body: Any, ignore_case: bool, dot_all: bool) -> Iterable[str]:
    """What a repeat may repeat."""
    if len(body) == 1 and is_single(body[0][0]):
        return [char for char in SAMPLES if accepts(*body[0], char, ignore_case, dot_all)][:8]
    once = shortest(body, ignore_case, dot_all)
    return [once] if once else []


def shortest(items: Any, ignore_case: bool, dot_all: bool) -> str:
    """A short text that the items match, with one round of each repeat."""
    text = ""
    for op, value in items:
        if op is code.LITERAL:
            text += chr(value)
        elif is_single(op):
            candidates = (*SAMPLES, *map(chr, range(33, 1000)))
            text += next((char for char in candidates if accepts(op, value, char, ignore_case, dot_all)), "")
        elif op in (code.MAX_REPEAT, code.MIN_REPEAT, code.POSSESSIVE_REPEAT):
            text += shortest(value[2], ignore_case, dot_all) * max(value[0], min(1, value[1]))
        elif op is code.SUBPATTERN:
            text += shortest(value[3], ignore_case, dot_all)
        elif op is code.BRANCH:
            text += shortest(value[1][0], ignore_case, dot_all)
    return text


def worst_growth(pattern: re.Pattern[Any], use: str, size: int, most: int) -> str | None:
    """A text on which the engine takes more than `most` steps a character; None where none is known."""
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(max(before, 40 * size + 10_000))
    try:
        for text in worst_texts(pattern, size):
            try:
                Engine(pattern, text, most * (len(text) + 1)).run(use)
            except TooManySteps:
                return text
    finally:
        sys.setrecursionlimit(before)
    return None
