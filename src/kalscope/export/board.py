"""A board that runs the exported sketch: its commands, the noise it measures, whether it computes as we do."""

from __future__ import annotations

import math
import re
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.progress import Progress
from kalscope.common.text import count, number, percent, plural, squared
from kalscope.errors import BadDevice, BadSetting, Cancelled
from kalscope.estimation.noise import StillNoise, noise_from_still
from kalscope.export.float32 import Float32Momentum, Float32Params, filter_float32
from kalscope.sources.live.source import ANSWER_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from kalscope.sources.live.source import LiveSource, Remark


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
        """`params` as the board computes with them: with its q, r, p0 and momentum."""
        momentum = None if self.momentum is None else momentum_on_board(self.q, self.momentum)
        return replace(params, q=self.q, r=self.r, p0=self.p0, momentum=momentum, median=self.median)


@dataclass(frozen=True)
class FixedFilter:
    """A filter of a board that takes no values while it runs: it is not a Kalman filter."""

    name: str
    """Identifier of the channel."""


def commands(params: Float32Params, channel: int | None = None, *, knows_momentum: bool = False) -> tuple[str, ...]:
    r"""The lines, without \n, that set q, r, momentum and p0 on a board and restart its filter.

    Args:
        params: The values; gate and x0 stay those of the export.
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
    if match := _FIXED.fullmatch(line):
        return FixedFilter(match[1])
    if match := _ANSWER.fullmatch(line):
        name, median, *bits = match.groups()
        return BoardAnswer(name, *map(_from_bits, filter(None, bits)), median=int(median or 1))
    return None


def _from_bits(digits: str) -> np.float32:
    return np.uint32(int(digits, 16)).view(np.float32)


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
# A sketch exported with calibration supports them. The answers come from outside: each is bounded in length, and
# its numbers must be finite.


MAX_LETTERS = 200
"""Maximum length of an answer that is read, characters; a live source cuts its lines there."""

_NAME, _COUNT = r"# ([A-Za-z_]\w*)", r"(\d{1,9})"
_REFUSED = re.compile(rf"{_NAME} not calibrated: (.+)", re.ASCII)
_MEASURED = re.compile(
    rf"{_NAME} calibrated r=\S+ q=\S+ n={_COUNT} spikes={_COUNT} missing={_COUNT} step=\S+"
    rf" bits={_BITS},{_BITS},{_BITS}",
    re.ASCII,
)


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


@dataclass(frozen=True)
class NotCalibrated:
    """The board could not measure, and keeps the values that it had."""

    name: str
    """Identifier of the channel."""
    reason: str
    """Why, in the words of the board."""


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


def read_calibration(line: str) -> Calibrated | NotCalibrated | None:
    """What a line says of the end of a calibration; None for any other line, such as a damaged answer."""
    line = line.rstrip()
    if len(line) > MAX_LETTERS or not (line.isascii() and line.isprintable()):
        return None
    if match := _REFUSED.fullmatch(line):
        return NotCalibrated(match[1], match[2])
    if match := _MEASURED.fullmatch(line):
        name, samples, spikes, missing, *bits = match.groups()
        r, q, step = map(_from_bits, bits)
        if 0.0 < r < np.inf and 0.0 <= q < np.inf and 0.0 <= step < np.inf and int(samples) > 0:
            return Calibrated(name, r, q, step, int(samples), int(spikes), int(missing))
    return None


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


_CANCEL_S = 1.0
"""Timeout for its confirmation that it has stopped, s: Ctrl+C ends a command within 2 s."""

CANNOT = (
    "the sketch on this board cannot measure by itself: export the Arduino sketch with self-calibration"
    " (--calibration) and flash it"
)
"""What an older sketch, or one that was exported without it, leads to."""
_CANCELLED = "the measurement was cancelled"


@dataclass(frozen=True, eq=False)
class Measurement:
    """What a board found of one channel, and what the same rule finds here."""

    answer: Calibrated | NotCalibrated
    """What the board says."""
    here: StillNoise | None = None
    """The noise of the same number of samples before its answer; None where there are none, or it refused."""


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
    filters = [answer.name for answer in values_in_use(source, check=lambda: progress(0.0, "asking the board"))]
    number, channels = _measured_channels(snapshot.recording.names, filters, channel)
    command, start = calibration_command(seconds, number), time.monotonic()
    answers: dict[str, tuple[Calibrated | NotCalibrated, Remark]] = {}

    def is_last(remark: Remark) -> bool:
        answer = read_calibration(remark)
        if answer is not None and answer.name in channels:
            answers[answer.name] = answer, remark
        return is_refusal(remark) or len(answers) == len(channels)

    def wait() -> None:
        progress((time.monotonic() - start) / seconds, "the board measures")

    timeout = ANSWER_S + 2.0 * seconds  # it takes longer where it leaves samples out
    try:
        replies = source.commands.send(command, timeout, is_reply=is_last, check=wait)
    except Cancelled:
        measured = [name for name, (answer, _) in answers.items() if isinstance(answer, Calibrated)]
        raise Cancelled(_cancel(source, number, measured)) from None
    if any(map(is_refusal, replies)):
        raise BadDevice(CANNOT)
    return tuple(
        Measurement(answers[name][0], _noise_here(source, here, *answers[name])) for name, here in channels.items()
    )


def _cancel(source: LiveSource, number: int | None, measured: list[str]) -> str:
    """Cancel the measurement on the board; returns which values the board then uses, in words.

    Args:
        source: The board.
        number: As for `calibration_command`.
        measured: Channels that it has measured; it may say so of others before it obeys.
    """

    def confirms(remark: Remark) -> bool:
        if isinstance(answer := read_calibration(remark), Calibrated):
            measured.append(answer.name)
        return not isinstance(answer, Calibrated)

    try:
        source.commands.send(calibration_command(None, number), _CANCEL_S, is_reply=confirms)
    except BadDevice:
        return f"{_CANCELLED}, but the board did not confirm it: it may still use what it measures. Reset it"
    if measured:
        return f"{_CANCELLED}, but the board already uses what it measured of {', '.join(measured)}"
    return f"{_CANCELLED}: the board keeps its values"


def _noise_here(
    source: LiveSource, channel: str, answer: Calibrated | NotCalibrated, remark: Remark
) -> StillNoise | None:
    """The noise of the samples before the board's answer."""
    snapshot = source.snapshot()
    if isinstance(answer, NotCalibrated) or snapshot is None or snapshot.generation != remark.generation:
        return None
    last = remark.row - snapshot.first
    with suppress(BadSetting):
        z = snapshot.recording.channel(channel)[max(last - answer.rows, 0) : last]
        return noise_from_still(z, float(answer.step) or None)


