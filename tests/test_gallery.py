"""The commands on pages of the site run, and their filters bring a reading nearer to the truth."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.support.required import not_here

DOCS = Path(__file__).parents[1] / "docs"
*SENSORS, TWELVE = (DOCS / "gallery.md").read_text("utf-8").split("\n## ")[1:]
ERRORS = re.compile(r"raw ([\d.]+), filtered ([\d.]+)")


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
    raw, filtered = map(float, ERRORS.search(shown).groups())
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
def test_the_formulas_of_the_theory_are_those_of_the_code(with_answers):
    """Its programs compare each with the code."""
    page = (DOCS / "theory.md").read_text(encoding="utf-8")
    assert page.count("```python run") >= 6
    shown = with_answers(page)
    assert "λ = 0.0973 (0.0137 to 0.557)  ℓ = -632.5456" in shown
    with pytest.raises(AssertionError):
        with_answers(page.replace("K / (2 - K)", "K / (1 - K)"))


@pytest.mark.slow
def test_the_commands_of_the_readme_run(with_answers):
    page = (DOCS.parent / "README.md").read_text(encoding="utf-8")
    assert page.count(" run\n") >= 2
    assert "lag 50 ms" in with_answers(page)


@pytest.mark.slow
def test_a_command_that_fails_fails_the_page(with_answers):
    with pytest.raises(RuntimeError, match="--lag-ms must be"):
        with_answers("```sh run\nkalscope tune demo --lag-ms -1\n```\n")


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
