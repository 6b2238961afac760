"""Hostile files and boards: the result of each, and the time and the memory that it takes.

    python benchmarks/hostile.py [--small] [--only WORD] [--files | --boards]

The table of `tests/support/hostile`, as in `make soak`; each file and board in a process of its own. Prints
markdown, with processor time in seconds. Exit status 1 where a result is not as it must be, or a case
takes more memory than it may.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

SUPPORT = Path(__file__).parents[1] / "tests" / "support"
sys.path[:0] = [str(SUPPORT / "hostile"), str(SUPPORT)]

from hostile_boards import BOARDS, listen  # noqa: E402
from hostile_case import MIB, Seen, examine, in_child  # noqa: E402
from packed_files import PACKED  # noqa: E402
from special_files import SPECIAL  # noqa: E402
from text_files import TEXTS  # noqa: E402

from kalscope import read_recording  # noqa: E402

COUNTED = "0 lines too many, 0 uncounted, "
"""How the outcome of a board begins of which every line is in one count."""
WARM = "".join(f"{i},{i % 7}.5\n" for i in range(9000))


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="the small ones, as in the suite")
    parser.add_argument("--only", default="", help="those whose name holds this word")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--files", action="store_true")
    which.add_argument("--boards", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="kalscope-hostile-") as folder:
        os.chdir(folder)  # a socket must have a short path
        warm = Path("warm.csv")
        warm.write_text(WARM)
        read_recording(warm)  # what is imported and compiled is no cost of a hostile file
        broken = 0
        for title, rows in (("file", files), ("board", boards)):
            if (options.files, options.boards) in ((False, False), (title == "file", title == "board")):
                print(f"\n| {title} | what comes of it | s | MiB, of at most |\n|---|---|---|---|")
                broken += sum(
                    shown(name, seen, most, is_right=right)
                    for name, seen, most, right in rows(Path(folder), big=not options.small, only=options.only)
                )
    return int(broken > 0)


def shown(name: str, seen: Seen, most: int, *, is_right: bool) -> bool:
    """Print one row; whether it breaks its bounds."""
    broken = not is_right or seen.mib > most
    outcome = " ".join(seen.outcome.removeprefix(COUNTED).split()).replace("|", "/")[:100]
    print(
        f"| {name} | {outcome} | {seen.seconds:.2f} | {seen.mib:.0f} / {most}{' **!**' if broken else ''} |",
        flush=True,
    )
    return broken


def files(folder: Path, *, big: bool, only: str) -> Iterator[tuple[str, Seen, int, bool]]:
    """Name, what was seen, most MiB, and whether it came out right, of each file."""
    for case in (*TEXTS, *PACKED, *SPECIAL):
        if only in case.name and (big or case.small):
            path = folder / case.file
            case.make(path, case.big if big else case.small)
            size = path.lstat().st_size
            seen = in_child(multiprocessing.get_context("fork"), examine, path, case.during)
            if path.is_dir():
                path.rmdir()
            else:
                path.unlink(missing_ok=True)
            is_right = re.match(case.expects(big=big), seen.outcome) is not None
            yield f"{case.name}{sized(size)}", seen, case.big_mib if big else case.mib, is_right


def boards(folder: Path, *, big: bool, only: str) -> Iterator[tuple[str, Seen, int, bool]]:
    """The same of each board."""
    for board in BOARDS:
        if only in board.name:
            own = folder / "board"
            own.mkdir()
            count = board.big if big else board.small
            seen = in_child(multiprocessing.get_context("fork"), listen, board.name, count, own)
            for path in own.iterdir():
                path.unlink()
            own.rmdir()
            is_right = seen.outcome.startswith(COUNTED)
            yield f"{board.name}", seen, board.mib, is_right


def sized(size: int) -> str:
    """How large a file is, where that says something."""
    return f", {size / MIB:.0f} MB" if size > MIB else f", {size / 1024:.0f} kB" if size > 4096 else ""


if __name__ == "__main__":
    sys.exit(main())
