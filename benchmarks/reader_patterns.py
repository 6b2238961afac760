"""What the reader's patterns and parsers cost at worst: 1, 2, 4 … 64 kB of hostile text, and how the time grows.

    python benchmarks/reader_patterns.py [--json] [--only WORD]

Every regular expression that a module of `kalscope.sources` holds is found by importing the modules, so that none
is forgotten; with them are the functions that outside text goes through, and the whole reader on a file with a
hostile line. Each gets a thousand texts of 1 kB; the three slowest are doubled up to 64 kB. Exit status 1
where the time grows faster than n to the 1.5, or the whole reader takes 50 ms for a hostile line of 64 kB.
"""

from __future__ import annotations

import argparse
import importlib
import itertools
import json
import math
import pkgutil
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import kalscope.sources
from kalscope import read_recording
from kalscope.errors import KalscopeError
from kalscope.sources.grammar import cells, line_format, timestamps
from kalscope.sources.grammar.line_format import find_labels
from kalscope.sources.grammar.read_options import DEFAULTS
from kalscope.sources.reading.columns import named_column
from kalscope.sources.reading.line_parser import LineParser
from kalscope.sources.reading.line_reader import LineReader
from kalscope.sources.reading.preface import find_preface
from kalscope.sources.reading.sniffer import sniff

SIZES = (1024, 2048, 4096, 8192, 16384, 32768, 65536)
TRIED = 1024
MAX_SECONDS, MAX_GROWTH, MAX_READER_MS = 2.0, 1.5, 50.0
MIN_SECONDS = 2e-4
"""Below this the clock says nothing about growth."""
LEADS = (
    "",
    "# unit ",
    "# unit a",
    ">a:",
    "12:00:00 -> ",
    "2024-01-01 ",
    "1,2,",
    "a:",
    "a (",
    '"',
    "$1*",
    "23-Feb-2022 ",
)
RUNS = [
    *' 1a.,:;-"_/|[]({#%=*§Ee\t\\',
    "1 ",
    "1,",
    "a:",
    "a: ",
    "1.",
    "1-",
    ' "',
    '",',
    "[]",
    "a b ",
    "a=1 ",
    "1 1,",
    "- ",
]
BREAKERS = ("", "x", "\x00")
ROWS = [f"{0.01 * i:.2f},{20 + i % 7},{i % 5}.5" for i in range(200)]

Entry = Callable[[str], object]


