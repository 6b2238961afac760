"""A folder of small hostile files: noise, damage, bombs, numbers near the ends of float64, odd names, links."""

from __future__ import annotations

import gzip
import io
import json
import os
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

MAGIC = (b"PAR1", b"\x89HDF\r\n\x1a\n", b"#ROSBAG V2", b"PK\x03\x04", b"\x1f\x8b\x08\0", b"LabVIEW Measurement\n")
WORDS = ("nan", "inf", "", "1e308", "-1e308", "1e400", "5e-324", "0")
NAMES = ("-x.csv", "a\nb.csv", "\x1b[2J.csv", "*.csv", "%s.csv", "{x}.csv", "a" * 240 + ".csv", "😀", "\udcff.csv")
ENCODINGS = ("utf-16", "utf-16-be", "utf-32", "cp1252")


def rows(values: object, head: str = "t,x\n", end: str = "\n") -> str:
    return head + "".join(f"{i / 100:.2f},{value}{end}" for i, value in enumerate(values))


def write_hostile(folder: Path, bomb: int) -> int:
    """Write the files; how many rows of a table they are. `bomb`: bytes that the bombs unpack to."""
    folder.mkdir()
    g = np.random.default_rng(5)
    for i, data in enumerate(contents(g, bomb)):
        (folder / f"{i:02d}.csv").write_bytes(data)
    for name in NAMES:
        (folder / name).write_text(rows(walk(g)))
    os.symlink(folder / "loop.csv", folder / "loop.csv")
    os.symlink(folder, folder / "up")
    os.symlink("/dev/zero", folder / "zero.csv")
    os.mkfifo(folder / "pipe.csv")
    (folder / "folder.csv").mkdir()
    return len(os.listdir(folder))


def walk(g: np.random.Generator, n: int = 200) -> list[float]:
    return (np.cumsum(0.3 * g.normal(size=n)) + g.normal(size=n)).round(4).tolist()


def contents(g: np.random.Generator, bomb: int) -> Iterator[bytes]:
    good = rows(walk(g))
    yield from (g.bytes(n) for n in (1, 100, 5000))
    yield from (magic + g.bytes(500) for magic in MAGIC)
    packed = gzip.compress(good.encode())
    yield from (packed[:n] for n in (3, 40, len(packed) - 1))
    yield gzip.compress(b"1,2\n" * (bomb // 4))
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("../log.csv", b"1,2\n" * (bomb // 4))
    yield archive.getvalue()
    for word in WORDS:
        yield rows([word] * 100).encode()
        yield rows([word if i % 9 == 0 else value for i, value in enumerate(walk(g))]).encode()
    yield rows(np.frombuffer(g.bytes(8 * 200)).tolist()).encode()
    for span in (20, 300):
        yield rows(
            f"{a:.3f}e{b}" for a, b in zip(g.normal(size=200), g.integers(-span, span, 200), strict=True)
        ).encode()
    yield good.replace("\n", "\r").encode()
    yield from (good.encode(name) for name in ENCODINGS)
    yield good.replace("1", "\0").encode()
    yield b"1," * 5000
    yield b"\n" * 1000
    yield b""
    yield rows(walk(g, 1)).encode()
    yield rows(walk(g), "x,x\n").encode()
    yield rows(walk(g), "<html>\n").encode()
    yield b"[" * 5000
    yield json.dumps([{"x": float("nan")}, {"x": 1e308}] * 20).encode()
