"""What is no ordinary file under the name of one, and files that change while they are read."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path

from tests.sources.text_files import text
from tests.support.hostile_case import Case

ORDINARY = "refused: file must be an ordinary file"


def link_to(target: str) -> Callable[[Path, int], None]:
    return lambda path, _: path.symlink_to(target)


def listening(path: Path, _: int) -> None:
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(os.path.relpath(path))  # a path of a socket has 107 letters at most


def rows(path: Path, size: int) -> None:
    path.write_text("".join(f"{i},{i % 7}.5\n" for i in range(size)))


def grow(path: Path) -> None:
    with path.open("a") as file:
        file.writelines(f"{i},{i % 7}.5\n" for i in range(1000))


def overwrite(path: Path) -> None:
    path.write_bytes(bytes(range(256)) * 4096)


def shrink(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def empty(path: Path) -> None:
    os.truncate(path, 0)


def changed(name: str, change: Callable[[Path], object], expected: str) -> Case:
    return Case(f"a file that {name}", rows, expected, 5000, 500_000, during=change)


SPECIAL = (
    Case("a pipe", lambda path, _: os.mkfifo(path), ORDINARY),
    Case("a socket", listening, ORDINARY),
    Case("/dev/zero", link_to("/dev/zero"), ORDINARY),
    Case("/dev/tty", link_to("/dev/tty"), ORDINARY),
    Case("a folder", lambda path, _: path.mkdir(), "refused: source must be a file"),
    Case("a link to itself", link_to("log.csv"), "refused: cannot read"),
    Case("a link to nothing", link_to("nothing"), "refused: file not found"),
    Case("an empty file", text(""), "refused: log.csv must hold lines of numbers"),
    Case("the memory of the process", link_to("/proc/self/mem"), "refused: "),
    changed("grows", grow, "read: [0-9]+ rows"),
    changed("shrinks", shrink, "read: [0-9]+ rows"),
    changed("is emptied", empty, "refused: log.csv must hold a whole line"),
    changed("vanishes", os.unlink, "refused: reading .* failed midway"),
    changed("becomes noise", overwrite, "refused: log.csv must hold a whole line"),
)  # fmt: skip
