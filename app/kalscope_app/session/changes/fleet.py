"""Changes of the open fleet, and the step from one of its devices to the recording on screen."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from kalscope.common.text import one_line
from kalscope.errors import BadSetting
from kalscope_app.session.fleet import COLOURS, ORDERS, OpenFleet
from kalscope_app.session.opening import adapted
from kalscope_app.session.state import Change, State

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet

MAX_FIND = 200
"""Characters of a text to find, at most."""


def open_fleet(fleet: Fleet) -> Change:
    """Open a fleet, and the map, which shows its devices."""
    return lambda state: replace(state.with_view(map_shown=True), fleet=OpenFleet(fleet))


def renew_fleet(fleet: Fleet) -> Change:
    """The newer state of a fleet that is still open."""

    def change(state: State) -> State:
        if state.fleet is None or state.fleet.fleet.folder != fleet.folder:
            return state
        return replace(state, fleet=replace(state.fleet, fleet=fleet, picked=None))  # its rows have changed

    return change


def close_fleet(state: State) -> State:
    """Close the fleet."""
    return replace(state, fleet=None)


def set_fleet_order(order: str) -> Change:
    """Sort the devices in another way."""
    if order not in ORDERS:
        raise BadSetting(f"sort by must be one of {', '.join(ORDERS)} (got {str(order)[:40]!r})")
    return lambda state: state if state.fleet is None else replace(state, fleet=replace(state.fleet, order=order))


def set_fleet_colour(colour: str) -> Change:
    """Colour the devices by another measure."""
    if colour not in COLOURS:
        raise BadSetting(f"devices coloured by must be one of {', '.join(COLOURS)} (got {str(colour)[:40]!r})")
    return lambda state: state if state.fleet is None else replace(state, fleet=replace(state.fleet, colour=colour))


def find_devices(text: str) -> Change:
    """List the devices whose names contain a text."""
    wanted = one_line(str(text))[:MAX_FIND].strip()
    return lambda state: state if state.fleet is None else replace(state, fleet=replace(state.fleet, find=wanted))


def pick_device(i: int | None) -> Change:
    """Show which device a point of the map is; None: none is picked."""
    return lambda state: state if state.fleet is None else replace(state, fleet=replace(state.fleet, picked=i))


def set_at_shared(chosen: bool) -> Change:
    """Open devices at the filter for all, or each at its own."""

    def change(state: State) -> State:
        return state if state.fleet is None else replace(state, fleet=replace(state.fleet, at_shared=bool(chosen)))

    return change


def at_device(fleet: Fleet, i: int) -> Change:
    """Set the recording of a device, which has just been opened, to its own filter or to that for all.

    A device without q and r keeps its starting values; the note says why.
    """
    from kalscope.fleet.results import device_tuning, shared_tuning

    def change(state: State) -> State:
        name = one_line(fleet.devices.name(i))[:80]
        shared = shared_tuning(fleet, i) if state.fleet is not None and state.fleet.at_shared else None
        if shared is None and fleet.reasons[i]:
            return state.with_answers(note=f"{name} has no q and r: {one_line(fleet.reasons[i])[:200]}.")
        after = adapted(state, shared or device_tuning(fleet, i))
        which = "its own filter" if shared is None else "the filter for all"
        if after.fleet is not None and after.fleet.picked is not None:
            after = replace(after, fleet=replace(after.fleet, picked=None))
        return after.with_answers(note=f"{name} at {which}. {after.answers.note}".strip())

    return change
