"""Whatever a board sends: every line is in one count, memory is bounded, and what follows is heard.

The table is in `tests/support/hostile`; `make soak` sends more of each, and `benchmarks/hostile.py` prints it.
"""

from __future__ import annotations

import re

import pytest
from each import each
from effort import FUZZ
from forked import fork_server
from hostile_boards import BOARDS, GOOD_ROWS, listen
from hostile_case import in_child

from kalscope.sources.live.samples import MAX_NUMBERS, LiveSamples
from kalscope.sources.port.reader import SYSTEM
from kalscope.sources.port.registry import port_of
from kalscope.sources.reading.line_parser import LineParser

pytestmark = pytest.mark.slow

BIG = FUZZ > 1
OUTCOME = re.compile(
    r"0 lines too many, 0 uncounted, (\d+) accepted, \d+ rejected, \d+ dropped, .*; re(ad|fused): .*"
)
LATE = 40
"""Good rows that may be lost until it is clear that the board runs another program."""


@each("board", BOARDS, ids=[board.name for board in BOARDS])
def test_a_hostile_board_is_counted_and_a_good_one_heard_after_it(tmp_path, board):
    seen = in_child(fork_server(), listen, board.name, board.big if BIG else board.small, tmp_path)
    outcome = OUTCOME.fullmatch(seen.outcome)
    assert outcome, seen.outcome
    assert int(outcome[1]) >= GOOD_ROWS - LATE, seen.outcome
    assert seen.mib <= board.mib / (1 if BIG else 2)


def test_of_many_channels_fewer_samples_are_kept():
    parser = LineParser()
    parser.feed(b"1.5," * 254 + b"2.5\n")
    event = parser.next_line()
    assert event is not None
    assert parser.layout is not None
    samples = LiveSamples(port_of("/dev/ttyACM0"), 1_000_000, SYSTEM)
    samples.keep([(0.0, event)], parser.layout)
    assert samples._store is not None
    assert samples._store.keep == MAX_NUMBERS // 255
