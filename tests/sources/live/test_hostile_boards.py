"""Whatever a board sends: every line is in one count, memory is bounded, and what follows is heard.

The table is in `tests/support/hostile_case.py`; `make soak` sends more of each.
"""

from __future__ import annotations

import re

import pytest
from tests.sources.hostile_boards import BOARDS, GOOD_ROWS, listen
from tests.support.effort import FUZZ
from tests.support.forked import fork_server
from tests.support.hostile_case import in_child

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
