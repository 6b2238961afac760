"""Every regular expression over outside text takes a time that is linear in the length of the text.

Counted, not timed: see `regex_cost`. The patterns are found by importing all modules, and by reading their source
for those that are written where they are used, so that none is forgotten.
"""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from re import _constants as code  # type: ignore[attr-defined]
from re import _parser as parser  # type: ignore[attr-defined]
from typing import Any

import pytest

import kalscope

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


SOURCE = Path(kalscope.__file__).parent
METHODS = ("match", "fullmatch", "search", "findall", "finditer", "sub", "subn", "split")
USE = re.compile(rf"\b(\w+)(?:\[\w+\])?\.({'|'.join(METHODS)})\(")
SIZE, MAX_STEPS = 80, 24
"""Characters of a worst text, and steps a character: a quadratic pattern takes SIZE / 2 or more of them."""

OWN_TEXT = ("kalscope.analysis.findings", "kalscope.common.charts", "kalscope.common.text", "kalscope.export.job")
"""Modules whose patterns see the project's own charts, sentences, numbers and templates."""

CAPPED = {
    "kalscope.tuning.toml_text:_DEEP_KEY": "of at most 64 levels",
    "kalscope.sources.reading.preface:_STATED": "of a line of at most 400 characters",
}
"""Patterns that try again from every place, but only so far."""


def compiled():
    """(module:name, pattern, how it is used) of every pattern that a module holds."""
    used = {}
    for path in SOURCE.rglob("*.py"):
        for name, method in USE.findall(path.read_text("utf-8")):
            used.setdefault(name, set()).add(method)
    for info in pkgutil.walk_packages([str(SOURCE)], "kalscope."):
        if info.name.endswith("__main__"):
            continue
        module = importlib.import_module(info.name)
        for name, value in vars(module).items():
            held = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else (value,)
            patterns = [item for item in held if isinstance(item, re.Pattern)]
            if not patterns:
                continue
            uses = used.get(name, {"search"})
            for i, pattern in enumerate(patterns):
                yield f"{info.name}:{name}" + (f" {i + 1}" if i else ""), pattern, uses


def inline():
    """The same of every `re.method("…", text)`."""
    for path in SOURCE.rglob("*.py"):
        module = ".".join(("kalscope", *path.relative_to(SOURCE).with_suffix("").parts))
        source = path.read_text("utf-8")
        if "re" not in {name for name, _ in USE.findall(source)}:
            continue
        for node in ast.walk(ast.parse(source)):
            is_call = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args
            if not is_call or node.func.attr not in METHODS or ast.unparse(node.func.value) != "re":
                continue
            first = node.args[0]
            if isinstance(first, ast.Constant):
                flags = re.IGNORECASE if "IGNORECASE" in ast.unparse(node) else re.NOFLAG
                yield f"{module}:{first.value}", re.compile(first.value, flags), {node.func.attr}


def all_patterns():
    found = {}
    for name, pattern, uses in (*compiled(), *inline()):
        if name.partition(":")[0] not in OWN_TEXT:
            found.setdefault(pattern, (name, set()))[1].update(uses)
    return {name: (pattern, uses) for pattern, (name, uses) in found.items()}


@pytest.mark.slow
def test_a_pattern_takes_steps_in_proportion_to_its_text():
    patterns, slow = all_patterns(), []
    assert len(patterns) > 80
    assert CAPPED.keys() <= patterns.keys()
    for pattern, uses in (found for name, found in patterns.items() if name not in CAPPED):
        # What is anchored costs least; a search from every place costs most and covers all others that search.
        use = "findall" if uses - set(ANCHORED) else "fullmatch" if "fullmatch" in uses else "match"
        if (text := worst_growth(pattern, use, SIZE, MAX_STEPS)) is not None:
            slow.append(f"{pattern.pattern!r} tries over and over on {text!r}")
    assert slow == []
