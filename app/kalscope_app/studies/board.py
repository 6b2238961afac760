"""Whether the live board computes what the screen shows: an idle-time computation."""

from __future__ import annotations

from kalscope.export.board.check import BoardCheck, check_board
from kalscope_app.session.state import State


def compare_with_board(state: State) -> BoardCheck | None:
    """The board's rows since it took the setting beside ours; None where there are none to compare."""
    sent = state.sent
    snapshot = state.live.snapshot if state.live is not None else None
    if sent is None or snapshot is None:
        return None
    if (sent.record, sent.channel) != (state.record_key, state.channel) or snapshot.first > sent.row:
        return None
    rows = slice(sent.row - snapshot.first, None)
    recording = snapshot.recording
    return check_board(recording.channel(sent.channel)[rows], recording.channel(sent.filtered)[rows], sent.params)
