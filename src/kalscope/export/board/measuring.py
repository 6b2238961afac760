"""Let a connected board measure its own noise, and measure the same samples here."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, Queue
from typing import TYPE_CHECKING

from kalscope.common.progress import Progress
from kalscope.errors import BadDevice, BadSetting, Cancelled
from kalscope.estimation.sensor.noise import StillNoise, noise_from_still
from kalscope.export.board import calibration
from kalscope.export.board.calibration import (
    Calibrated,
    Calibrating,
    Forgotten,
    Kept,
    KeptAtStart,
    NotCalibrated,
    NotKept,
    NotUnderstood,
)
from kalscope.export.board.connected import board_filter, filtered_channels, values_in_use
from kalscope.sources.live import command_channel
from kalscope.sources.live.command_channel import BoardGone

if TYPE_CHECKING:
    from kalscope.sources.live.command_channel import Remark
    from kalscope.sources.live.live_source import LiveSource
    from kalscope.sources.live.live_status import LiveStatus

MAX_SILENCE_S, MAX_SILENT_PERIODS = 5.0, 5.0
"""Time without a sample after which a board is taken to have stopped: the longer of both, s and sample periods."""
MAX_LATE_ROWS = 200
"""Samples after the end within which the answer must have come: those missing at the start make it later."""
_CANCEL_S = 1.0
"""Timeout for its confirmation that it has stopped, s: Ctrl+C ends a command within 2 s."""
_TICK = 0.1
"""Seconds between two reports of the progress."""

CANNOT = (
    "the sketch on this board cannot measure by itself: export the Arduino sketch with self-calibration"
    " (--calibration) and flash it"
)
"""What an older sketch, or one that was exported without it, leads to."""
_ASKED = "the board is asked"
_CANCELLED = "the measurement was cancelled"
_UNCHANGED = f"{_CANCELLED}: the board keeps its values"
_STARTS_WITH = "It starts again with the values of its export, or with those that it keeps: measure again"
_UNPLUGGED = f"the board was unplugged while it measured. {_STARTS_WITH}"


@dataclass(frozen=True, eq=False)
class Measurement:
    """What a board found of one channel, and what the same rule finds here."""

    channel: str
    """The measured channel, as the live record calls it."""
    answer: Calibrated | NotCalibrated
    """What the board says."""
    here: StillNoise | None = None
    """The noise of the samples that the board used, as they arrived here; None where they do not have any."""
    lost: int = 0
    """Of the board's samples, those that did not arrive here: `here` is then of others too."""


def measure(source: LiveSource, channel: str | None, seconds: float, progress: Progress) -> tuple[Measurement, ...]:
    """Let a board measure r while its input is still; returns when it has answered.

    Args:
        source: The board, which runs the exported sketch and is sending.
        channel: The measured channel, as the live record or the board itself calls it; None = all.
        seconds: For how long.
        progress: Receives the progress, and says whether to stop: the board then keeps its values.

    Returns:
        One for each channel, in the board's order.

    Raises:
        BadSetting: the board does not filter this channel, or no board measures for that long.
        BadDevice: the board cannot measure, stopped, was unplugged or restarted.
        Cancelled: `progress` stopped it.
    """
    snapshot = source.snapshot()
    if snapshot is None:
        raise BadDevice("the board has not sent a sample yet")
    try:
        said = values_in_use(source, check=lambda: progress(0.0, _ASKED))
    except Cancelled:
        raise Cancelled(_UNCHANGED) from None
    names = snapshot.recording.names
    number, channels = _measured_channels(names, [answer.name for answer in said], channel)
    with source.commands.listen() as remarks:
        run = _Run(source, remarks, len(names), channels)
        try:
            run.begin(calibration.start(seconds, number), progress)
            return run.until_done(progress)
        except Cancelled:
            raise Cancelled(run.cancel(number)) from None


