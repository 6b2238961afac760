"""A board that runs the exported sketch: its commands, the noise it measures, whether it computes as we do."""

from __future__ import annotations

import math
import re
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from queue import Empty, Queue
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.progress import Progress
from kalscope.common.text import count, number, percent, plural, squared
from kalscope.errors import BadDevice, BadSetting, Cancelled
from kalscope.estimation.noise import StillNoise, noise_from_still
from kalscope.export.float32 import Float32Momentum, Float32Params, filter_float32
from kalscope.sources.live.source import BoardGone

if TYPE_CHECKING:
    from collections.abc import Callable

    from kalscope.sources.live.source import LiveSource, LiveStatus, Remark


# The commands to a board that runs the exported sketch, and its answers: texts only, no port.
#
# Send one command, wait for its answer, then send the next: a small board buffers 64 characters.


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


# What a board makes of a momentum that it is sent: the constants of its filter, in float32 as well.


LAST_POWER = 13
"""Powers of 1/τ in the series: the next one is below the last bit."""


def momentum_on_board(q: np.float32, tau: np.float32) -> Float32Momentum | None:
    """The momentum that a board computes for itself when it is sent q or τ, bit for bit; None for τ = 0.

    Only sums, products and quotients, so that every processor gives these bits: 1 - e by its series for 1/τ up to
    1, doubled as often as 1/τ was halved for that; q11 by its series, or above 1 by the difference that it is.
    """
    if tau == 0.0:
        return None
    one, half = np.float32(1.0), np.float32(0.5)
    h = one / tau
    halved, doublings = h, 0
    while halved > one:
        halved, doublings = halved * half, doublings + 1
    power = gone = halved  # ±hⁿ/n!, and 1 - e
    a = both = np.float32(0.0)  # (2^(n-1) - 2) ± hⁿ/n! summed, and that factor
    for n in range(2, LAST_POWER + 1):
        power = power * -halved / np.float32(n)
        gone = gone + power
        a = a + both * power
        both = both + both + np.float32(2.0)
    for _ in range(doublings):
        gone = gone * (np.float32(2.0) - gone)
    if doublings:
        a = h - gone - half * gone * gone
    w0 = half * q / tau
    return Float32Momentum(
        momentum=tau,
        e=one - gone,
        f=tau * gone,
        q11=q * tau * a,
        q12=half * q * gone * gone,
        q22=w0 * gone * (np.float32(2.0) - gone),
        w0=w0,
    )


# The commands by which a board measures its own noise, and its answers: texts only, no port.
#
# A sketch exported with calibration supports them. The answers come from outside: each is split once and bounded in
# length, and its numbers must be finite and agree with their bits.


MAX_LETTERS = 200
"""Maximum length of an answer that is read, characters; a live source cuts its lines there."""

Kind = Literal["kept", "not kept", "forgotten", "started", "not understood"]
_NAME, _COUNT = r"([A-Za-z_]\w*)", r"(\d{1,9})"
_REPLIES: dict[Kind, re.Pattern[str]] = {
    "kept": re.compile(r"kept \d{1,9} channels?"),
    "not kept": re.compile(r"not kept: (.+)"),
    "forgotten": re.compile(r"forgotten"),
    "started": re.compile(r"kept values (?:are in use|refused: (.+))"),
    "not understood": re.compile(r"not understood\b.*"),
}
_BEGUN = re.compile(rf"{_NAME} calibrating rows={_COUNT}", re.ASCII)
_REFUSED = re.compile(rf"{_NAME} not calibrated: (.+)", re.ASCII)
_MEASURED = re.compile(
    rf"{_NAME} calibrated r=(\S+) q=(\S+) n={_COUNT} spikes={_COUNT} missing={_COUNT} step=(\S+)"
    rf" bits={_BITS},{_BITS},{_BITS}",
    re.ASCII,
)
_AGREES = 1e-5
"""Share by which a printed number may differ from its bits: a board divides by ten until seven digits are left."""


@dataclass(frozen=True)
class Calibrating:
    """The board measures from the next sample on."""

    name: str
    """Identifier of the channel."""
    rows: int
    """Samples that it takes."""


