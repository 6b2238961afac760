"""Lets the live board measure the noise of the channel on screen."""

from __future__ import annotations

from kalscope.common.progress import Progress
from kalscope.errors import Cancelled, KalscopeError, describe
from kalscope.export.board.measuring import measure
from kalscope.sources.live.live_source import LiveSource
from kalscope_app.session.live_state import BoardCalibration
from kalscope_app.session.state import State


def measured_by_board(state: State, source: LiveSource, seconds: float, progress: Progress) -> BoardCalibration:
    """The result, also where the board did not answer; waits for the board, so run it as a job.

    Raises:
        BadSetting: fused sensors are on screen.
        Cancelled: `progress` stopped it.
    """
    state.require_one_channel()
    try:
        (found,) = measure(source, state.channel, seconds, progress)
    except Cancelled:
        raise
    except KalscopeError as error:
        return BoardCalibration(state.record_key, state.channel, failed=describe(error))
    return BoardCalibration(state.record_key, state.channel, found)