def _measured_channels(
    names: tuple[str, ...], own: list[str], channel: str | None
) -> tuple[int | None, dict[str, str]]:
    """The board's number of the measured filter, None = all, and the channels by the board's own names.

    Args:
        names: The channels of the live record.
        own: What the board calls those that it filters.
        channel: The measured one by either name; None = all.
    """
    channels, number = list(filtered_channels(names, len(own))), None
    if channel in own and channel not in names:
        channel = channels[own.index(channel)] if len(own) == len(channels) else channel
    if channel is not None:
        number = board_filter(names, channel, len(own)).number
        at = 0 if number is None else number - 1
        channels, own = [channel], own[at : at + 1]
    if len(channels) != len(own):
        raise BadDevice(
            f"the board must have a filter for each channel (got {len(own)} filters, {len(channels)} channels)"
        )
    return number, dict(zip(own, channels, strict=True))


def set_kept(source: LiveSource, *, kept: bool) -> None:
    """Let a board start with its present values from now on, or with those of its export.

    Raises:
        BadDevice: it cannot, did not answer, or its memory is worn.
    """
    with source.commands.listen() as remarks:
        source.send(calibration.KEEP if kept else calibration.FORGET)
        end = time.monotonic() + command_channel.ANSWER_S
        while (left := end - time.monotonic()) > 0.0:
            with suppress(Empty):
                answer = calibration.read_answer(remarks.get(timeout=left).text)
                if isinstance(answer, Kept if kept else Forgotten):
                    return
                if isinstance(answer, NotUnderstood):
                    raise BadDevice(CANNOT)
                if isinstance(answer, NotKept):
                    raise BadDevice(f"the board could not store its values: {answer.reason}")
    raise BadDevice(f"the board did not confirm the command within {command_channel.ANSWER_S:g} s")


