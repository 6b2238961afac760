"""The examples are documentation, so they run; and there are some."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from forked import Forked
from waiting import PATIENCE

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))


def test_there_are_examples():
    assert len(EXAMPLES) >= 3


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_says_something(example, tmp_path):
    done = subprocess.run([sys.executable, "-W", "error", example], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) >= 3
    assert "False" not in done.stdout


def test_the_momentum_page_shows_what_its_example_prints(tmp_path):
    """Lag, overshoot and error of every row to three digits, and the picture."""
    argv = [str(ROOT / "examples" / "04_momentum.py"), str(tmp_path / "momentum.svg")]
    script = f"import runpy, sys; sys.argv = {argv!r}; runpy.run_path(sys.argv[0], run_name='__main__')"
    with Forked(script, tmp_path, os.environ) as program:
        printed, complaint = program.communicate(PATIENCE)
    assert program.returncode == 0, complaint
    page = (ROOT / "docs" / "theory" / "momentum.md").read_text("utf-8").splitlines()
    shown = [re.findall(r"\d+(?:\.\d+)?", line) for line in page if line[:1] == "|"]
    rows = [line.split() for line in printed.splitlines() if " ms" in line]
    assert len(rows) == 11
    for row in rows:
        lag, overshoot, error = float(row[-9]), float(row[-5]), float(row[-1])
        expected = {f"{lag:.3g}", f"{error:.3g}"}
        near = [numbers for numbers in shown if expected <= {f"{float(number):.3g}" for number in numbers}]
        assert any(abs(float(number) - overshoot) <= 0.5 for numbers in near for number in numbers), row
    assert ElementTree.parse(tmp_path / "momentum.svg").getroot().tag.endswith("svg")
