"""The layout: folders and modules stay small enough to read."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAX_ENTRIES = 12
MAX_LINES = 300
NOT_COUNTED = {"__init__.py", "__pycache__", "py.typed"}


@pytest.mark.slow
@pytest.mark.parametrize("part", ["src", "app", "docs"])
def test_no_folder_holds_more_than_twelve_entries(part):
    below = (path for path in (ROOT / part).rglob("*") if path.is_dir() and path.name not in NOT_COUNTED)
    folders = [ROOT / part, *below]
    sizes = {str(folder.relative_to(ROOT)): len(entries(folder)) for folder in folders}
    assert {name: size for name, size in sizes.items() if size > MAX_ENTRIES} == {}


def entries(folder):
    return {path.name for path in folder.iterdir()} - NOT_COUNTED


@pytest.mark.slow
@pytest.mark.parametrize("part", ["src", "app"])
def test_no_module_is_longer_than_three_hundred_lines(part):
    lengths = {
        str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines())
        for path in (ROOT / part).rglob("*.py")
    }
    assert lengths
    assert {name: length for name, length in lengths.items() if length > MAX_LINES} == {}


def test_kernels_import_nothing_of_kalscope_but_kernels():
    kernels = [path for path in (ROOT / "src").rglob("*.py") if path.stem.endswith("kernels")]
    assert len(kernels) >= 6
    for path in kernels:
        imports = re.findall(r"^ *(?:from|import) (kalscope\S*)(?: import (\w+))?", path.read_text("utf-8"), re.M)
        assert [
            names for names in imports if not any(re.search("kernels$|compiled$", name) for name in names)
        ] == [], path


def test_the_architecture_names_modules_that_exist():
    named = re.findall(r"`([\w/]+\.py)`", (ROOT / "docs" / "project" / "architecture.md").read_text("utf-8"))
    modules = [path.as_posix() for part in ("src", "app") for path in (ROOT / part).rglob("*.py")]
    assert len(named) > 40
    assert [name for name in named if not any(path.endswith("/" + name) for path in modules)] == []
