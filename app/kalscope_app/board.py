"""The live board that runs the exported filter: what is sent to it, and whether it then computes what we do.

Pure, but for `send_setting`, which talks to the board and is called from a job.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from kalscope.errors import BadDevice, BadSetting
from kalscope.export.board_check import BoardCheck, check_board
from kalscope.export.board_talk import BoardAnswer, commands, is_refusal, read_answer
from kalscope.export.float32 import Float32Params, float32_params
from kalscope.model import FilterParams
from kalscope.sources.live import LiveSource, Snapshot
from kalscope_app.state import State


@dataclass(frozen=True)
class Sent:
    """A setting that a board has taken."""

    record: tuple[int, int]
    """The live record that it belongs to."""
    channel: str
    """The channel that was tuned."""
    asked: FilterParams
    """What was on screen when it was sent."""
    params: Float32Params
    """What the board says it uses, exact."""
    row: int
    """Number of the first sample after the board was asked to start anew, counted since it began to send."""


def board_number(names: tuple[str, ...], channel: str) -> int | None:
    """Which filter of the board a channel is, from 1; None = its only one.

    Raises:
        BadSetting: the board sends no filtered value beside this channel.
    """
    if channel == "raw" and "filtered" in names:
        return None
    filtered = [name for name in names if f"{name}_filtered" in names]
    if channel not in filtered:
        raise BadSetting(
            "the board must run the exported sketch, which sends raw,filtered or NAME,NAME_filtered "
            f"(got {', '.join(names)[:100]} with {channel[:40]} on screen)"
        )
    return filtered.index(channel) + 1


def send_setting(state: State, source: LiveSource) -> Sent:
    """Bring q, r and p0 of the channel on screen onto the board, one command at a time, each answered.

    Raises:
        BadSetting: the values do not fit float32, this board has no such filter, or another one is on screen.
        BadDevice: the board did not answer, or did not take a value.
    """
    state.check_five_lines([state.channel])
    wanted = float32_params(state.params)
    lines = commands(wanted, board_number(state.recording.names, state.channel))
    answer: BoardAnswer | None = None
    row = 0
    for line in lines:
        row = _rows(source.snapshot())
        answer = _answer(source, line)
    assert answer is not None
    # x0 and gate stay those of the export; the settled gain belonged to the values before.
    taken = replace(wanted, q=answer.q, r=answer.r, p0=answer.p0, settled_gain=np.float32(0.0))
    return Sent(state.record_key, state.channel, state.params, taken, row)


def _answer(source: LiveSource, line: str) -> BoardAnswer:
    replies = source.send(line)
    for reply in replies:
        if is_refusal(reply):
            raise BadDevice(f"the board must take {line!r} (got {reply[:100]!r})")
    answers = [answer for answer in map(read_answer, replies) if answer is not None]
    if not answers:
        raise BadDevice(f"the board must answer {line!r} with the values it uses (got {replies[0][:100]!r})")
    return answers[-1]


def _rows(snapshot: Snapshot | None) -> int:
    return 0 if snapshot is None else snapshot.first + len(snapshot.recording)


def set_sent(sent: Sent | None) -> Callable[[State], State]:
    """The board has taken a setting; None: what it uses is not known."""
    return lambda state: replace(state, sent=sent)


def compare_with_board(state: State) -> BoardCheck | None:
    """The board's rows since it took the setting beside ours; None where there are none to compare."""
    sent, board = state.sent, state.board
    snapshot = state.live.snapshot if state.live is not None else None
    if sent is None or board is None or snapshot is None:
        return None
    if (sent.record, sent.channel) != (state.record_key, state.channel) or snapshot.first > sent.row:
        return None
    rows = slice(sent.row - snapshot.first, None)
    recording = snapshot.recording
    return check_board(recording.channel(sent.channel)[rows], recording.channel(board)[rows], sent.params)
