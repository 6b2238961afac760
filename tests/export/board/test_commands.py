"""Commands and answers as texts; tests/device has them with a board."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import FilterParams
from kalscope.export.board.commands import BoardAnswer, commands, is_refusal, read_answer
from kalscope.export.float32 import Float32Params, float32_params

MAX_LINE = 30
"""Letters that the exported sketch takes in a line."""


def test_a_command_says_the_float32_exactly_and_fits_the_line_of_a_board():
    rng = np.random.default_rng(2)
    values = rng.integers(0x00800000, 0x7E000000, (500, 3), dtype=np.uint32).view(np.float32)
    for q, r, p0 in values:
        lines = commands(Float32Params(q, r, p0), channel=6)
        assert max(map(len, lines)) <= MAX_LINE
        said = {line.split()[1]: np.float32(line.split()[2]) for line in lines}
        assert said == {"q": q, "r": r, "p": p0}


def test_zero_comes_after_the_other_and_the_start_comes_last():
    assert commands(float32_params(FilterParams(0.0, 4.0))) == ("r 4", "q 0", "p inf")
    assert commands(float32_params(FilterParams(0.5, 0.0, 2.0)), channel=2) == ("2 q 0.5", "2 r 0", "2 p 2")


def test_an_answer_is_read_from_its_bits():
    line = "# light q=1.000000e-2 r=4.000000 p=inf bits=3C23D70A,40800000,7F800000\r\n"
    expected = BoardAnswer("light", np.float32(0.01), np.float32(4.0), np.float32(np.inf))
    assert read_answer(line) == expected


@pytest.mark.parametrize(
    "line", ["512.0,500.5", "# raw,filtered", "# too slow: samples left out: 3", "# a q=1 r=1 p=1 bits=1,2,3", ""]
)
def test_any_other_line_is_no_answer(line):
    assert read_answer(line) is None
    assert not is_refusal(line)
