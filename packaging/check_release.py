"""Say whether this checkout can be released, and with which commands: python packaging/check_release.py.

The version of pyproject.toml must have a section of its own in CHANGELOG.md with nothing left under Unreleased, the
citation must name it, nothing may be uncommitted, and the tag vVERSION must be this commit. rattler-build must
be able to read the draft for conda-forge.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import rattler_build

ROOT = Path(__file__).parents[1]


def problems(version: str) -> list[str]:
    """What prevents the release of this version, one sentence each."""
    sections = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    named = {section.split()[0]: section.partition("\n")[2].strip() for section in sections}
    cited = re.search(
        r"^version: *\"?([^\"\n]+)", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE
    )
    fault = recipe_fault()
    checks = {
        f"CHANGELOG.md must have a section {version} (got {', '.join(named)})": version in named,
        "CHANGELOG.md must have nothing under Unreleased": not named.get("Unreleased"),
        f"CITATION.cff must say version: {version} (got {cited and cited[1]})": bool(cited) and cited[1] == version,
        "everything must be committed": not git("status", "--porcelain"),
        f"packaging/conda-recipe.yaml must be a recipe (got {fault})": not fault,
        f"the tag v{version} must be this commit": f"v{version}" in git("tag", "--points-at", "HEAD").split(),
    }
    return [sentence for sentence, holds in checks.items() if not holds]


def recipe_fault() -> str:
    """Why rattler-build cannot read the draft for conda-forge; empty where it can."""
    try:
        rattler_build.Stage0Recipe.from_yaml(
            (ROOT / "packaging/conda-recipe.yaml").read_text(encoding="utf-8")
        ).render()
    except rattler_build.RattlerBuildError as error:
        return " ".join(str(error).split())
    return ""


def git(*arguments: str) -> str:
    """What git prints."""
    return subprocess.run(
        ["git", "-C", ROOT, *arguments], capture_output=True, text=True, check=True
    ).stdout.strip()


def main() -> None:
    """Print what is wrong, or what to do next."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    if found := problems(version):
        sys.exit("\n".join(["Not ready for a release:", *(f"  {sentence}" for sentence in found)]))
    print(f"{version} is ready: python -m build && twine upload dist/kalscope-{version}*")


if __name__ == "__main__":
    main()
