"""The commands to a board that runs the exported sketch, and its answers: texts only, no port.

Send one command, wait for its answer, then send the next: a small board keeps 64 letters.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from kalscope.export.float32 import Float32Params

_ANSWER = re.compile(r"# (\w+) q=\S+ r=\S+ p=\S+ bits=([0-9A-F]{8}),([0-9A-F]{8}),([0-9A-F]{8})\s*")


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


def commands(params: Float32Params, channel: int | None = None) -> tuple[str, ...]:
    r"""The lines, without \n, that set q, r and p0 on a board and restart its filter.

    Args:
        params: The values; gate, x0 and the settled gain stay those of the export.
        channel: Which channel of the board, from 1; None = all.
    """
    which = "" if channel is None else f"{channel} "
    # A value of 0 comes last: the board refuses q = r = 0, also on the way.
    pair = sorted((("q", params.q), ("r", params.r)), key=lambda named: named[1] == 0)
    return tuple(f"{which}{name} {float(value):.9g}" for name, value in (*pair, ("p", params.p0)))


def read_answer(line: str) -> BoardAnswer | None:
    """The answer to a command, or None for any other line: a sample, another remark."""
    found = _ANSWER.fullmatch(line)
    if found is None:
        return None
    q, r, p0 = (np.uint32(int(bits, 16)).view(np.float32) for bits in found.groups()[1:])
    return BoardAnswer(found[1], q, r, p0)


def is_refusal(line: str) -> bool:
    """Whether a line is the answer to a command that the board does not understand or accept."""
    return line.startswith("# not understood")
