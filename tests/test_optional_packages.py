"""Without the packages of the extras everything works but for what needs them."""

from __future__ import annotations

import re
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

from tests.support.program import command, end, running
from tests.support.waiting import PATIENCE

FOR_DEVELOPERS = {"test", "bench", "docs", "release", "check"}
"""Extras that the program has no use for."""

WITHOUT = """
import importlib.abc, sys

class Missing(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {modules!r}:
            raise ModuleNotFoundError("No module named " + repr(name), name=name)

sys.meta_path.insert(0, Missing())
for name in [name for name in sys.modules if name.partition(".")[0] in {modules!r}]:
    del sys.modules[name]
"""
"""Makes these modules ones that are not installed."""


@cache
def without_extras():
    """Python that hides all modules of the packages that only the extras install."""
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    extras = [needed for extra, needed in project["optional-dependencies"].items() if extra not in FOR_DEVELOPERS]
    packages = {re.match(r"[\w-]+", one)[0].lower() for needed in extras for one in needed}
    assert {"h5py", "dask", "pyarrow"} <= packages
    modules = {
        module for module, owners in packages_distributions().items() if {one.lower() for one in owners} & packages
    }
    return WITHOUT.format(modules=modules - set(sys.stdlib_module_names))


def test_commands_and_dashboard_need_no_extra(tmp_path):
    hidden = without_extras()
    for arguments in (
        ("tune", "demo", "--lag-ms", "50", "-o", "tuning.toml"),
        ("filter", "demo", "--config", "tuning.toml", "-o", "out.csv"),
        ("export", "tuning.toml", "--to", "arduino", "-o", "code"),
        ("report", "demo", "--config", "tuning.toml", "-o", "page.html"),
    ):
        with command(*arguments, cwd=tmp_path, change=hidden) as program:
            _, err = program.communicate(timeout=PATIENCE)
            assert program.returncode == 0, (arguments, err)
    with running(tmp_path, change=hidden) as (program, _):
        status, _, err = end(program)
    assert (status, err) == (0, "")


def test_what_needs_an_extra_says_so_in_one_line(tmp_path):
    (tmp_path / "log.parquet").write_bytes(b"PAR1" + bytes(200) + b"PAR1")
    for arguments, extra in ((("tune", "log.parquet"), "formats"), (("fleet", ".", "-o", "out"), "fleet")):
        with command(*arguments, cwd=tmp_path, change=without_extras()) as program:
            _, err = program.communicate(timeout=PATIENCE)
        (line,) = err.splitlines()
        assert (program.returncode, line.count(f'pip install "kalscope[{extra}]"')) == (2, 1)
