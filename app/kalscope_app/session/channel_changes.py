"""What can be done with several channels: each returns a function State -> State, as in `changes`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from kalscope.errors import BadSetting
from kalscope_app.session.linked_channels import WAYS, follower, in_step

if TYPE_CHECKING:
    from kalscope_app.session.changes import Change
    from kalscope_app.session.state import State

ALL_OTHERS = "all other channels"


def set_together(way: str) -> Change:
    """Tune this channel alone or all together; all then take the present one's setting at once."""
    if way not in WAYS:
        raise BadSetting(f"the way of tuning channels must be one of {', '.join(WAYS)} (got {way[:40]!r})")

    def change(state: State) -> State:
        at = state.recording.index(state.channel)
        tunings = in_step(state.tunings, state.starts, at, way)
        return replace(state, together=way, tunings=tunings, note="")

    return change


def copy_setting(to: str) -> Change:
    """The numbers of the channel on screen become those of another channel, or of all others."""

    def change(state: State) -> State:
        names = state.recording.names
        wanted = [name for name in names if name != state.channel] if to == ALL_OTHERS else [to]
        chosen = {state.recording.index(name) for name in wanted}
        tunings = tuple(
            follower(state.tuning, own) if i in chosen and names[i] != state.channel else own
            for i, own in enumerate(state.tunings)
        )
        rules = tuple(None if i in chosen else rule for i, rule in enumerate(state.rules))
        where = f"{len(chosen)} channels" if len(chosen) > 1 else "one channel"
        note = "" if tunings == state.tunings else f"The setting of {state.channel} is now that of {where} more."
        return replace(state, tunings=tunings, rules=rules, note=note)

    return change