@dataclass(frozen=True)
class Calibrated:
    """The board has measured the `rows` samples before this line, and uses r and q from the next sample on."""

    name: str
    """Identifier of the channel."""
    r: np.float32
    """Measurement-noise variance, unit², exact."""
    q: np.float32
    """Process-noise variance, unit², exact: r times the q/r of the export, whose lag it keeps."""
    step: np.float32
    """Resolution of the readings as the board sees or knows it, unit, exact; 0 = none."""
    samples: int
    """Samples that r was measured on."""
    spikes: int
    """Samples that were set aside."""
    missing: int
    """Samples without a reading."""

    @property
    def rows(self) -> int:
        """All samples that were examined."""
        return self.samples + self.spikes + self.missing

    @property
    def parameters(self) -> dict[str, float]:
        """The values of q and r, in as few digits as give the same float32."""
        return {name: float(str(value)) for name, value in (("q", self.q), ("r", self.r))}

    @property
    def is_rounding(self) -> bool:
        """Whether the readings hardly change, so that r is only the variance of rounding to a step."""
        floor = float(self.step) ** 2 / 12.0
        return floor > 0.0 and math.isclose(float(self.r), floor, rel_tol=1e-5)


@dataclass(frozen=True)
class NotCalibrated:
    """The board could not measure, and keeps the values that it had."""

    name: str
    """Identifier of the channel."""
    reason: str
    """Why, in the words of the board."""


@dataclass(frozen=True)
class Reply:
    """An answer for the whole board."""

    kind: Kind
    """It starts with its present values from now on; it could not store them; it starts with the values of its
    export; it has just started, and something was stored; the sketch does not know the command."""
    reason: str = ""
    """Why, in the words of the board; "" where there is nothing to explain."""


def calibration_command(seconds: float | None, channel: int | None = None) -> str:
    """The line that lets a board measure.

    Args:
        seconds: For how long, > 0; None = cancel it: the board keeps the values that it had.
        channel: Which channel of the board, from 1; None = all.

    Raises:
        BadSetting: This is not a valid time to measure for.
    """
    if seconds is not None and not 0.0 < seconds < 1e6:
        raise BadSetting(f"the time to measure for must be above 0 s and below 1e6 s (got {seconds:.6g})")
    return f"{'' if channel is None else f'{channel} '}c {seconds or 0.0:.6g}"


def read_calibration(line: str) -> Calibrating | Calibrated | NotCalibrated | Reply | None:
    """What a line says of a calibration; None for any other line: a sample, another remark, a damaged answer."""
    if len(line) > MAX_LETTERS or not line.startswith("# ") or not (line.isascii() and line.isprintable()):
        return None
    text = line[2:].rstrip()
    for kind, pattern in _REPLIES.items():
        if found := pattern.fullmatch(text):
            return Reply(kind, *(group for group in found.groups() if group))
    if found := _BEGUN.fullmatch(text):
        return Calibrating(found[1], int(found[2]))
    if found := _REFUSED.fullmatch(text):
        return NotCalibrated(found[1], found[2])
    if found := _MEASURED.fullmatch(text):
        name, r, q, samples, spikes, missing, step, *bits = found.groups()
        values = [_float32(printed, one) for printed, one in zip((r, q, step), bits, strict=True)]
        exact = [value for value in values if value is not None]
        if len(exact) == len(values) and exact[0] > 0.0 and int(samples) > 0:
            return Calibrated(name, exact[0], exact[1], exact[2], int(samples), int(spikes), int(missing))
    return None


def _float32(printed: str, bits: str) -> np.float32 | None:
    """The value of eight hexadecimal digits, if it is 0 or more and agrees with the printed number."""
    try:
        value = float(printed)
    except ValueError:
        return None
    exact = np.uint32(int(bits, 16)).view(np.float32)
    if not 0.0 <= exact < np.inf or not math.isclose(value, float(exact), rel_tol=_AGREES):
        return None
    return exact


# A connected board: which of its filters a channel belongs to, and which values it uses.


@dataclass(frozen=True)
class BoardFilter:
    """One filter of a board."""

    number: int | None
    """Its place among the board's, from 1; None = the only one."""
    filtered: str
    """The channel in which the board sends the filtered values of the measured one."""


def board_filter(names: tuple[str, ...], channel: str, filters: int = 0) -> BoardFilter:
    """Which filter of the board a channel belongs to.

    Args:
        names: All that the board sends.
        channel: What is measured.
        filters: How many filters the board says it has. It sends names only when it starts: otherwise the columns
            have none, and are measured, filtered, measured, filtered …

    Raises:
        BadSetting: the board sends no filtered value beside this channel.
    """
    filtered = filtered_channels(names, filters)
    if channel not in filtered:
        raise BadSetting(
            f"this board cannot be tuned: it sends no filtered column for {channel[:40]} "
            f"(only {', '.join(names)[:100]}). Flash the exported sketch first"
        )
    return BoardFilter(None if len(filtered) == 1 else list(filtered).index(channel) + 1, filtered[channel])


