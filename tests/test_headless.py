"""The core stays headless, and the wheel carries all that the program needs."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.support.waiting import PATIENCE

ROOT = Path(__file__).parents[1]


def python(code, **kwargs):
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, **kwargs).stdout


def test_the_core_imports_what_is_used_and_no_more():
    """At its import nothing that takes long, for a parameter no compiler, with every public name no dashboard."""
    first, parameter, whole = python(
        "import sys, kalscope; print(*sys.modules)\n"
        "kalscope.FilterParams(1.0, 2.0); print(*sys.modules)\n"
        "[getattr(kalscope, name) for name in kalscope.__all__]; print(*sys.modules)"
    ).splitlines()
    assert "kalscope" in first.split()
    assert not {"numpy", "numba", "scipy", "tomlkit", "dataclasses"} & set(first.split())
    assert "numpy" in parameter.split()
    assert not {"numba", "scipy"} & set(parameter.split())
    assert "kalscope.filtering.kernels" in whole.split()
    heavy = {"viser", "serial", "typer", "duckdb", "matplotlib", "kalscope_app", "numba", "scipy"}
    assert not heavy & set(whole.split())


FIRST_PICTURE = """
import sys
import kalscope_app.dashboard
print(*sys.modules)
import kalscope_app.guard.server
from kalscope_app.engine.frame import compute_frame
from kalscope_app.open_command import first_state
from kalscope.sources.grammar.read_options import DEFAULTS
state = first_state("demo", DEFAULTS, None)
compute_frame(state)
print(*sys.modules)
from kalscope.cli.app import run
run(["filter", "sample:nile", "--q", "1469", "--r", "15100"])
print(*sys.modules)
"""


def test_the_first_picture_and_a_small_file_that_is_filtered_load_no_compiler_and_no_matplotlib():
    dashboard, picture, *filtered, after = python(FIRST_PICTURE).splitlines()
    assert "matplotlib" not in dashboard.split()
    assert "viser" in picture.split()
    assert "numba" not in picture.split()
    assert len(filtered) > 100  # a line a sample
    assert "numba" not in after.split()
    assert "matplotlib" not in after.split()


@pytest.mark.slow
def test_the_core_never_names_the_dashboard():
    for path in (ROOT / "src").rglob("*.py"):
        assert not re.search(r"^\s*(import|from)\s+(viser|kalscope_app)\b", path.read_text(), re.M), path


def test_every_public_name_has_a_docstring():
    import kalscope

    for name in kalscope.__all__:
        assert getattr(kalscope, name).__doc__, name


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The wheel, built and unpacked outside the checkout; its dependencies come from this environment.

    `make packages` installs it with pip.
    """
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder]
    subprocess.run(build, check=True, capture_output=True, cwd=ROOT)
    (wheel,) = folder.glob("kalscope-*.whl")
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(folder / "site")
    return folder / "site"


def test_the_installed_wheel_opens_the_demo_outside_the_checkout(installed, tmp_path):
    env = {**os.environ, "PYTHONPATH": str(installed), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    where = python("import kalscope; print(kalscope.__file__)", cwd=tmp_path, env=env)
    assert Path(where.strip()).is_relative_to(installed)
    command = [sys.executable, "-m", "kalscope_app.main", "open", "demo", "--port", "0", "--no-browser"]
    with subprocess.Popen(command, cwd=tmp_path, env=env, stdout=subprocess.PIPE, text=True) as program:
        first = program.stdout.readline()
        program.send_signal(signal.SIGINT)
        assert program.wait(timeout=PATIENCE) == 0
    assert re.match(r"Kalscope: http://127\.0\.0\.1:\d+/\?token=\S+$", first)


def test_the_installed_wheel_carries_the_sketch_and_exports_for_arduino_and_c(installed, tmp_path):
    assert (installed / "kalscope/arduino/kalscope_stream/kalscope_stream.ino").is_file()
    env = {**os.environ, "PYTHONPATH": str(installed), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    code = (
        "from kalscope import ChannelTuning, Tuning, export_tuning; "
        "tuning = Tuning((ChannelTuning('light', '', 0.1, 1.0),)); "
        "print(*(name for to in ('arduino', 'c') for name in export_tuning(tuning, to)))"
    )
    expected = ["KalscopeFilter.h", "kalscope_filter.ino", "kalscope_filter.h", "kalscope_filter.c"]
    assert python(code, cwd=tmp_path, env=env).split() == expected
