"""The examples are documentation, so they run; and there are some."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import pytest

import kalscope

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """What an example prints, run once, in a folder that takes the pictures of all."""
    folder = tmp_path_factory.mktemp("examples")

    @cache
    def printed(example):
        argv = [sys.executable, "-W", "error", example, folder / f"{example.stem}.svg"]
        done = subprocess.run(argv, cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout, argv[-1]

    return printed


def test_there_are_examples():
    assert len(EXAMPLES) >= 3


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_says_something(example, printed):
    said, _ = printed(example)
    assert len(said.splitlines()) >= 3
    assert "False" not in said


def test_the_momentum_page_shows_what_its_example_prints(printed):
    """Lag, overshoot and error of every row to three digits, and the picture."""
    said, picture = printed(ROOT / "examples" / "04_momentum.py")
    page = (ROOT / "docs" / "theory.md").read_text("utf-8").splitlines()
    shown = [re.findall(r"\d+(?:\.\d+)?", line) for line in page if line[:1] == "|"]
    rows = [line.split() for line in said.splitlines() if " ms" in line]
    assert len(rows) == 11
    for row in rows:
        lag, overshoot, error = float(row[-9]), float(row[-5]), float(row[-1])
        expected = {f"{lag:.3g}", f"{error:.3g}"}
        near = [numbers for numbers in shown if expected <= {f"{float(number):.3g}" for number in numbers}]
        assert any(abs(float(number) - overshoot) <= 0.5 for numbers in near for number in numbers), row
    assert ElementTree.parse(picture).getroot().tag.endswith("svg")


def test_the_eight_snippets_of_the_notebook_run_with_public_names():
    cells = json.loads((ROOT / "examples/eight_snippets.ipynb").read_text("utf-8"))["cells"]
    snippets = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert len(snippets) == 8
    assert {*re.findall(r"kalscope\.(\w+)\(", "".join(snippets))} <= {*kalscope.__all__}
    names = {}
    for snippet in snippets:
        exec(snippet, names)
