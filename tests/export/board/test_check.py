"""A board's rows against ours: equal from its restart on, and every other float32 counted in steps."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope.export.board import check_board, find_restarts
from kalscope.export.float32 import Float32Params, filter_float32

PARAMS = Float32Params(np.float32(0.01), np.float32(4.0))


@pytest.fixture
def rows():
    rng = np.random.default_rng(5)
    raw = rng.integers(0, 1024, 500).astype(np.float32)
    before = np.cumsum(rng.random(100)).astype(np.float32) + np.float32(0.37)  # another filter, before the restart
    return raw, np.concatenate([before, filter_float32(raw[100:], PARAMS)])


def test_from_the_restart_on_an_equal_board_is_equal(rows):
    raw, board = rows
    assert find_restarts(raw, board, PARAMS)[0] == 100
    check = check_board(raw, board, PARAMS)
    assert (check.rows, check.different, check.largest_steps, check.largest) == (400, 0, 0, 0.0)


@pytest.mark.parametrize("steps", [1, 5, -3])
def test_distances_are_counted_in_float32_steps(rows, steps):
    raw, board = rows
    board = board.copy()
    for _ in range(abs(steps)):
        board[300] = np.nextafter(board[300], np.float32(np.inf if steps > 0 else -np.inf))
    check = check_board(raw, board, PARAMS)
    assert (check.different, check.largest_steps) == (1, abs(steps))
    assert check.largest == abs(float(board[300]) - float(rows[1][300]))


def test_steps_are_counted_across_zero():
    raw = np.array([0.0, 0.0], dtype=np.float32)
    board = np.array([0.0, -np.finfo(np.float32).smallest_subnormal], dtype=np.float32)
    assert check_board(raw, board, PARAMS).largest_steps == 1


def test_a_restart_from_a_given_estimate_is_found_too(rows):
    raw, board = rows
    params = Float32Params(np.float32(0.01), np.float32(4.0), np.float32(2.0), np.float32(500.0))
    board = np.concatenate([board[:100], filter_float32(raw[100:], params)])
    assert find_restarts(raw, board, params)[0] == 100
    assert check_board(raw, board, params).different == 0


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


def test_without_a_restart_there_is_nothing_to_compare(rows):
    raw, board = rows
    assert check_board(raw[:100], board[:100], PARAMS) is None


def test_another_filter_is_seen(rows):
    raw, board = rows
    other = Float32Params(np.float32(0.0100001), np.float32(4.0))
    assert check_board(raw, board, other).different > 100


def test_missing_samples_are_no_difference(rows):
    raw, board = rows
    raw, board = raw.copy(), board.copy()
    raw[200] = np.nan
    board[100:] = filter_float32(raw[100:], PARAMS)
    board[250] = np.nan  # a line that was rejected
    check = check_board(raw, board, PARAMS)
    assert (check.rows, check.different) == (399, 0)
