"""Sends a setting to the live board that runs the exported filter."""

from __future__ import annotations

from dataclasses import dataclass

from kalscope.errors import BadDevice, BadSetting
from kalscope.export.board.commands import BoardAnswer, commands, is_refusal, read_answer
from kalscope.export.float32 import float32_params
from kalscope.sources.live.live_samples import Snapshot
from kalscope.sources.live.live_source import LiveSource
from kalscope_app.session.live_state import Sent
from kalscope_app.session.state import State


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
        channel: What is on screen.
        filters: How many filters the board says it has. It sends names only when it starts: otherwise the columns
            have none, and are measured, filtered, measured, filtered …

    Raises:
        BadSetting: the board sends no filtered value beside this channel.
    """
    if channel == "raw" and "filtered" in names:
        return BoardFilter(None, "filtered")
    measured = [name for name in names if f"{name}_filtered" in names]
    if channel in measured:
        return BoardFilter(measured.index(channel) + 1, f"{channel}_filtered")
    if is_unnamed(names) and len(names) == 2 * filters and channel in names[::2]:
        at = names.index(channel)
        return BoardFilter(None if filters == 1 else at // 2 + 1, names[at + 1])
    raise BadSetting(
        f"this board cannot be tuned: it sends no filtered column for {channel[:40]} "
        f"(only {', '.join(names)[:100]}). Flash the exported sketch first"
    )


def is_unnamed(names: tuple[str, ...]) -> bool:
    """Whether the board has not said what its columns are called."""
    return names == tuple(f"value {i + 1}" for i in range(len(names)))


def send_setting(state: State, source: LiveSource) -> Sent:
    """Bring q, r, momentum and p0 of the channel on screen onto the board, one command at a time, each answered.

    Raises:
        BadSetting: the values do not fit float32, the board has no such filter or does not know momentum, or no
            standard filter of one channel is on screen.
        BadDevice: the board did not answer, or did not take a value.
    """
    if state.fusion is not None:
        raise BadSetting("the sketch of fused sensors takes no values while it runs: export it again and flash it")
    state.require_standard_filter([state.channel])
    wanted = float32_params(state.params)
    names = state.recording.names
    said = _answers(source, "?")
    its = board_filter(names, state.channel, len(said))
    *values, restart = commands(wanted, its.number, knows_momentum=said[0].momentum is not None)
    for line in values:
        _answers(source, line)
    row = _rows(source.snapshot())
    answer = _answers(source, restart)[-1]
    # x0 and gate stay those of the export; the settled gain belonged to the values before.
    return Sent(state.record_key, state.channel, its.filtered, state.params, answer.applied_to(wanted), row)


def _answers(source: LiveSource, line: str) -> list[BoardAnswer]:
    replies = source.send(line)
    for reply in replies:
        if is_refusal(reply):
            raise BadDevice(f"the board did not take {line!r}: it answered {reply[:100]!r}")
    answers = [answer for answer in map(read_answer, replies) if answer is not None]
    if not answers:
        raise BadDevice(
            f"the board did not answer {line!r} with its values, but {replies[0][:100]!r}. "
            "Flash the exported sketch first"
        )
    return answers


def _rows(snapshot: Snapshot | None) -> int:
    return 0 if snapshot is None else snapshot.first + len(snapshot.recording)
