"""Build sdist and wheel and install each in empty environments: python packaging/try_packages.py.

In each environment, outside the checkout, a recording is tuned and exported, and the dashboard of the demo is
opened and ended. The wheel is tried with every Python at hand, the sdist with the first. Prints a table; ends with
1 where something fails.
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


def interpreters() -> list[str]:
    """A Python of each supported version: on the PATH, or one of pyenv."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    found = [
        next(map(str, sorted(pyenv.glob(f"{version}.*/bin/python"))), None) or shutil.which(f"python{version}")
        for version in VERSIONS
    ]
    return [path for path in found if path] or [sys.executable]


def build(folder: Path) -> list[Path]:
    """The wheel and the sdist, which twine finds fit for the package index."""
    run([sys.executable, "-m", "build", "--outdir", folder, ROOT], folder)
    packages = [*folder.glob("*.whl"), *folder.glob("*.tar.gz")]
    run([sys.executable, "-m", "twine", "check", "--strict", *packages], folder)
    return packages


def attempt(python: str, package: Path, folder: Path) -> list[str]:
    """Install the package and use it; what to print of it."""
    run([python, "-m", "venv", folder / "env"], folder)
    bin_folder = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
    run([bin_folder / "python", "-m", "pip", "install", "--quiet", package], folder)
    kalscope = bin_folder / "kalscope"
    answer = run([kalscope, "tune", "demo", "--lag-ms", "50", "-o", "tuning.toml"], folder)
    run([kalscope, "export", "tuning.toml", "--to", "arduino", "-o", "kalscope_filter"], folder)
    size = sum(file.stat().st_size for file in (folder / "env").rglob("*") if file.is_file()) / 1e6
    version = run([bin_folder / "python", "-V"], folder).split()[1]
    lag = next(line.split(",")[0] for line in answer.splitlines() if line.startswith("lag"))
    return [version, package.suffix.strip("."), f"{size:.0f} MB", lag, open_demo(kalscope, folder)]


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


def run(command: Sequence[str | Path], folder: Path) -> str:
    """Run a command outside the checkout; what it printed. CalledProcessError where it fails."""
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run([*map(str, command)], cwd=folder, env=clean, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.stderr.write(done.stdout + done.stderr)
        done.check_returncode()
    return done.stdout


def main() -> None:
    """Print one line for each installation."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", action="append", help="an interpreter; default: each supported one at hand")
    pythons = parser.parse_args().python or interpreters()
    print("| Python | package | environment | tune demo --lag-ms 50 | open demo |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        packages = build(Path(folder))
        for python, package in [*((python, packages[0]) for python in pythons), (pythons[0], packages[1])]:
            with tempfile.TemporaryDirectory(dir=folder) as own:
                print(f"| {' | '.join(attempt(python, package, Path(own)))} |", flush=True)


if __name__ == "__main__":
    main()
