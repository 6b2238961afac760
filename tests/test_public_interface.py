"""The public interface: what `import kalscope` offers and what the command line takes.

`public_interface.txt` lists it, one entry a line. A line that is lost or changed breaks a user's script; a new
entry is added to the file in the commit that makes it.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
import typer

import kalscope
from kalscope import classic
from kalscope.cli.app import app, command
from kalscope_app.main import add_dashboard

ROOT = Path(__file__).parents[1]
LISTED = (Path(__file__).parent / "public_interface.txt").read_text(encoding="utf-8").splitlines()


def test_the_list_is_what_is_offered():
    listed, offered = set(LISTED), {*python_interface(), *command_line()}
    assert listed - offered == set(), "lost"
    assert offered - listed == set(), "not listed"


def test_the_same_names_are_listed_imported_and_known_to_a_type_checker():
    tree = ast.parse(Path(kalscope.__file__).read_text(encoding="utf-8"))
    (checked,) = (node for node in tree.body if isinstance(node, ast.If) and isinstance(node.test, ast.Name))
    places = {(name.name, one.module) for one in checked.body for name in one.names}
    assert {name for name, _ in places} == set(kalscope.__all__)
    assert {(name, sys.modules[getattr(kalscope, name).__module__].__name__) for name in kalscope.__all__} == places


def test_every_name_can_be_imported_listed_and_starred_and_is_documented():
    everything = {}
    exec("from kalscope import *", everything)
    assert set(kalscope.__all__) <= set(everything)
    assert set(dir(kalscope)) == {*kalscope.__all__, "__version__", "classic"}
    assert kalscope.__version__ == version("kalscope")
    page = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^::: kalscope\.(\w+)$", page, re.MULTILINE)) == sorted(kalscope.__all__)
    with pytest.raises(AttributeError, match="module 'kalscope' has no attribute 'denose'"):
        kalscope.denose  # noqa: B018 (looking it up is what is tried)


def python_interface():
    """Functions and classes with their arguments, then what else each class offers."""
    names = [*kalscope.__all__, *(f"classic.{name}" for name in classic.__all__)]
    for name in names:
        thing = getattr(classic if "." in name else kalscope, name.removeprefix("classic."))
        if inspect.isclass(thing) and issubclass(thing, Exception):
            yield f"kalscope.{name}: {', '.join(base.__name__ for base in thing.__mro__[1:-2])}"
            continue
        yield f"kalscope.{name}{arguments(thing)}"
        if inspect.isclass(thing):
            yield from (f"kalscope.{name}.{member}" for member in members(thing))


def arguments(thing):
    """The arguments without annotations; a default that is an object is written as three dots."""
    signature = inspect.signature(thing)
    public = [
        one.replace(annotation=one.empty, default=one.default if is_plain(one.default) else ...)
        for name, one in signature.parameters.items()
        if name != "self" and not name.startswith("_")
    ]
    return str(signature.replace(parameters=public, return_annotation=signature.empty)).replace("Ellipsis", "...")


def is_plain(default):
    return default is inspect.Parameter.empty or isinstance(default, str | float | int | tuple | type(None))


def members(cls):
    """Methods with their arguments, properties, and fields that are no arguments."""
    fields = {field.name for field in dataclasses.fields(cls)} if dataclasses.is_dataclass(cls) else set()
    names = fields | {name for name in dir(cls) if not name.startswith("_")}
    for name in sorted(names - set(inspect.signature(cls).parameters)):
        member = getattr(cls, name, None)
        yield f"{name}{arguments(member)}" if inspect.isfunction(member) else name


def command_line():
    """The arguments and options of the program and of its commands."""
    add_dashboard()
    program = typer.main.get_command(app)
    yield from (f"kalscope {spelling(option)}" for option in program.params)
    for name in sorted(program.commands):
        yield from (f"kalscope {name} {spelling(one)}" for one in command(name).params)


def spelling(parameter):
    """The spellings of an option or the name of an argument, and what holds of it."""
    if parameter.param_type_name == "argument":
        names = parameter.metavar or parameter.name.upper()
    else:
        names = " ".join([*parameter.opts, *parameter.secondary_opts])
    return names + " (required)" * parameter.required + " (may be repeated)" * parameter.multiple
