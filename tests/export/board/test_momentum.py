"""The constants that a board computes for itself, against the exact ones in double."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope.export.board import momentum_on_board
from kalscope.filtering.kernels import transition

F = np.float32


def test_the_constants_of_a_board_are_exact_to_a_few_steps_of_float32():
    q = F(0.7)
    for tau in np.geomspace(1e-3, 1e5, 500).astype(F):
        own = momentum_on_board(q, tau)
        assert own is not None
        e, f, q11, q12, q22 = transition(1.0, float(q), float(tau))
        assert own.e == pytest.approx(e, abs=2e-7)
        np.testing.assert_allclose([own.f, own.q11, own.q12, own.q22], [f, q11, q12, q22], rtol=1e-6)
        assert own.w0 == F(F(F(0.5) * q) / tau)
        assert {type(value) for value in vars(own).values()} == {F}
