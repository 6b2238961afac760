"""Which tests start a browser, a simulated board, a server or another process, read from what they use.

So no test can be forgotten: `make test-fast` leaves out every marked one. Coverage is not measured in the long ones
that drive a browser or a board or are slow: they would take half as long again, and reach almost nothing that no
short one reaches. Neither is it in what reads the recordings beside the repository, which is skipped where they are
absent: so the report is the same everywhere. `traced.py` chooses among the others.
"""

from __future__ import annotations

import inspect
import os
import subprocess
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
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
UNTRACED = ("browser", "device", "slow")
"""Markers of tests in which coverage is not measured."""
SHARED_DATA = (Path(__file__).parents[3] / "shared" / "data").resolve()


def mark(item: pytest.Item) -> None:
    """Add the markers that a test's fixtures and functions call for."""
    if not isinstance(item, pytest.Function):
        return
    fixtures = item._fixtureinfo.name2fixturedefs
    for fixture, marker in FIXTURES.items():
        if fixture in fixtures:
            item.add_marker(marker)
    functions = [item.function, *(one.func for definitions in fixtures.values() for one in definitions)]
    if any(uses_any(function, starts_something) for function in functions):
        item.add_marker("server")
    parameters = item.callspec.params.values() if hasattr(item, "callspec") else ()
    untraced = any(map(item.get_closest_marker, UNTRACED)) or any(map(is_shared, parameters))
    if untraced or any(uses_any(function, names_shared) for function in functions):
        item.add_marker("untraced")


@cache
def uses_any(function: Callable[..., object], holds: Callable[[str, object, FunctionType], bool]) -> bool:
    """The same as `uses`, asked once for all cases of a test and all tests with a fixture."""
    return uses(function, holds, set())


def uses(function: object, holds: Callable[[str, object, FunctionType], bool], seen: set[object]) -> bool:
    """Whether `holds` is true of a global name of a function, or of one of its module that it uses."""
    function = inspect.unwrap(function) if callable(function) else function
    if not isinstance(function, FunctionType) or function in seen:
        return False
    seen.add(function)
    for name in names_in(function.__code__):
        value = function.__globals__.get(name)
        if holds(name, value, function):
            return True
        module = getattr(value, "__module__", None)
        parts = list(vars(value).values()) if inspect.isclass(value) else [value]
        if module == function.__module__ and any(uses(part, holds, seen) for part in parts):
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


def names_shared(_name: str, value: object, _function: FunctionType) -> bool:
    """Whether this is a path of a real recording."""
    return is_shared(value)


def is_shared(value: object) -> bool:
    return isinstance(value, Path) and value.resolve().is_relative_to(SHARED_DATA)


def names_in(code: CodeType) -> Iterator[str]:
    """Global names and attributes that a function uses, also in functions inside it."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from names_in(constant)
