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

FIXTURES = {"browser": "browser", "firefox": "browser", "workshop": "device"}
"""Markers by the fixture that starts the thing."""
STARTERS = {
    "attack_table",
    "broker",
    "forked",
    "headless",
    "kalscope_app.guard.server",
    "kalscope_app.worker.worker",
    "program",
    "ssh_server",
    "viser._viser",
    "wire",
}
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
    if any(uses(function, set()) for function in functions):
        item.add_marker("server")


def uses(function: object, seen: set[object]) -> bool:
    """Whether a function, or one of its module that it uses, starts a process or meets a server."""
    function = inspect.unwrap(function) if callable(function) else function
    if not isinstance(function, FunctionType) or function in seen:
        return False
    seen.add(function)
    for name in names_in(function.__code__):
        value = function.__globals__.get(name)
        if starts_something(name, value, function):
            return True
        module = getattr(value, "__module__", None)
        parts = list(vars(value).values()) if inspect.isclass(value) else [value]
        if module == function.__module__ and any(uses(part, seen) for part in parts):
            return True
    return False


def starts_something(name: str, value: object, function: FunctionType) -> bool:
    """Whether this is a process or a server."""
    opens_terminal = name == "openpty" and os in function.__globals__.values()
    return (
        value is subprocess
        or opens_terminal
        or (callable(value) and getattr(value, "__module__", None) in STARTERS)
    )


def names_in(code: CodeType) -> Iterator[str]:
    """Global names and attributes that a function uses, also in functions inside it."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from names_in(constant)
