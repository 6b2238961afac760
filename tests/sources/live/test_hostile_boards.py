"""Boards that send what no board should: every line is in one count, memory is bounded, and what follows is heard.

`make soak` sends more of each.
"""

from __future__ import annotations

import random
import re
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.support.effort import FUZZ
from tests.support.forked import fork_server
from tests.support.hostile_case import Seen, busy_s, in_child, outcome_of, peak_mib
from tests.support.waiting import wait_until

from kalscope.sources.live.source import LiveSource

LINE_END = re.compile(rb"\r\n|\r|\n")
GOOD_ROWS = 400
"""Rows of an ordinary board that follow: of the program that the board runs after its fault was mended."""
PIECE = 1 << 16


@dataclass(frozen=True)
class Board:
    """A row of the table."""

    name: str
    """What it sends, in a few words."""
    send: Callable[[int], Iterator[bytes]]
    """The bytes of this many lines, or pieces, which end with the end of a line."""
    small: int
    """How many in the suite."""
    big: int
    """How many in `make soak` and in the table of benchmarks."""
    mib: int
    """Most memory that listening to the many may add, in MiB; to the few, half of it."""


def lines(line: Callable[[int], bytes]) -> Callable[[int], Iterator[bytes]]:
    return lambda count: map(line, range(count))


def endless(run: bytes) -> Callable[[int], Iterator[bytes]]:
    """One line of `count` KiB."""

    def send(count: int) -> Iterator[bytes]:
        for _ in range(count):
            yield run * (1024 // len(run))
        yield b"\n"

    return send


def noise(count: int) -> Iterator[bytes]:
    draw = random.Random(5)
    for _ in range(count):
        yield draw.randbytes(64)
    yield b"\n"


def listen(name: str, count: int, folder: Path) -> Seen:
    """Record the board of this name in this process, which must be a fresh one, and read what was recorded."""
    board = next(board for board in BOARDS if board.name == name)
    memory, busy = peak_mib(), busy_s()
    path = folder / "board.csv"
    with socket.create_server(("127.0.0.1", 0)) as server:
        live = LiveSource(f"socket://127.0.0.1:{server.getsockname()[1]}")
        live.open()
        live.record(path)
        live.start()
        with server.accept()[0] as connection:
            sent = send(connection, board.send(count))
            # The last line may wait for what follows its \r.
            wait_until(lambda: live.status().received >= sent - 1, "the lines of its fault")
            sent += send(connection, (b"%d.25,%d.5\n" % (i % 9, i) for i in range(GOOD_ROWS)))
            wait_until(lambda: live.status().received >= sent, "all lines")
            status, snapshot = live.status(), live.snapshot()
            live.close()
    shown = live.snapshot() or snapshot
    total = status.accepted + status.rejected + status.dropped
    outcome = (
        f"{status.received - sent} lines too many, {status.received - total} uncounted,"
        f" {status.accepted} accepted, {status.rejected} rejected, {status.dropped} dropped,"
        f" {len(shown.recording.names) if shown else 0} channels; {outcome_of(path, None)}"
    )
    return Seen(outcome, peak_mib() - memory, busy_s() - busy)


def send(connection: socket.socket, pieces: Iterable[bytes]) -> int:
    """Send the pieces, and return how many lines end in them."""
    held, last, ends = bytearray(), b"", 0
    for piece in pieces:
        ends += len(LINE_END.findall(piece)) - (last == b"\r" and piece.startswith(b"\n"))
        held, last = held + piece, piece[-1:]
        if len(held) > PIECE:
            connection.sendall(held)
            held.clear()
            time.sleep(0.002)  # a board that pauses now and then: not a flood, which has tests of its own
    connection.sendall(held)
    return ends


ESCAPES = b"\x1b]52;c;ZXZpbA==\x07\x1b[2J\x1b[31m1,2\x1b[0m\n"
MIB = 1024
BOARDS = (
    Board("noise", noise, 100, 4_000, 40),
    Board("no end of a line, digits", endless(b"1"), MIB, 100 * MIB, 40),
    Board("lines of 1 MB", lines(lambda i: b"%d," % i + b"7," * 500_000 + b"\n"), 2, 50, 40),
    Board("a new label on each line", lines(b"label%d:1\n".__mod__), 1000, 100_000, 100),
    Board("many labels", lines(lambda i: b" ".join(b"l%d:%d" % (k, i) for k in range(2000)) + b"\n"), 2, 50, 100),
    Board("new widths", lines(lambda i: b",".join([b"%d" % i] * (i % 300 + 1)) + b"\n"), 300, 5_000, 100),
    Board("a header above each row", lines(lambda i: b"n%d,m%d\n%d,%d\n" % (i, i, i, i + 1)), 60, 2_000, 60),
    Board("a new program every 40 lines", lines(lambda i: (b"%d;%d;%d\n", b"a:%d,b:%d,c:%d\n",
        b"%d\t%d %d\n")[i // 40 % 3] % (i, i, i)), 500, 10_000, 60),
    Board("escape sequences", lines(lambda _: ESCAPES), 300, 20_000, 60),
    Board("carriage returns alone", lines(b"%d,1.5\r".__mod__), 1000, 300_000, 60),
    Board("zeros between lines", lines(lambda _: bytes(30) + b"\n"), 1000, 150_000, 40),
    Board("open quotes and brackets", lines(lambda i: b'"[{(' * (i % 50) + b"1,2\n"), 1000, 100_000, 60),
    Board("JSON nested deep", lines(lambda _: b'{"a":' * 5000 + b"1" + b"}" * 5000 + b"\n"), 20, 200, 40),
    Board("numbers that are none", lines(lambda i: (b"1e999,", b"nan,", b"9" * 400 + b",", b"0x1F,",
        b"--1,")[i % 5] + b"%d\n" % i), 1000, 300_000, 60),
    Board("stamps that jump", lines(lambda i: b"t:%d,x:%d\n" % (10 ** (i % 19), i)), 500, 300_000, 60),
    Board("255 channels", lines(lambda i: b",".join([b"%d" % i] * 255) + b"\n"), 100, 20_000, 400),
)  # fmt: skip


pytestmark = pytest.mark.slow

BIG = FUZZ > 1
OUTCOME = re.compile(
    r"0 lines too many, 0 uncounted, (\d+) accepted, \d+ rejected, \d+ dropped, .*; re(ad|fused): .*"
)
LATE = 40
"""Good rows that may be lost until it is clear that the board runs another program."""


@pytest.mark.parametrize("board", BOARDS, ids=[board.name for board in BOARDS])
def test_a_hostile_board_is_counted_and_a_good_one_heard_after_it(tmp_path, board):
    seen = in_child(fork_server(), listen, board.name, board.big if BIG else board.small, tmp_path)
    outcome = OUTCOME.fullmatch(seen.outcome)
    assert outcome, seen.outcome
    assert int(outcome[1]) >= GOOD_ROWS - LATE, seen.outcome
    assert seen.mib <= board.mib / (1 if BIG else 2)