class _Run:
    """One measurement: the answers on each channel, and how many samples have arrived since."""

    def __init__(self, source: LiveSource, remarks: Queue[Remark], columns: int, channels: dict[str, str]) -> None:
        """Args: the board; its remarks; values of a row; the channels by the board's own names."""
        self._source, self._remarks, self._columns, self._channels = source, remarks, columns, channels
        self._begun: dict[str, tuple[int, Calibrating]] = {}
        self._done: dict[str, Measurement] = {}
        self._reconnects = source.status().reconnects
        self._rows: int = self._row()
        self._row_at = time.monotonic()
        self._asked = self._row_at

    def begin(self, command: str, progress: Progress) -> None:
        """Tell the board to; the errors of `measure`."""
        try:
            self._source.commands.send(command, check=lambda: progress(0.0, _ASKED))
        except BoardGone:
            self._check_connection(self._source.status())
            raise BadDevice(_UNPLUGGED) from None  # and is back already

    def until_done(self, progress: Progress) -> tuple[Measurement, ...]:
        """Wait for the answers; the arguments and errors of `measure`."""
        while len(self._done) < len(self._channels):
            progress(self._fraction(), "the board measures")
            status, rows = self._source.status(), self._row()
            self._read_remarks(_TICK)  # everything that arrived by then is read before an answer counts as late
            if len(self._done) < len(self._channels):
                self._check(status, rows)
        return tuple(self._done[name] for name in self._channels)

    def cancel(self, number: int | None) -> str:
        """Cancel the measurement on the board; returns which values the board then uses, in words."""
        try:
            self._source.send(calibration.cancel(number), _CANCEL_S)
        except BadDevice:
            return f"{_CANCELLED}, but the board did not confirm it: it may still use what it measures. Reset it"
        self._read_remarks(0.0)
        measured = [name for name, one in self._done.items() if isinstance(one.answer, Calibrated)]
        if measured:
            return f"{_CANCELLED}, but the board already uses what it measured of {', '.join(measured)}"
        return _UNCHANGED

    def _read_remarks(self, seconds: float) -> None:
        """Process the remarks that are queued, or the first one within `seconds`; more may keep arriving."""
        with suppress(Empty):
            for _ in range(max(self._remarks.qsize(), 1)):
                self._take(self._remarks.get(timeout=seconds))

    def _take(self, remark: Remark) -> None:
        answer = calibration.read_answer(remark.text)
        if isinstance(answer, NotUnderstood):
            raise BadDevice(CANNOT)
        if isinstance(answer, KeptAtStart) or self._is_header(remark.text):
            raise BadDevice(f"the board was reset while it measured. {_STARTS_WITH}")
        if not isinstance(answer, Calibrating | Calibrated | NotCalibrated):
            return
        if answer.name not in self._channels or answer.name in self._done:
            return
        channel = self._channels[answer.name]
        if isinstance(answer, Calibrating):
            self._begun[answer.name] = remark.row, answer
        elif isinstance(answer, NotCalibrated):
            self._done[answer.name] = Measurement(channel, answer)
        elif answer.name in self._begun and answer.rows <= self._begun[answer.name][1].rows:
            self._done[answer.name] = self._measured(channel, answer, remark)

    def _is_header(self, text: str) -> bool:
        """Whether a remark contains the names of the board's columns: it sends them when it starts."""
        names = text.removeprefix("# ").split(",")
        return len(names) == self._columns and all(name.isidentifier() for name in names)

    def _measured(self, channel: str, answer: Calibrated, remark: Remark) -> Measurement:
        """The board's figure beside that of the samples before its answer."""
        begin, _ = self._begun[answer.name]
        lost = max(answer.rows - (remark.row - begin), 0)
        snapshot = self._source.snapshot()
        if snapshot is None or snapshot.generation != remark.generation:
            return Measurement(channel, answer, None, answer.rows)
        z = snapshot.recording.channel(channel)
        last = remark.row - snapshot.first
        first = max(last - answer.rows, 0)
        step = float(answer.step)
        try:
            here = noise_from_still(z[first:last], step if step > 0.0 else None)
        except BadSetting:
            here = None
        return Measurement(channel, answer, here, max(lost, answer.rows - (last - first)))

    def _row(self) -> int:
        snapshot = self._source.snapshot()
        return 0 if snapshot is None else snapshot.first + len(snapshot.recording)

    def _fraction(self) -> float:
        """How far the slowest channel is."""
        left = [name for name in self._channels if name not in self._done]
        begun = [self._begun[name] for name in left if name in self._begun]
        if len(begun) < len(left):
            return 0.0
        return min((self._row() - row) / max(answer.rows, 1) for row, answer in begun)

    def _check(self, status: LiveStatus, rows: int) -> None:
        """Stop waiting where no answer can arrive any more; `rows` have arrived."""
        self._check_connection(status)
        now = time.monotonic()
        if rows != self._rows:
            self._rows, self._row_at = rows, now
        silence = max(MAX_SILENCE_S, MAX_SILENT_PERIODS * (status.period or 0.0))
        if now - self._row_at > silence:
            raise BadDevice(
                f"the board has stopped: no sample arrived for {silence:.3g} s. Reset it and measure again"
            )
        if now - self._asked > silence and len(self._begun.keys() | self._done.keys()) < len(self._channels):
            raise BadDevice(
                f"the board did not begin to measure within {silence:.3g} s. Reset it and measure again"
            )
        late = [row + answer.rows + MAX_LATE_ROWS for row, answer in self._begun.values()]
        if late and rows > max(late):
            raise BadDevice("the board's answer was lost on the way: what it uses now is not known. Measure again")

    def _check_connection(self, status: LiveStatus) -> None:
        """Stop waiting for a board that has disconnected, or has restarted since."""
        if status.word == "closed":
            raise BadDevice(f"the board was disconnected while it measured. {_STARTS_WITH}")
        if status.word != "connected" or status.reconnects != self._reconnects:
            raise BadDevice(_UNPLUGGED)
