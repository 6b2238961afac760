"""Examples and commands on pages of the site are documentation, so they run, and their filters help."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import pytest

import kalscope
from tests.support.forked import Forked
from tests.support.required import not_here
from tests.support.waiting import PATIENCE

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
*SENSORS, TWELVE = (DOCS / "gallery.md").read_text("utf-8").split("\n## ")[1:]


# ---- examples


RUN = """
import runpy, sys, warnings
warnings.simplefilter("error")
sys.argv = {argv}
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """What an example prints, run once, in a folder that takes the pictures of all."""
    folder = tmp_path_factory.mktemp("examples")

    @cache
    def printed(example):
        argv = [str(example), str(folder / f"{example.stem}.svg")]
        with Forked(RUN.format(argv=argv), folder, os.environ) as program:
            out, err = program.communicate(PATIENCE)
        assert program.returncode == 0, err
        return out, argv[-1]

    return printed


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_prints_something(example, printed):
    text, _ = printed(example)
    assert len(text.splitlines()) >= 3
    assert "False" not in text


def test_the_momentum_page_shows_what_its_example_prints(printed):
    """Lag, overshoot and error of every row to three digits, and the picture."""
    text, picture = printed(ROOT / "examples" / "04_momentum.py")
    page = (DOCS / "theory.md").read_text("utf-8").splitlines()
    shown = [re.findall(r"\d+(?:\.\d+)?", line) for line in page if line[:1] == "|"]
    rows = [line.split() for line in text.splitlines() if " ms" in line]
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


# ---- pages


@pytest.fixture(scope="module")
def with_answers():
    """The hook that runs the commands of a page while the site is built."""
    spec = importlib.util.spec_from_file_location("shown_commands", DOCS / "hooks" / "shown_commands.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.with_answers


@pytest.mark.slow
@pytest.mark.parametrize("section", SENSORS, ids=[section.splitlines()[0] for section in SENSORS])
def test_the_gallery_shows_a_filter_that_helps_each_sensor(section, with_answers):
    shown = with_answers(section)
    assert "kalscope_filter.ino" in shown
    raw, filtered = map(float, re.search(r"raw ([\d.]+), filtered ([\d.]+)", shown).groups())
    assert filtered < 0.7 * raw


@pytest.mark.slow
def test_twelve_recordings_are_drawn_before_and_after_and_now_is_nearer_to_the_truth(with_answers):
    shown = with_answers(TWELVE)
    pictures = re.findall(r"<figure>.*?</figure>", shown)
    assert len(pictures) == 12
    assert max(map(len, pictures)) < 40_000
    errors = re.findall(r"raw ([\d.]+), until 0.1.0 ([\d.]+), first answer ([\d.]+\d)", shown)
    assert len(errors) == 3
    assert all(float(now) < min(float(raw), float(before)) for raw, before, now in errors)


@pytest.mark.slow
def test_the_formulas_of_the_theory_are_those_of_the_code_and_the_commands_of_the_readme_run(with_answers):
    """The programs of the page compare each formula with the code."""
    page = (DOCS / "theory.md").read_text(encoding="utf-8")
    assert page.count("```python run") >= 6
    assert "λ = 0.0973 (0.0137 to 0.557)  ℓ = -632.5456" in with_answers(page)
    with pytest.raises(AssertionError):
        with_answers(page.replace("K / (2 - K)", "K / (1 - K)"))
    with pytest.raises(RuntimeError, match="--lag-ms must be"):
        with_answers("```sh run\nkalscope tune demo --lag-ms -1\n```\n")
    assert "lag 50 ms" in with_answers((ROOT / "README.md").read_text(encoding="utf-8"))


def test_the_thermistor_is_missing_where_a_wire_is_off_or_it_is_shorted(tmp_path):
    (code,) = re.findall(r"```cpp\n(float readSensor[^`]*3950[^`]*)```", (DOCS / "gallery.md").read_text("utf-8"))
    (tmp_path / "main.cpp").write_text(
        "#include <math.h>\n#include <stdint.h>\n#include <stdio.h>\n#include <stdlib.h>\nint PINS[1];\n"
        f"int analogRead(int counts) {{ return counts; }}\n{code}\n"
        'int main(int, char **counts) { PINS[0] = atoi(counts[1]); printf("%.1f", readSensor(0)); }\n'
    )
    if shutil.which("g++") is None:
        not_here("g++ is not installed")
    subprocess.run(["g++", "-Wall", "-Werror", "main.cpp", "-o", "main"], cwd=tmp_path, check=True)
    read = [subprocess.check_output([tmp_path / "main", counts], text=True) for counts in ("0", "511", "1023")]
    assert read == ["nan", "25.0", "nan"]
