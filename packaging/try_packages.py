"""Build sdist and wheel and install each in empty environments: python packaging/try_packages.py.

In each environment, outside the checkout, a recording is tuned and exported, a file that needs an extra is refused,
and the dashboard of the demo is opened and ended. The wheel is tried with every Python found, the sdist with the
first. Prints a table, and the size of the largest packages; ends with 1 where something fails.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import urllib.request
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
VERSIONS = ("3.11", "3.12", "3.13")
WEIGH = """
import importlib.metadata
for package in importlib.metadata.distributions():
    files = (file.locate() for file in package.files or ())
    print(sum(file.stat().st_size for file in files if file.is_file()), package.metadata["Name"])
"""
MIN_WEIGHT = 5e6
"""Size from which a package is listed, bytes."""


def interpreters() -> list[str]:
    """A Python of each supported version: on the PATH, or one of pyenv."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    found = [
        next(map(str, sorted(pyenv.glob(f"{version}.*/bin/python"))), None) or shutil.which(f"python{version}")
        for version in VERSIONS
    ]
    return [path for path in found if path] or [sys.executable]


def build(folder: Path) -> list[Path]:
    """The wheel and the sdist, which twine accepts for the package index."""
    run([sys.executable, "-m", "build", "--outdir", folder, ROOT], folder)
    packages = [*folder.glob("*.whl"), *folder.glob("*.tar.gz")]
    run([sys.executable, "-m", "twine", "check", "--strict", *packages], folder)
    return packages


def attempt(python: str, package: Path, folder: Path) -> list[str]:
    """Install the package and use it; the cells of its row."""
    run([python, "-m", "venv", folder / "env"], folder)
    bin_folder = binaries(folder)
    run([bin_folder / "python", "-m", "pip", "install", "--quiet", package], folder)
    kalscope = bin_folder / "kalscope"
    answer = run([kalscope, "tune", "demo", "--lag-ms", "50", "-o", "tuning.toml"], folder)
    run([kalscope, "export", "tuning.toml", "--to", "arduino", "-o", "kalscope_filter"], folder)
    (folder / "log.parquet").write_bytes(b"PAR1" + bytes(200) + b"PAR1")
    if 'pip install "kalscope[formats]"' not in run([kalscope, "tune", "log.parquet"], folder, expected=2):
        raise RuntimeError("without an extra a Parquet file must be refused with the extra's name")
    size = sum(file.stat().st_size for file in (folder / "env").rglob("*") if file.is_file()) / 1e6
    version = run([bin_folder / "python", "-V"], folder).split()[1]
    lag = next(line.split(",")[0] for line in answer.splitlines() if line.startswith("lag"))
    return [version, package.suffix.strip("."), f"{size:.0f} MB", lag, open_demo(kalscope, folder)]


def binaries(folder: Path) -> Path:
    """Where the programs of the environment in a folder are."""
    return folder / "env" / ("Scripts" if os.name == "nt" else "bin")


def open_demo(kalscope: Path, folder: Path) -> str:
    """Open the dashboard, load its page by the printed link, and end it."""
    command = [kalscope, "open", "demo", "--no-browser", "--port", "0"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as program:
        try:
            assert program.stdout is not None
            link = program.stdout.readline().removeprefix("Kalscope: ").strip()
            with urllib.request.urlopen(link, timeout=60) as page:
                size = len(page.read())
            program.send_signal(signal.SIGTERM)
            status = program.wait(60)
        finally:
            program.kill()
    if status or size < 1000:
        raise RuntimeError(f"the dashboard ended with {status} after a page of {size} bytes")
    return f"page of {size / 1e3:.0f} kB, ended with {status}"


def largest(python: Path) -> str:
    """The size of the largest packages of an environment, compiled Python included."""
    sizes = [line.split() for line in run([python, "-c", WEIGH], python.parent).splitlines()]
    found = sorted(((int(size), name) for size, name in sizes if int(size) >= MIN_WEIGHT), reverse=True)
    return ", ".join(f"{name} {size / 1e6:.0f} MB" for size, name in found)


def run(command: Sequence[str | Path], folder: Path, *, expected: int = 0) -> str:
    """Run a command outside the checkout; what it printed. CalledProcessError where it ends with another status."""
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run([*map(str, command)], cwd=folder, env=clean, capture_output=True, text=True, check=False)
    if done.returncode != expected:
        sys.stderr.write(done.stdout + done.stderr)
        raise subprocess.CalledProcessError(done.returncode, command)
    return done.stdout if not expected else done.stderr


def main() -> None:
    """Print one line for each installation."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", action="append", help="an interpreter; default: every supported one found")
    pythons = parser.parse_args().python or interpreters()
    print("| Python | package | environment | tune demo --lag-ms 50 | open demo |\n|---|---|---|---|---|")
    weights = ""
    with tempfile.TemporaryDirectory() as folder:
        packages = build(Path(folder))
        for python, package in [*((python, packages[0]) for python in pythons), (pythons[0], packages[1])]:
            with tempfile.TemporaryDirectory(dir=folder) as own:
                print(f"| {' | '.join(attempt(python, package, Path(own)))} |", flush=True)
                weights = largest(binaries(Path(own)) / "python")
        print(f"\nThe last one: {weights}")


if __name__ == "__main__":
    main()
