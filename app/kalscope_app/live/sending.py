"""Sends a setting to the live board that runs the exported filter."""

from __future__ import annotations

from kalscope.errors import BadDevice, BadSetting
from kalscope.export.board.chain import float32_tuning, runs_kalman
from kalscope.export.board.commands import BoardAnswer, FixedFilter, commands
from kalscope.export.board.connected import board_filter, values_in_use
from kalscope.export.float32 import float32_params
from kalscope.sources.live.live_samples import Snapshot
from kalscope.sources.live.live_source import LiveSource
from kalscope_app.session.live_state import Sent
from kalscope_app.session.state import State


def takes_no_values(state: State) -> str:
    """Why the board cannot take the values on screen while it runs; "" where it can."""
    if state.fusion is None and runs_kalman(state.tuning):
        return ""
    what = "a classic filter" if state.fusion is None else "fused sensors"
    return f"the sketch of {what} takes no values while it runs: export it again and flash it"


def send_setting(state: State, source: LiveSource) -> Sent:
    """Send q, r, momentum and p0 of the channel on screen to the board, one command at a time, each acknowledged.

    Raises:
        BadSetting: the values do not fit float32, the board has no such filter, another median or no momentum, or
            no Kalman filter of one channel is on screen.
        BadDevice: the board did not answer, or did not take a value.
    """
    state.require_exportable([state.channel])
    if why := takes_no_values(state):
        raise BadSetting(why)
    wanted = float32_tuning(state.tuning) or float32_params(state.params)
    names = state.recording.names
    answers = values_in_use(source)
    target = board_filter(names, state.channel, len(answers))
    if (target.number or 1) > len(answers):
        raise BadDevice(f"the board answered for only {len(answers)} of its channels: send again")
    used = _used(answers[(target.number or 1) - 1], wanted.median)
    *values, restart = commands(wanted, target.number, knows_momentum=used.momentum is not None)
    for line in values:
        values_in_use(source, line)
    row = _rows(source.snapshot())
    answer = _used(values_in_use(source, restart)[-1], wanted.median)
    # x0 and gate stay those of the export; the settled gain belonged to the previous values.
    return Sent(state.record_key, state.channel, target.filtered, state.params, answer.applied_to(wanted), row)


def _used(answer: BoardAnswer | FixedFilter, median: int) -> BoardAnswer:
    """What a Kalman filter of the board uses.

    Raises:
        BadSetting: it is another filter, or its median is not of `median` samples.
    """
    again = "export the sketch with this tuning and flash it"
    if isinstance(answer, FixedFilter):
        raise BadSetting(f"the filter of {answer.name} on this board is not Kalman's and takes no values: {again}")
    if answer.median != median:
        raise BadSetting(
            f"the median must be that of the board, {answer.median} samples, which no command changes"
            f" (got {median}): {again}"
        )
    return answer


def _rows(snapshot: Snapshot | None) -> int:
    return 0 if snapshot is None else snapshot.first + len(snapshot.recording)
