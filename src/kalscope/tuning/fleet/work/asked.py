"""What is to be done with each recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Protocol

import numpy as np

from kalscope.common.version import program
from kalscope.errors import KalscopeError
from kalscope.estimation.finding import Request
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

FORMAT = 5
"""Raised when the same recording would give another row: parts of another format are not used."""
DEVICE_LIMIT_S = 120.0
"""Longest time for a unit of up to 16 MiB, s, by default; see `time_limit`."""


class Question(Protocol):
    """What the user of `kalscope tune` asks for; a dataclass whose `repr` contains all of it."""

    @property
    def gate(self) -> float | None:
        """Outlier gate on v²/s; NaN = off, None = as it is found."""
        ...

    def request(self, recording: Recording) -> Request:
        """The same as a request to `find_parameters`, for this recording."""
        ...


@cache
def any_recording() -> Recording:
    """A placeholder recording, for questions where only the options count."""
    return Recording(np.arange(3.0), ("x",), ("",), np.zeros((3, 1)), 1.0)


@dataclass(frozen=True)
class Asked:
    """The options of a fleet."""

    question: Question
    """What is asked of each channel."""
    reading: ReadOptions = DEFAULTS
    """How files are read."""
    sample_period: float | None = None
    """Sample period in s in place of that of the recordings."""
    channel: str | None = None
    """The channel of each recording; None = the first that measures something."""
    every: bool = False
    """Whether all channels are fitted."""
    row_groups: bool = False
    """Whether each row group of a Parquet file is a recording of its own."""
    device_limit: float = field(default=DEVICE_LIMIT_S, repr=False)
    """Longest time for a unit, s, see `time_limit`; not in the `repr`, because no row depends on it."""
    program: str = field(default_factory=program)
    """The program that asks, with its version: rows of another one are not the same."""

    @property
    def is_pooled(self) -> bool:
        """Whether the filter for all is the most likely one, and no goal decides it."""
        try:
            request = self.question.request(any_recording())
        except KalscopeError:  # a still stretch from … to: it is within each recording or not
            return True
        return not request.target and request.ratio is None

    def fingerprint(self) -> str:
        """A text that differs where the rows would differ."""
        return f"{FORMAT} {self!r}"
