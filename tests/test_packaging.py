"""What is imported, packed and installed: the core without the dashboard, the wheel, the image, the extras."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
import yaml

from tests.support.program import command, end, link_of, running, start
from tests.support.waiting import PATIENCE

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def python(code, **options):
    return subprocess.check_output([sys.executable, "-c", code], text=True, **options)


# ---- imports


IMPORTS = """
import sys
import kalscope
print(*sys.modules)
kalscope.FilterParams(1.0, 2.0)
print(*sys.modules)
[getattr(kalscope, name) for name in kalscope.__all__]
print(*sys.modules)
import kalscope_app.dashboard
print(*sys.modules)
import kalscope_app.guard.server
from kalscope_app.engine.frame import compute_frame
from kalscope_app.open_command import first_state
from kalscope.sources.grammar.read_options import DEFAULTS
compute_frame(first_state("demo", DEFAULTS, None))
from kalscope.cli.app import run
run(["filter", "sample:nile", "--q", "1469", "--r", "15100"])
print(*sys.modules)
"""


def test_nothing_is_imported_before_it_is_used():
    """At the start nothing that takes long, for the first picture and a small file no compiler."""
    lines = python(IMPORTS).splitlines()
    assert len(lines) > 100  # a line a sample
    first, parameter, core, dashboard, picture = (set(lines[i].split()) for i in (0, 1, 2, 3, -1))
    assert not {"numpy", "numba", "scipy", "tomlkit", "dataclasses"} & first
    assert "numpy" in parameter
    assert not {"numba", "scipy"} & parameter
    assert "kalscope.filtering.kernels" in core
    assert not {"viser", "serial", "typer", "duckdb", "matplotlib", "kalscope_app", "numba", "scipy"} & core
    assert "matplotlib" not in dashboard
    assert "viser" in picture
    assert not {"numba", "matplotlib"} & picture


# ---- the wheel


def test_the_installed_wheel_exports_for_arduino_and_opens_the_demo_outside_the_checkout(tmp_path):
    """Built and unpacked; its dependencies come from this environment. `make packages` installs it with pip."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path]
    subprocess.run(build, check=True, capture_output=True, cwd=ROOT)
    (wheel,) = tmp_path.glob("kalscope-*.whl")
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(tmp_path / "site")
    assert (tmp_path / "site/kalscope/arduino/kalscope_stream/kalscope_stream.ino").is_file()
    env = {**os.environ, "PYTHONPATH": str(tmp_path / "site"), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    code = (
        "import kalscope as k; print(k.__file__); tuning = k.Tuning((k.ChannelTuning('light', '', 0.1, 1.0),)); "
        "print(*(name for to in ('arduino', 'c') for name in k.export_tuning(tuning, to)))"
    )
    where, exported = python(code, cwd=tmp_path, env=env).splitlines()
    assert Path(where).is_relative_to(tmp_path / "site")
    assert exported == "KalscopeFilter.h kalscope_filter.ino kalscope_filter.h kalscope_filter.c"
    argv = [sys.executable, "-m", "kalscope_app.main", "open", "demo", "--port", "0", "--no-browser"]
    with subprocess.Popen(argv, cwd=tmp_path, env=env, stdout=subprocess.PIPE, text=True) as program:
        assert re.match(r"http://127\.0\.0\.1:\d+/\?token=\S+$", link_of(program))
        assert end(program, signal.SIGINT)[0] == 0


# ---- what is written by hand: the draft for conda-forge and the image


def test_the_recipe_for_conda_needs_what_the_package_needs():
    text = (ROOT / "packaging/conda-recipe.yaml").read_text()
    context = yaml.safe_load(text)["context"]
    recipe = yaml.safe_load(re.sub(r"\$\{\{ (\w+) \}\}", lambda name: context[name[1]], text))
    project = PROJECT["project"]
    needed = [re.fullmatch(r"([\w-]+)(.*)", one).groups() for one in project["dependencies"]]
    wanted = {f"{name.replace('matplotlib', 'matplotlib-base')} {version}" for name, version in needed}
    assert set(recipe["requirements"]["run"]) == {f"python {project['requires-python']}"} | wanted
    assert recipe["requirements"]["host"][2:] == [re.sub(">=", " >=", PROJECT["build-system"]["requires"][0])]
    assert recipe["package"] == {"name": project["name"], "version": project["version"]}
    assert recipe["build"]["python"]["entry_points"] == [f"kalscope = {project['scripts']['kalscope']}"]


DOCKERFILE = (ROOT / "packaging/Dockerfile").read_text()


def test_the_image_is_built_of_what_the_wheel_holds():
    lines = [line for line in DOCKERFILE.splitlines() if re.match("COPY (?!--)", line)]
    copied = {path for line in lines for path in line.split()[1:-1]}
    assert all((ROOT / path).exists() for path in copied)
    wheel = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {
        *wheel["packages"],
        *wheel["force-include"],
        PROJECT["project"]["readme"],
        "pyproject.toml",
        "LICENSE",
    }
    assert {path.partition("/")[0] for path in needed} <= copied


def test_what_the_image_runs_and_what_its_head_shows_prints_a_link(tmp_path):
    (alone,) = re.findall(r"^CMD (.*)", DOCKERFILE, re.MULTILINE)
    (shown,) = re.findall(r" kalscope (open .*\\\n.*)", DOCKERFILE)
    proxied = shown.replace("\\\n#", "").replace("/data/log.csv", "demo").split()
    for arguments, link in ((json.loads(alone), "http://localhost:"), (proxied, "https://kalscope.example.org/")):
        with start(tmp_path, *arguments, "--port", "0", source=None) as program:
            assert link_of(program).startswith(link)
            assert end(program)[0] == 0


# ---- the extras


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


@pytest.fixture(scope="module")
def without_extras():
    """Python that hides all modules of the packages that only the extras install."""
    extras = PROJECT["project"]["optional-dependencies"]
    needed = [one for extra, some in extras.items() if extra not in FOR_DEVELOPERS for one in some]
    packages = {re.match(r"[\w-]+", one)[0].lower() for one in needed}
    assert {"h5py", "dask", "pyarrow"} <= packages
    owners = packages_distributions().items()
    modules = {module for module, names in owners if {one.lower() for one in names} & packages}
    return WITHOUT.format(modules=modules - set(sys.stdlib_module_names))


def test_commands_and_dashboard_need_no_extra(without_extras, tmp_path):
    for arguments in (
        "tune demo --lag-ms 50 -o tuning.toml",
        "filter demo --config tuning.toml -o out.csv",
        "export tuning.toml --to arduino -o code",
        "report demo --config tuning.toml -o page.html",
    ):
        with command(*arguments.split(), cwd=tmp_path, change=without_extras) as program:
            _, err = program.communicate(timeout=PATIENCE)
            assert program.returncode == 0, (arguments, err)
    with running(tmp_path, change=without_extras) as (program, _):
        status, _, err = end(program)
    assert (status, err) == (0, "")


def test_what_needs_an_extra_says_so_in_one_line(without_extras, tmp_path):
    (tmp_path / "log.parquet").write_bytes(b"PAR1" + bytes(200) + b"PAR1")
    for arguments, extra in (("tune log.parquet", "formats"), ("fleet . -o out", "fleet")):
        with command(*arguments.split(), cwd=tmp_path, change=without_extras) as program:
            _, err = program.communicate(timeout=PATIENCE)
        (line,) = err.splitlines()
        assert (program.returncode, line.count(f'pip install "kalscope[{extra}]"')) == (2, 1)