def filtered_channels(names: tuple[str, ...], filters: int = 0) -> dict[str, str]:
    """The channels that a board filters, in its order, and those in which it sends the result.

    Args:
        names: All that the board sends.
        filters: How many filters it says it has.
    """
    if is_unnamed(names) and len(names) == 2 * filters:
        return dict(zip(names[::2], names[1::2], strict=True))
    named = {name: f"{name}_filtered" for name in names if f"{name}_filtered" in names}
    return {"raw": "filtered"} if not named and {"raw", "filtered"} <= set(names) else named


def is_unnamed(names: tuple[str, ...]) -> bool:
    """Whether the board has not sent the names of its columns."""
    return names == tuple(f"value {i + 1}" for i in range(len(names)))


def values_in_use(
    source: LiveSource, line: str = "?", check: Callable[[], object] = bool
) -> list[BoardAnswer | FixedFilter]:
    """What the filters of a board use, in its order, after a command if one is given; `check` as for `send`.

    Raises:
        BadDevice: the board did not answer, or did not take the value.
    """
    replies = source.commands.send(line, is_reply=_is_answer, check=check)
    for reply in filter(is_refusal, replies):
        raise BadDevice(f"the board did not take {line!r}: it answered {reply[:100]!r}")
    return [answer for answer in map(read_answer, replies) if answer is not None]


def _is_answer(remark: str) -> bool:
    return is_refusal(remark) or read_answer(remark) is not None


# Let a connected board measure its own noise, and measure the same samples here.


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
            run.begin(calibration_command(seconds, number), progress)
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
    wanted = "kept" if kept else "forgotten"

    def is_reply(line: str) -> bool:
        answer = read_calibration(line)
        return isinstance(answer, Reply) and answer.kind in (wanted, "not kept", "not understood")

    replies = map(read_calibration, source.commands.send("k" if kept else "f", is_reply=is_reply))
    answer = next(reply for reply in replies if isinstance(reply, Reply))
    if answer.kind == "not understood":
        raise BadDevice(CANNOT)
    if answer.kind == "not kept":
        raise BadDevice(f"the board could not store its values: {answer.reason}")


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
            self._source.send(calibration_command(None, number), _CANCEL_S)
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
        answer = read_calibration(remark.text)
        kind = answer.kind if isinstance(answer, Reply) else ""
        if kind == "not understood":
            raise BadDevice(CANNOT)
        if kind == "started" or self._is_header(remark.text):
            raise BadDevice(f"the board was reset while it measured. {_STARTS_WITH}")
        waiting = self._channels.keys() - self._done.keys()
        if answer is None or isinstance(answer, Reply) or answer.name not in waiting:
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


# What a board measured, how that compares with the figure here, and what to do where it refused: in words.


EQUAL_WITHIN = 0.01
"""Share up to which the two figures are called equal: what float32 and the board's one pass may cost."""

_ADVICE = (
    ("too short", "Measure for longer."),
    ("too long", "Measure for a shorter time."),
    ("no reading", "Is the sensor plugged in, and does the sketch read it in time?"),
    ("spikes in", "The level jumped, or the wiring picks up pulses: keep the sensor still and check its wires."),
    (
        "at an end of the range",
        "The input is saturated: change its level or amplification until the readings lie inside. If the"
        " converter has more than 10 bits, write its range into KALSCOPE_READINGS of the sketch.",
    ),
    (
        "nearly all readings are equal",
        "The input is stuck, or its noise is smaller than a step of the converter. Check it, write that step into"
        " KALSCOPE_READINGS of the sketch, or enter r by hand.",
    ),
    ("the level moves", "Keep what the sensor measures constant, let it warm up, and measure again."),
    ("the noise is uneven", "Something was moved or switched for a part of the time: measure again undisturbed."),
    (
        "neighbouring readings",
        "The input moves slowly or hums, or the sensor smooths already: keep it still, shield it from mains hum, or"
        " take fewer samples a second.",
    ),
    ("too few readings", "Measure for longer."),
    ("float32 cannot hold", "Tune in a unit in which the readings are neither tiny nor huge, and export again."),
)
"""Words of a refusal, and what to do about it."""


def found_text(answer: Calibrated, unit: str) -> str:
    """What a board found and uses now, in a sentence."""
    r, q = (f"{number(float(value), 4)} {squared(unit)}" for value in (answer.r, answer.q))
    used = [f"from {_samples(answer.samples)}"]
    used += [plural(answer.spikes, "spike") + " left out"] if answer.spikes else []
    used += [f"{count(answer.missing)} missing"] if answer.missing else []
    text = f"r = {r}, and for the lag of the export q = {q}; {', '.join(used)}."
    if answer.is_rounding:
        text += f" This is the rounding to steps of {_value(answer.step, unit)}: the readings hardly change."
    return text