def _measured_channels(
    names: tuple[str, ...], filters: list[str], channel: str | None
) -> tuple[int | None, dict[str, str]]:
    """The board's number of the measured filter, None = all, and the channels by the board's names.

    Args:
        names: The channels of the live record.
        filters: What the board calls those that it filters.
        channel: The measured one by either name; None = all.
    """
    channels = dict(zip(filters, filtered_channels(names, len(filters)), strict=False))
    if len(channels) != len(filters):
        raise BadDevice(
            f"the board must send a filtered column for each of its {plural(len(filters), 'filter')}"
            f" (got {', '.join(names)[:100]})"
        )
    if channel is None:
        return None, channels
    channel = channels.get(channel, channel) if channel not in names else channel
    number = board_filter(names, channel, len(filters)).number
    return number, {filters[(number or 1) - 1]: channel}


def set_kept(source: LiveSource, *, kept: bool) -> None:
    """Let a board start with its present values from now on, or with those of its export.

    Raises:
        BadDevice: it cannot, did not answer, or its memory is worn.
    """
    failed, done = "# not kept: ", "# kept " if kept else "# forgotten"
    command = "k" if kept else "f"
    answer, *_ = source.commands.send(
        command, is_reply=lambda remark: is_refusal(remark) or remark.startswith((failed, done))
    )
    if is_refusal(answer):
        raise BadDevice(CANNOT)
    if answer.startswith(failed):
        raise BadDevice(f"the board could not store its values: {answer.removeprefix(failed)[:100]}")


def measured_text(measured: Measurement, unit: str) -> str:
    """What a board found and uses now, beside the figure here; or why it keeps its values."""
    answer, here = measured.answer, measured.here
    if isinstance(answer, NotCalibrated):
        return f"The board keeps its values: {answer.reason}."
    r, q = (f"{number(float(value), 4)} {squared(unit)}" for value in (answer.r, answer.q))
    text = (
        f"r = {r}, and for the lag of the export q = {q}; from {count(answer.samples)} samples,"
        f" {plural(answer.spikes, 'spike')} left out, {answer.missing} missing."
    )
    if math.isclose(12.0 * answer.r, float(answer.step) ** 2, rel_tol=1e-5):
        text += " The readings hardly change: this is their rounding."
    if here is None:
        return f"{text} Its samples did not arrive here, so there is no figure to compare it with."
    board, ours = math.sqrt(answer.r), math.sqrt(here.r)
    apart = percent(max(abs(board / ours - 1.0), 1e-5))
    return (
        f"{text} σ = {number(board, 4)} {unit}".rstrip()
        + f" on the board, {number(ours, 4)} here: equal within {apart}."
    )


# Whether a board that runs the exported filter computes what Kalscope computes, compared bit by bit.


MAX_ROWS_TO_RESTART = 1000
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
    n, best = min(len(z), MAX_ROWS_TO_RESTART), None
    first = z[:n] if np.isnan(params.x0) else [filter_float32(z[i : i + 1], params)[0] for i in range(n)]
    for start in np.flatnonzero(first == x[:n])[:MAX_RESTARTS_TRIED].tolist():
        apart = np.abs(filter_float32(z[start:], params).astype(np.float64) - x[start:])
        apart = apart[np.isfinite(apart)]
        check = BoardCheck(len(apart), int(np.count_nonzero(apart)), float(apart.max(initial=0.0)))
        if best is None or check.different < best.different:
            best = check
        if check.different == 0:
            break
    return best