def main() -> int:
    """Measure and print; the exit status says whether the promise holds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--only", default="", help="entries whose name holds this word")
    options = parser.parse_args()
    found = []
    for name, entry in (*patterns(), *parsers()):
        if options.only in name:
            found.append(worst(name, entry))
            if not options.json:
                print_line(found[-1])
    if options.json:
        print(json.dumps(found))
    return int(any(row["broken"] for row in found))


def patterns() -> Iterator[tuple[str, Entry]]:
    """Every pattern of the reader, used as its source uses it: anchored, or from every place."""
    folder = Path(kalscope.sources.__file__).parent
    text = "\n".join(path.read_text("utf-8") for path in folder.rglob("*.py"))
    seen = set()
    for info in pkgutil.walk_packages([str(folder)], "kalscope.sources."):
        for name, value in vars(importlib.import_module(info.name)).items():
            held = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else (value,)
            for pattern in held:
                if isinstance(pattern, re.Pattern) and isinstance(pattern.pattern, str) and pattern not in seen:
                    seen.add(pattern)
                    uses = set(re.findall(rf"\b{name}(?:\[\w+\])?\.(match|fullmatch)\(", text))
                    searched = re.search(rf"\b{name}(?:\[\w+\])?\.(search|sub|split|find)", text)
                    use = pattern.findall if searched or not uses else getattr(pattern, min(uses))
                    yield f"{info.name.removeprefix('kalscope.sources.')}:{name}", use


def parsers() -> Iterator[tuple[str, Entry]]:
    """The functions that outside text goes through."""
    for mark in (",", ";", " "):
        yield f"split_fields {mark!r}", partial(cells.split_fields, delimiter=mark)
    for mark in ".,":
        yield f"parse_number {mark!r}", partial(cells.parse_number, decimal=mark)
    for function in (find_labels, line_format.split_teleplot, line_format.split_stamp):
        yield function.__name__, function
    yield "split_checksum", line_format.split_checksum
    for order in ("ymd", "dmy"):
        yield f"parse_calendar {order}", partial(timestamps.parse_calendar, order=order)
    yield "parse_clock", timestamps.parse_clock
    yield "named_column", named_column
    yield "find_preface", lambda text: find_preface([text, *ROWS[:20]])
    yield "sniff, above the rows", lambda text: sniff([text, *ROWS[:20]], DEFAULTS)
    yield "sniff, between the rows", lambda text: sniff([*ROWS[:10], text, *ROWS[10:20]], DEFAULTS)
    for name, head in (("table", ROWS[:20]), ("labels", [f"a:{i},b:{i}.5" for i in range(20)])):
        layout = sniff(head, DEFAULTS)
        assert layout is not None
        yield f"LineReader.read, {name}", partial(LineReader(layout).read, 1)
    yield "LineParser", stream
    folder = Path(tempfile.mkdtemp(prefix="kalscope-bench-"))
    for name, above in (("above", 0), ("between", 100)):
        yield f"read_recording, {name}", partial(read_file, folder / "log.txt", above)


def stream(text: str) -> None:
    """A live stream with the hostile line in it."""
    lines = LineParser()
    lines.feed(("\n".join([*ROWS[:10], text, *ROWS[10:20]]) + "\n").encode())
    for _ in lines:
        pass


def read_file(path: Path, above: int, text: str) -> None:
    """A file with `above` rows, the hostile line and other rows."""
    path.write_text("\n".join([*ROWS[:above], text, *ROWS[above:]]) + "\n", "utf-8")
    with suppress(KalscopeError):
        read_recording(path)


def hostile(size: int, lead: str, run: str, breaker: str) -> str:
    """A text of `size` characters."""
    return lead + run * ((size - len(lead) - len(breaker)) // len(run)) + breaker


def seconds_of(entry: Entry, text: str, turns: int = 1) -> float:
    """The shortest of several times of the processor."""
    shortest = math.inf
    for _ in range(turns):
        begin = time.process_time()
        entry(text)
        shortest = min(shortest, time.process_time() - begin)
    return shortest


def worst(name: str, entry: Entry) -> dict[str, object]:
    """The times of the worst text of an entry, in ms by size, and the exponent of their growth."""
    entry("1,2,3")  # what is made at the first call is no cost of the text
    shapes = list(itertools.product(LEADS, RUNS, BREAKERS))
    slowest = sorted(shapes, key=lambda shape: -seconds_of(entry, hostile(TRIED, *shape)))[:3]
    found: list[tuple[float, dict[int, float], tuple[str, str, str]]] = []
    for shape in slowest:
        times: dict[int, float] = {}
        for size in SIZES:
            times[size] = seconds_of(entry, hostile(size, *shape), 5)
            if times[size] > MAX_SECONDS:
                break
        found.append((growth(times), times, shape))
    exponent, times, shape = max(found, key=lambda item: (item[0], max(item[1].values())))
    whole = name.startswith("read_recording")
    slow = whole and 1000 * max(times.values()) > MAX_READER_MS
    return {
        "name": name,
        "worst": hostile(24, *shape),
        "ms": {size: 1000 * second for size, second in times.items()},
        "exponent": exponent,
        "broken": exponent > MAX_GROWTH or slow,
    }


def growth(times: dict[int, float]) -> float:
    """Exponent between the first size that takes a measurable time, and the largest; 1 where none does."""
    seen = [(size, second) for size, second in times.items() if second >= MIN_SECONDS]
    if len(seen) < 2:
        largest = max(times)
        return 1.0 if times[largest] < MIN_SECONDS else math.log2(times[largest] / MIN_SECONDS)
    (small, short), (large, long) = seen[0], seen[-1]
    return math.log(long / short) / math.log(large / small)


def print_line(row: dict[str, object]) -> None:
    """One line of the table."""
    times = row["ms"]
    assert isinstance(times, dict)
    shown = "  ".join(f"{second:8.2f}" for second in times.values())
    sign = "  <-- " if row["broken"] else ""
    print(f"{row['name']!s:45} n^{row['exponent']:.2f}  {shown} ms  {row['worst']!r}{sign}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
