"""A board's rows against ours: equal from its restart on, or how far apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kalscope.export.board import BoardCheck, check_board
from kalscope.export.float32 import Float32Params, filter_float32

PARAMS = Float32Params(np.float32(0.01), np.float32(4.0))


@pytest.fixture
def rows():
    rng = np.random.default_rng(5)
    raw = rng.integers(0, 1024, 500).astype(np.float32)
    before = np.cumsum(rng.random(100)).astype(np.float32) + np.float32(0.37)  # another filter, before the restart
    return raw, before


@pytest.mark.parametrize("params", [PARAMS, replace(PARAMS, p0=np.float32(2.0), x0=np.float32(500.0))])
def test_from_its_restart_on_a_board_is_equal_or_its_distance_is_told(rows, params):
    raw, before = rows
    board = np.concatenate([before, filter_float32(raw[100:], params)])
    assert check_board(raw, board, params) == BoardCheck(400, 0, 0.0)
    exact = float(board[300])
    board[300] = np.nextafter(board[300], np.float32(np.inf))
    assert check_board(raw, board, params) == BoardCheck(400, 1, float(board[300]) - exact)
    assert check_board(raw[:100], board[:100], params) is None
    other = replace(params, q=np.float32(0.0100001))
    assert check_board(raw, board, other).different > 100
    raw[200] = np.nan
    board[100:] = filter_float32(raw[100:], params)
    board[250] = np.nan  # a line that was rejected
    assert check_board(raw, board, params) == BoardCheck(399, 0, 0.0)


@pytest.mark.parametrize("resting", [0, 1, 8, 200])
def test_a_restart_while_the_input_rests_is_found_where_it_was(resting):
    """The old filter has come to rest on the input: each of its rows looks like a start."""
    old, new = Float32Params(np.float32(1.0), np.float32(1.0)), Float32Params(np.float32(1e-4), np.float32(1.0))
    rest, later = np.full(200 + resting, 512.0), np.concatenate([np.full(20, 512.0), 512 + np.arange(400.0) % 300])
    board = np.concatenate([filter_float32(rest, old)[200:], filter_float32(later, new)])
    check = check_board(np.concatenate([rest[200:], later]), board, new)
    assert check.different == 0
    assert check.rows >= len(later)
    board[-1] += 1.0
    assert check_board(np.concatenate([rest[200:], later]), board, new).different == 1
