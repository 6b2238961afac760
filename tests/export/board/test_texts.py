"""Commands, answers and rows of a board as texts; tests/device has them with a board."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams
from kalscope.export.board import (
    BoardAnswer,
    BoardCheck,
    FixedFilter,
    check_board,
    commands,
    is_refusal,
    momentum_on_board,
    read_answer,
)
from kalscope.export.float32 import Float32Params, filter_float32, float32_params, without_momentum

F = np.float32


def test_a_command_says_the_float32_exactly_and_fits_the_line_of_a_board():
    rng = np.random.default_rng(2)
    values = rng.integers(0x00800000, 0x7E000000, (500, 3), dtype=np.uint32).view(np.float32)
    for q, r, p0 in values:
        tau = F(10.0 ** rng.uniform(-3, 5))
        momentum = replace(without_momentum(q), momentum=tau)
        lines = commands(Float32Params(q, r, p0, momentum=momentum), channel=6, knows_momentum=True)
        assert max(map(len, lines)) <= 30  # letters that the exported sketch takes in a line
        said = {line.split()[1]: F(line.split()[2]) for line in lines}
        assert said == {"q": q, "r": r, "t": tau, "p": p0}


def test_momentum_goes_to_a_board_that_knows_it_only_and_is_switched_off_there():
    plain, held = (float32_params(FilterParams(0.5, 4.0, momentum=momentum)) for momentum in (0.0, 20.0))
    assert commands(plain) == ("q 0.5", "r 4", "p inf")
    assert commands(float32_params(FilterParams(0.0, 4.0))) == ("r 4", "q 0", "p inf")  # zero after the other
    assert commands(plain, knows_momentum=True) == ("q 0.5", "r 4", "t 0", "p inf")
    assert commands(held, 2, knows_momentum=True) == ("2 q 0.5", "2 r 4", "2 t 20", "2 p inf")
    with pytest.raises(BadSetting, match=r"momentum must be 0 for this board, .* \(got 20 samples\): export"):
        commands(held)
    with pytest.raises(BadSetting, match=r"at least 0.001 samples for a board \(got 0.0001\)"):
        commands(float32_params(FilterParams(0.5, 4.0, momentum=1e-4)), knows_momentum=True)


def test_an_answer_says_which_filter_the_board_runs():
    """With momentum, behind a median, or one that takes no values."""
    line = "# light q=1.000000e-2 r=4.000000 p=inf t=20.000000 m=5 bits=3C23D70A,40800000,7F800000,41A00000\r\n"
    answer = read_answer(line)
    assert answer == BoardAnswer("light", F(0.01), F(4.0), F(np.inf), F(20.0), 5)
    asked = float32_params(FilterParams(1e-14, 4.0, gate=9.0, momentum=10.0))
    used = answer.applied_to(asked)
    assert (used.q, used.r, used.gate, used.median) == (F(0.01), F(4.0), F(9.0), 5)
    assert used.momentum == momentum_on_board(F(0.01), F(20.0))
    assert replace(answer, momentum=F(0.0)).applied_to(asked).momentum is None
    plain = read_answer(line.replace(" t=20.000000 m=5", "").replace(",41A00000", ""))
    assert plain == BoardAnswer("light", F(0.01), F(4.0), F(np.inf))
    fixed = "# tilt takes no values while it runs: export the sketch again to change it\r\n"
    assert read_answer(fixed) == FixedFilter("tilt")


def test_any_other_line_is_no_answer():
    for line in (
        "512.0,500.5",
        "# raw,filtered",
        "# too slow: samples left out: 3",
        "# a q=1 r=1 p=1 bits=1,2,3",
        "",
    ):
        assert (read_answer(line), is_refusal(line)) == (None, False)


PARAMS = Float32Params(F(0.01), F(4.0))


@pytest.mark.parametrize("params", [PARAMS, replace(PARAMS, p0=F(2.0), x0=F(500.0))])
def test_from_its_restart_on_a_board_is_equal_or_its_distance_is_told(params):
    rng = np.random.default_rng(5)
    raw = rng.integers(0, 1024, 500).astype(F)
    before = np.cumsum(rng.random(100)).astype(F) + F(0.37)  # another filter, before the restart
    board = np.concatenate([before, filter_float32(raw[100:], params)])
    assert check_board(raw, board, params) == BoardCheck(400, 0, 0.0)
    exact = float(board[300])
    board[300] = np.nextafter(board[300], F(np.inf))
    assert check_board(raw, board, params) == BoardCheck(400, 1, float(board[300]) - exact)
    assert check_board(raw[:100], board[:100], params) is None
    other = replace(params, q=F(0.0100001))
    assert check_board(raw, board, other).different > 100
    raw[200] = np.nan
    board[100:] = filter_float32(raw[100:], params)
    board[250] = np.nan  # a line that was rejected
    assert check_board(raw, board, params) == BoardCheck(399, 0, 0.0)


@pytest.mark.parametrize("resting", [0, 1, 8, 200])
def test_a_restart_while_the_input_rests_is_found_where_it_was(resting):
    """The old filter has come to rest on the input: each of its rows looks like a start."""
    old, new = Float32Params(F(1.0), F(1.0)), Float32Params(F(1e-4), F(1.0))
    rest, later = np.full(200 + resting, 512.0), np.concatenate([np.full(20, 512.0), 512 + np.arange(400.0) % 300])
    board = np.concatenate([filter_float32(rest, old)[200:], filter_float32(later, new)])
    check = check_board(np.concatenate([rest[200:], later]), board, new)
    assert check.different == 0
    assert check.rows >= len(later)
    board[-1] += 1.0
    assert check_board(np.concatenate([rest[200:], later]), board, new).different == 1
