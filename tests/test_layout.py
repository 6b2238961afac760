"""The layout: what kernels import, and the modules that the documents name."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_kernels_import_nothing_of_kalscope_but_kernels():
    kernels = [path for path in (ROOT / "src").rglob("*.py") if path.stem.endswith("kernels")]
    assert len(kernels) >= 4
    for path in kernels:
        imports = re.findall(r"^ *(?:from|import) (kalscope\S*)(?: import (\w+))?", path.read_text("utf-8"), re.M)
        assert [
            names for names in imports if not any(re.search("kernels$|compiled$", name) for name in names)
        ] == [], path


def test_contributing_names_modules_and_functions_that_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    modules = [path for part in ("src", "app", "tests") for path in (ROOT / part).rglob("*.py")]
    named = re.findall(r"`([\w/]+\.py)`", text)
    assert len(named) > 30
    assert [name for name in named if not any(path.as_posix().endswith("/" + name) for path in modules)] == []
    defined = {
        f"{path.stem}.{name}"
        for path in modules
        for name in re.findall(r"^(?:def|class) (\w+)", path.read_text("utf-8"), re.M)
    }
    others = {"pyproject.toml", "mkdocs.yml", "project.urls"}
    functions = set(re.findall(r"`(\w+\.\w+)`", text)) - set(named) - others
    assert len(functions) > 25
    assert functions - defined == set()
