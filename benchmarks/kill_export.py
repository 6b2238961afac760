"""Kill `kalscope export` at random moments and count the files that are neither the old nor the new ones.

    python benchmarks/kill_export.py --kills 100

A child exports two tunings in turn over the same files, all targets, as fast as it can; it is ended by kill -9.
"""

from __future__ import annotations

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from kalscope import BadSetting, ChannelTuning, Tuning, export_tuning, save_tuning
from kalscope.export.registry import TARGETS

CHANNELS = {"arduino": 6, "matlab": 20}
"""Channels of an export: the sketch holds six, MATLAB makes a file for each; else as below."""
MANY_CHANNELS = 300

CHILD = """
import sys
from pathlib import Path
from kalscope import export_tuning, load_tuning
from kalscope.export.registry import write_files
base, targets = Path(sys.argv[1]), sys.argv[2].split(",")
tunings = {target: [load_tuning(base / f"{target}-{i}.toml") for i in range(2)] for target in targets}
print("ready", flush=True)
while True:
    for target in targets:
        for tuning in tunings[target]:
            write_files(export_tuning(tuning, target), base / "out" / target, force=True)
"""


def tunings(target: str) -> tuple[Tuning, Tuning]:
    """Two tunings of the same channels, so that both make files of the same names."""

    def one(q: float) -> Tuning:
        count = CHANNELS.get(target, MANY_CHANNELS)
        channels = tuple(ChannelTuning(f"channel {i}", "V", q, 1.0 + i) for i in range(count))
        return Tuning(channels, sample_period=0.01, tool="kill_export", date="today")

    return one(0.01), one(0.02)


def whole_texts(base: Path) -> dict[str, dict[str, set[str]]]:
    """The texts that each file of each target may hold; the tunings are saved in `base`."""
    allowed: dict[str, dict[str, set[str]]] = {}
    for target in TARGETS:
        pair = tunings(target)
        try:
            both = [export_tuning(tuning, target) for tuning in pair]
        except BadSetting:
            continue  # a refusal writes nothing
        allowed[target] = {name: {files[name] for files in both} for name in both[0]}
        for i, tuning in enumerate(pair):
            save_tuning(tuning, base / f"{target}-{i}.toml")
    return allowed


def kill_once(command: list[str], wait: float) -> None:
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(wait)
        child.send_signal(signal.SIGKILL)


def broken_files(folder: Path, allowed: dict[str, dict[str, set[str]]]) -> tuple[int, int]:
    """(files looked at, files that are neither the old nor the new text)."""
    seen = broken = 0
    for target, files in allowed.items():
        for name, texts in files.items():
            path = folder / target / name
            if path.exists():
                seen += 1
                broken += path.read_bytes().decode() not in texts
    return seen, broken


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as name:
        base = Path(name)
        allowed = whole_texts(base)
        seen = broken = 0
        for _ in range(options.kills):
            order = rng.sample(sorted(allowed), len(allowed))  # so that the kills meet all of them
            kill_once([sys.executable, "-c", CHILD, name, ",".join(order)], rng.uniform(0.0, 0.5))
            looked, torn = broken_files(base / "out", allowed)
            seen, broken = seen + looked, broken + torn
        leftovers = len(list(base.rglob(".*.tmp")))
    print(f"targets: {', '.join(allowed)}")
    print(
        f"{options.kills} kills: {broken} broken of {seen} files looked at; {leftovers} temporary files left over"
    )
    return 1 if broken or not seen else 0


if __name__ == "__main__":
    sys.exit(main())
