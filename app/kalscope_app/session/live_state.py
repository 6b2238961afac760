"""What the State knows about a live board: the record as of the last refresh, what it shows, what was sent."""

from __future__ import annotations

from dataclasses import dataclass

from kalscope.export.board.calibration import Calibrated
from kalscope.export.board.measuring import Measurement
from kalscope.export.float32 import Float32Params
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.params import FilterParams
from kalscope.sources.live.live_samples import Snapshot
from kalscope.sources.live.live_status import LiveStatus
from kalscope.tuning.tuning import Tuning

FIRST_SPAN = 10.0
"""Length of the live window at first, s."""


@dataclass(frozen=True, eq=False)
class BoardId:
    """Names a board in the State; only the connection knows its running source. Compared by identity."""


@dataclass(frozen=True)
class ConnectionState:
    """The state of the connection to the board."""

    connected: bool = False
    """Whether a board is connected, or is being waited for."""
    recording: bool = False
    """Whether that board is being recorded."""
    status: LiveStatus | None = None
    """Of the board on screen, or of one that is recorded in the background; None where there is none."""


Setting = dict[str, float | Chain | None]
"""Values of the command line by the names of the parameters."""

NO_CONNECTION = ConnectionState()
"""No board has been connected yet."""


@dataclass(frozen=True)
class Deferred:
    """What the command line asked for, applied once the channels and the starting values of a board are known."""

    tuning: Tuning | None = None
    """A tuning file."""
    channel: str | None = None
    """The channel to look at, a name or a number from 1."""
    values: tuple[tuple[str, float | Chain | None], ...] = ()
    """Names and values of its parameters."""


@dataclass(frozen=True)
class Live:
    """The live part of a State."""

    board: BoardId
    """Where the samples come from."""
    snapshot: Snapshot | None = None
    """The record as of the last refresh; None before the first samples."""
    span: float = FIRST_SPAN
    """Length of the window that follows the newest sample, s; inf = all that is kept."""
    following: bool = True
    """Whether the window follows; looking back ends that."""
    paused: bool = False
    """Whether the screen is frozen while samples still arrive."""
    settled: bool = False
    """Whether the starting values have been measured."""
    deferred: Deferred | None = None
    """What waits for them."""

    @property
    def waits(self) -> bool:
        """Whether the board has not sent enough to show: the record is a placeholder."""
        return self.snapshot is None

    @property
    def key(self) -> tuple[int, int]:
        """What stays the same while the record only grows: the board and its layout."""
        return id(self.board), -1 if self.snapshot is None else self.snapshot.generation


@dataclass(frozen=True)
class Sent:
    """A setting that a board has taken."""

    record: tuple[int, int]
    """The live record that it belongs to."""
    channel: str
    """The channel that was tuned."""
    filtered: str
    """The channel in which the board sends the output of its filter."""
    asked: FilterParams
    """What was on screen when it was sent."""
    params: Float32Params
    """What the board says it uses, exact."""
    row: int
    """Number of the first sample after the board restarted its filter, counted since it began to send."""


@dataclass(frozen=True)
class BoardCalibration:
    """The result of letting a board measure its own noise."""

    record: tuple[int, int]
    """The live record that it belongs to."""
    channel: str
    """The channel that was measured."""
    found: Measurement | None = None
    """What the board says, and the figure here; None where there was no answer."""
    failed: str = ""
    """Why there was none."""
    kept: bool = False
    """Whether the board keeps its values for its next start."""

    @property
    def values(self) -> Calibrated | None:
        """What the board measured; None where it could not."""
        answer = None if self.found is None else self.found.answer
        return answer if isinstance(answer, Calibrated) else None
