"""How long the reader takes to decide how a log is written: its first 64 KiB, without reading the rest.

    python benchmarks/head_decisions.py [FOLDER] [--json]

Of every text file of a folder (`../shared/data` where it is beside the project, else of generated logs): the
processor time of the best of five. Exit status 1 where one takes 50 ms or more.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from kalscope.errors import KalscopeError
from kalscope.sources.reading.sniffer import sniff

SHARED = Path(__file__).parents[2] / "shared" / "data"
HEAD_BYTES, TURNS, MAX_MS = 65536, 5, 50.0
TEXTS = (".csv", ".txt", ".dat", ".log", ".lvm")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=SHARED)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder if options.folder.is_dir() else made_up(Path(temporary))
        files = [path for path in sorted(folder.rglob("*")) if path.suffix in TEXTS]
        found = {str(path.relative_to(folder)): milliseconds(path) for path in files}
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        for name, spent in sorted(found.items(), key=lambda item: item[1]):
            print(f"{spent:8.1f} ms  {name}")
    return int(max(found.values()) >= MAX_MS)


def milliseconds(path: Path) -> float:
    """Processor time of the best of TURNS, ms."""
    with path.open("rb") as file:
        data = file.read(HEAD_BYTES)
    text = data.decode("utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8", "replace")
    lines = text.splitlines()[: -1 if len(data) == HEAD_BYTES else None]
    spent: list[float] = []
    for _ in range(TURNS):
        begin = time.process_time()
        with suppress(KalscopeError):
            sniff(lines)
        spent.append(time.process_time() - begin)
    return 1000 * min(spent)


def made_up(folder: Path) -> Path:
    """Four usual logs."""
    rows = range(4000)
    (folder / "plain.csv").write_text("t,a,b\n" + "".join(f"{i / 100:.2f},{i % 7},{i % 5}.5\n" for i in rows))
    stamped = "".join(f"2024-03-17 12:{i // 60 % 60:02}:{i % 60:02};{i % 7},5;OK\n" for i in rows)
    (folder / "stamped.csv").write_text("Time;Temp (°C);State\n" + stamped, "utf-8")
    (folder / "labels.txt").write_text("".join(f"temp:{i % 7}.5,hum:{i % 5}\n" for i in rows))
    (folder / "wide.csv").write_text("".join(",".join(str(i + j) for j in range(100)) + "\n" for i in range(400)))
    return folder


if __name__ == "__main__":
    sys.exit(main())
