"""What is packed by hand agrees with pyproject.toml: the draft for conda-forge and the image."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import yaml

from tests.support.program import end, link_of, start

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
ON_CONDA_FORGE = {"matplotlib": "matplotlib-base"}
"""Packages that have another name there."""


def test_the_recipe_for_conda_needs_what_the_package_needs():
    text = (ROOT / "packaging/conda-recipe.yaml").read_text()
    context = yaml.safe_load(text)["context"]
    recipe = yaml.safe_load(re.sub(r"\$\{\{ (\w+) \}\}", lambda name: context[name[1]], text))
    project = PROJECT["project"]
    found = [re.fullmatch(r"([\w-]+)(.*)", one).groups() for one in project["dependencies"]]
    wanted = {f"{ON_CONDA_FORGE.get(name, name)} {version}" for name, version in found}
    assert set(recipe["requirements"]["run"]) == {f"python {project['requires-python']}"} | wanted
    assert recipe["requirements"]["host"][2:] == [re.sub(">=", " >=", PROJECT["build-system"]["requires"][0])]
    assert recipe["package"] == {"name": project["name"], "version": project["version"]}
    assert recipe["build"]["python"]["entry_points"] == [f"kalscope = {project['scripts']['kalscope']}"]


DOCKERFILE = (ROOT / "packaging/Dockerfile").read_text()


def test_the_image_is_built_of_what_the_wheel_holds():
    copied = {
        path for line in DOCKERFILE.splitlines() if re.match("COPY (?!--)", line) for path in line.split()[1:-1]
    }
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
    (alone,) = (
        json.loads(line.removeprefix("CMD ")) for line in DOCKERFILE.splitlines() if line.startswith("CMD ")
    )
    (shown,) = re.findall(r" kalscope (open .*\\\n.*)", DOCKERFILE)
    proxied = shown.replace("\\\n#", "").replace("/data/log.csv", "demo").split()
    for arguments, link in ((alone, "http://localhost:"), (proxied, "https://kalscope.example.org/")):
        with start(tmp_path, *arguments, "--port", "0", source=None) as program:
            assert link_of(program).startswith(link)
            assert end(program)[0] == 0
