"""Every regular expression over outside text takes a time that is linear in the length of the text.

Counted, not timed: see `regex_cost`. The patterns are found by importing all modules, and by reading their source
for those that are written where they are used, so that none is forgotten.
"""

import ast
import importlib
import pkgutil
import re
from pathlib import Path

import pytest
from regex_cost import ANCHORED, worst_growth

import kalscope

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
