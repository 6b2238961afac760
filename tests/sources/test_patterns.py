"""Every regular expression over outside text takes a time that is linear in the length of the text.

Each pattern searches texts that lead into one of its repeats and then fail. A linear one takes a small part of the
processor's time that is allowed, any other several times as much, also on a busy machine. They are found by
importing all modules, and by reading the source for those that are written where they are used.
"""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import time
from pathlib import Path
from re import _compiler as compiler  # type: ignore[attr-defined]
from re import _constants as code  # type: ignore[attr-defined]
from re import _parser as parser  # type: ignore[attr-defined]

import pytest

import kalscope

CHARACTERS = ' 1a.,:;-"_/|[](#%=*\n§E'
"""What a repeat is tried with, where it accepts it."""
PAIRS = ("1 ", "1,", "a:", "a:1 ", "1.", "1-", ' "', "[]", "a b ", "a=1 ")
REPEATS = (code.MAX_REPEAT, code.MIN_REPEAT, code.POSSESSIVE_REPEAT)


def worst_texts(pattern, size):
    """Texts of about `size` characters that lead into each repeat of a pattern and then fail."""
    text = pattern.pattern if isinstance(pattern.pattern, str) else pattern.pattern.decode("latin-1")
    tree = parser.parse(text, pattern.flags & ~re.UNICODE)
    runs = [("", run) for run in (*CHARACTERS, *PAIRS)] + list(into_repeats(tree, "", pattern.flags))
    for lead, run in dict.fromkeys(runs):
        for breaker in ("\x00", "x", "\n"):
            yield lead + run * (size // len(run)) + breaker


def into_repeats(items, lead, flags):
    """(what leads there, what is repeated) of each repeat without a near bound."""
    for op, value in items:
        inside = [value[2]] if op in REPEATS else [value[3]] if op is code.SUBPATTERN else []
        if op in REPEATS and value[1] > 50:
            accepted = taken(value[2][0], flags)[:8] if len(value[2]) == 1 else ()
            yield from ((lead, run) for run in accepted or (shortest(value[2], flags),) if run)
        for branch in value[1] if op is code.BRANCH else inside:
            yield from into_repeats(branch, lead, flags)
        lead += shortest([(op, value)], flags)


def taken(node, flags, candidates=CHARACTERS):
    """The characters that one node of a tree accepts; "" where it takes more or less than one."""
    if node[0] not in (code.LITERAL, code.NOT_LITERAL, code.ANY, code.IN):
        return ""
    one = compiler.compile(parser.SubPattern(parser.State(), [node]), flags & (re.IGNORECASE | re.DOTALL))
    return "".join(filter(one.match, candidates))


def shortest(items, flags):
    """A short text that the items match, with one round of each repeat."""
    text = ""
    for op, value in items:
        if op is code.LITERAL:
            text += chr(value)
        elif op in REPEATS:
            text += shortest(value[2], flags) * max(value[0], min(1, value[1]))
        elif op is code.SUBPATTERN:
            text += shortest(value[3], flags)
        elif op is code.BRANCH:
            text += shortest(value[1][0], flags)
        else:
            text += taken((op, value), flags, CHARACTERS + "".join(map(chr, range(33, 1000))))[:1]
    return text


SOURCE = Path(kalscope.__file__).parent
METHODS = ("match", "fullmatch", "search", "findall", "finditer", "sub", "subn", "split")
USE = re.compile(rf"\b(\w+)(?:\[\w+\])?\.({'|'.join(METHODS)})\(")
OWN_TEXT = ("kalscope.analysis.findings", "kalscope.common.charts", "kalscope.common.text", "kalscope.export.job")
"""Modules whose patterns see the project's own charts, sentences, numbers and templates."""
SIZES, MAX_SECONDS = (100, 2000, 20_000), 0.1
"""Letters of a text, and what one search of it may take the processor: a linear one takes 5 ms at most."""


def compiled():
    """(module:name, pattern, methods by which it is used) of every pattern that a module holds."""
    used = {}
    for path in SOURCE.rglob("*.py"):
        for name, method in USE.findall(path.read_text("utf-8")):
            used.setdefault(name, set()).add(method)
    for info in pkgutil.walk_packages([str(SOURCE)], "kalscope."):
        module = importlib.import_module(info.name) if not info.name.endswith("__main__") else None
        for name, value in vars(module).items() if module else ():
            held = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else (value,)
            for pattern in held:
                if isinstance(pattern, re.Pattern):
                    yield f"{info.name}:{name}", pattern, used.get(name, {"search"})


def inline():
    """The same of every `re.method("…", text)`."""
    for path in SOURCE.rglob("*.py"):
        module = ".".join(("kalscope", *path.relative_to(SOURCE).with_suffix("").parts))
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            match node:
                case ast.Call(ast.Attribute(ast.Name("re"), method), [ast.Constant(pattern), *_]) if (
                    method in METHODS
                ):
                    flags = re.IGNORECASE if "IGNORECASE" in ast.unparse(node) else re.NOFLAG
                    yield f"{module}:{pattern}", re.compile(pattern, flags), {method}


def worst(pattern, use):
    """A text on which a pattern takes too long; None where none is known."""
    search = getattr(pattern, use)
    for size in SIZES:
        for text in worst_texts(pattern, size):
            given = text if isinstance(pattern.pattern, str) else text.encode("latin-1", "replace")
            start = time.thread_time()
            search(given)
            if time.thread_time() - start > MAX_SECONDS:
                return text[:40]
    return None


@pytest.mark.slow
def test_a_pattern_takes_a_time_in_proportion_to_its_text():
    patterns, slow = {}, []
    for name, pattern, uses in (*compiled(), *inline()):
        if name.partition(":")[0] not in OWN_TEXT:
            patterns.setdefault(pattern, (name, set()))[1].update(uses)
    assert len(patterns) > 80
    for pattern, (name, uses) in patterns.items():
        # What is anchored costs least; a search from every place costs most and covers all others that search.
        use = "findall" if uses - {"match", "fullmatch"} else "fullmatch" if "fullmatch" in uses else "match"
        if (text := worst(pattern, use)) is not None:
            slow.append(f"{name}: {pattern.pattern!r} tries over and over on {text!r}")
    assert slow == []
    assert worst(re.compile(r"a[^b]*c"), "findall")
