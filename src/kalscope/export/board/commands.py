"""The commands to a board that runs the exported sketch, and its answers: texts only, no port.

Send one command, wait for its answer, then send the next: a small board buffers 64 characters.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from kalscope.errors import BadSetting
from kalscope.export.board.momentum import momentum_on_board
from kalscope.export.float32 import Float32Params

MIN_MOMENTUM = 1e-3
"""Shortest momentum that a board accepts, sample periods; shorter ones would have no effect."""

_BITS = "([0-9A-F]{8})"
_ANSWER = re.compile(
    rf"# (\w+) q=\S+ r=\S+ p=\S+ (?:t=\S+ )?(?:m=(\d+) )?bits={_BITS},{_BITS},{_BITS}(?:,{_BITS})?\s*"
)
_FIXED = re.compile(r"# (\w+) takes no values while it runs.*\s*")


@dataclass(frozen=True)
class BoardAnswer:
    """The values that a board uses from the next sample on, exact."""

    name: str
    """Identifier of the channel."""
    q: np.float32
    """Process-noise variance, unit²."""
    r: np.float32
    """Measurement-noise variance, unit²."""
    p0: np.float32
    """Start variance, unit²; inf = the first sample is the start."""
    momentum: np.float32 | None = None
    """Momentum τ, sample periods; None = the sketch was exported without momentum and cannot take one."""
    median: int = 1
    """Samples whose median goes into the filter, which no command changes; 1 = each sample itself."""

    def applied_to(self, params: Float32Params) -> Float32Params:
        """`params` as the board computes with them: its own q, r, p0 and momentum, and the gain that follows."""
        momentum = None if self.momentum is None else momentum_on_board(self.q, self.momentum)
        used = replace(params, q=self.q, r=self.r, p0=self.p0, momentum=momentum, median=self.median)
        return replace(used, settled_gain=np.float32(0.0))


@dataclass(frozen=True)
class FixedFilter:
    """A filter of a board that takes no values while it runs: it is not a Kalman filter."""

    name: str
    """Identifier of the channel."""


def commands(params: Float32Params, channel: int | None = None, *, knows_momentum: bool = False) -> tuple[str, ...]:
    r"""The lines, without \n, that set q, r, momentum and p0 on a board and restart its filter.

    Args:
        params: The values; gate, x0 and the settled gain stay those of the export.
        channel: Which channel of the board, from 1; None = all.
        knows_momentum: Whether its answers name a momentum.

    Raises:
        BadSetting: The board does not know momentum, or the momentum is too short for it.
    """
    momentum = np.float32(0.0) if params.momentum is None else params.momentum.momentum
    if momentum > 0.0 and not knows_momentum:
        raise BadSetting(
            "momentum must be 0 for this board, whose sketch was exported without it"
            f" (got {float(momentum):.6g} samples): export the sketch with this tuning and flash it, then the board"
            " takes any momentum, 0 too"
        )
    if 0.0 < momentum < MIN_MOMENTUM:
        raise BadSetting(
            f"momentum must be 0 or at least {MIN_MOMENTUM:g} samples for a board (got {float(momentum):.6g})"
        )
    which = "" if channel is None else f"{channel} "
    # A value of 0 comes last: the board refuses q = r = 0, also in between.
    pair = sorted((("q", params.q), ("r", params.r)), key=lambda named: named[1] == 0)
    between = (("t", momentum),) if knows_momentum else ()
    return tuple(f"{which}{name} {float(value):.9g}" for name, value in (*pair, *between, ("p", params.p0)))


def read_answer(line: str) -> BoardAnswer | FixedFilter | None:
    """The answer to a command, or None for any other line: a sample, another remark."""
    fixed, found = _FIXED.fullmatch(line), _ANSWER.fullmatch(line)
    if fixed is not None:
        return FixedFilter(fixed[1])
    if found is None:
        return None
    name, median, *all_bits = found.groups()
    held = (np.uint32(int(bits, 16)).view(np.float32) for bits in all_bits if bits is not None)
    return BoardAnswer(name, *held, median=int(median or 1))


def is_refusal(line: str) -> bool:
    """Whether a line is the answer to a command that the board does not understand or accept."""
    return line.startswith("# not understood")