def compared_text(measured: Measurement, unit: str) -> str:
    """How that compares with the same rule over the same samples here; "" where the board refused."""
    answer, here = measured.answer, measured.here
    if isinstance(answer, NotCalibrated):
        return ""
    board = math.sqrt(answer.r)
    if here is None:
        return (
            f"σ = {_value(board, unit)} on the board; the samples that it used did not all arrive here, so there is"
            " no figure to compare it with."
        )
    ours = math.sqrt(here.r)
    share = abs(board / ours - 1.0)
    how = f"equal within {_rounded_up(share)}" if share <= EQUAL_WITHIN else f"they differ by {percent(share)}"
    where = "here" if measured.lost else "here from the same samples"
    text = f"σ = {_value(board, unit)} on the board, {_value(ours, unit)} {where}: {how}."
    if measured.lost:
        text += f" {_samples(measured.lost)} of the board did not arrive here, so the two differ in their samples."
    return text


def refusal_text(answer: NotCalibrated) -> str:
    """Why a board kept its values, and what to do."""
    reason = answer.reason
    if reason == "cancelled":
        return "The measurement was cancelled: the board keeps its values."
    advice = next((advice for words, advice in _ADVICE if words in reason), "")
    return f"The board keeps its values: {reason}. {advice}".rstrip()


def _value(value: float | np.float32, unit: str) -> str:
    return f"{number(float(value), 4)}{' ' if unit else ''}{unit}"


def _samples(n: int) -> str:
    return f"{count(n)} sample{'' if n == 1 else 's'}"


def _rounded_up(share: float) -> str:
    """A share to one digit, never below what it is: 0.3 %."""
    percents = max(100.0 * share, 0.001)
    power = 10.0 ** math.floor(math.log10(percents))
    return f"{math.ceil(percents / power - 1e-9) * power:.1g} %"


# Whether a board that runs the exported filter computes what Kalscope computes, compared bit by bit.


MAX_ROWS_TO_RESTART = 2000
"""Rows in which a restart is searched for: a board executes it within a few."""

MAX_RESTARTS_TRIED = 256
"""Candidate rows that are tried: while the input is constant and the old filter has settled on it, every row looks
like a restart."""


@dataclass(frozen=True)
class BoardCheck:
    """A board's filtered rows beside those of `filter_float32`, from its restart on."""

    rows: int
    """Rows compared."""
    different: int
    """Rows whose float32 is another one."""
    largest_steps: int
    """Largest distance, in steps from one float32 to the next."""
    largest: float
    """Largest distance, unit."""


def check_board(raw: ArrayLike, board: ArrayLike, params: Float32Params) -> BoardCheck | None:
    """Compare what a board sent with what its filter should have given.

    Args:
        raw: What the board measured, shape (n,), unit; NaN where missing.
        board: What its filter made of it, shape (n,), unit.
        params: The values that it reported. Its filter was restarted: the comparison begins at a row whose
            filtered value is that of a start, of several the one with the fewest differences after it.

    Returns:
        None where no restart is among the rows.
    """
    z, x = np.asarray(raw, dtype=np.float32), np.asarray(board, dtype=np.float32)
    best: BoardCheck | None = None
    for first in find_restarts(z, x, params)[:MAX_RESTARTS_TRIED]:
        check = _compared(z[first:], x[first:], params)
        if best is None or check.different < best.different:
            best = check
        if check.different == 0:
            break
    return best


def _compared(z: NDArray[np.float32], x: NDArray[np.float32], params: Float32Params) -> BoardCheck:
    ours, theirs = filter_float32(z, params), x
    sent = np.isfinite(theirs) & np.isfinite(ours)
    ours, theirs = ours[sent], theirs[sent]
    bits = np.stack([ours, theirs]).view(np.int32).astype(np.int64)
    order = np.where(bits < 0, -(bits & 0x7FFFFFFF), bits)  # counts the float32 values
    steps = np.abs(order[0] - order[1])
    far = np.abs(ours.astype(np.float64) - theirs)
    return BoardCheck(
        len(steps), int(np.count_nonzero(steps)), int(steps.max(initial=0)), float(far.max(initial=0.0))
    )


def find_restarts(raw: NDArray[np.float32], board: NDArray[np.float32], params: Float32Params) -> list[int]:
    """The rows whose filtered value is that of a filter's first row, in their order."""
    begins = np.zeros(len(raw), dtype=bool)
    if np.isnan(params.x0):
        begins = raw == board
    else:
        for i in range(min(len(raw), MAX_ROWS_TO_RESTART)):
            begins[i] = filter_float32(raw[i : i + 1], params)[0] == board[i]
    same = np.flatnonzero(begins)
    return same[: np.searchsorted(same, same[0] + MAX_ROWS_TO_RESTART)].tolist() if len(same) else []
