"""Which tests start a browser, a simulated board, a server or another process, read from what they use.

So no test can be forgotten: `make test-fast` leaves out every marked one.
"""

from __future__ import annotations

import inspect
import os
import subprocess
from collections.abc import Iterator
from types import CodeType, FunctionType

import pytest

FIXTURES = {"browser": "browser", "workshop": "device"}
"""Markers by the fixture that starts the thing."""
STARTERS = {"attack_table", "forked", "kalscope_app.guard.server", "program", "viser._viser", "wire"}
"""Modules whose functions and classes start or meet a server or the program."""


def mark(item: pytest.Item) -> None:
    """Add the markers that a test's fixtures and functions call for."""
    if not isinstance(item, pytest.Function):
        return
    fixtures = item._fixtureinfo.name2fixturedefs
    for fixture, marker in FIXTURES.items():
        if fixture in fixtures:
            item.add_marker(marker)
    functions = [item.function, *(one.func for definitions in fixtures.values() for one in definitions)]
    if any(starts_something(function, set()) for function in functions):
        item.add_marker("server")


def starts_something(function: object, seen: set[object]) -> bool:
    """Whether a function, or one of its module that it uses, starts a process or a server."""
    function = inspect.unwrap(function) if callable(function) else function
    if not isinstance(function, FunctionType) or function in seen:
        return False
    seen.add(function)
    for name in names_in(function.__code__):
        value = function.__globals__.get(name)
        if value is subprocess or (name == "openpty" and os in function.__globals__.values()):
            return True
        module = getattr(value, "__module__", None)
        if callable(value) and module in STARTERS:
            return True
        parts = list(vars(value).values()) if inspect.isclass(value) else [value]
        if module == function.__module__ and any(starts_something(part, seen) for part in parts):
            return True
    return False


def names_in(code: CodeType) -> Iterator[str]:
    """Global names and attributes that a function uses, also in functions inside it."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from names_in(constant)
