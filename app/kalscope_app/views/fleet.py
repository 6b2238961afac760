"""A fleet beside the recording: what `kalscope fleet` found, sorted; a device is opened by a click."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import viser

from kalscope.common.text import count, lag_in_full, one_line, percent, plural, squared, trimmed
from kalscope.errors import BadSetting
from kalscope.filtering.steady import steady_state
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes import (
    close_fleet,
    find_devices,
    open_fleet,
    set_at_shared,
    set_fleet_order,
)
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import ORDERS, OpenFleet, loss_text
from kalscope_app.views.widgets import bind, escape_markdown, offer, on_user, put
from kalscope_app.worker.worker import Worker

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet


# The texts in the folder "Fleet" of the Source tab, as markdown; every name of the fleet is escaped. Pure.


MAX_NAME = 16
"""Characters of a name in the table."""


def about_fleet(fleet: Fleet) -> str:
    """How many recordings there are, one filter for all, and how many devices it suits."""
    said = [f"{fleet.devices.counted}."]
    if fleet.shared is not None:
        params, devices = fleet.shared.params, fleet.devices
        lag = lag_in_full(steady_state(params, devices.sample_period).lag_samples, devices.sample_period)
        q, r = trimmed(params.q, 4), trimmed(float(params.r), 4)
        unit = escape_markdown(squared(devices.unit), 20)
        said.append(f"One filter for all: q = {q}, r = {r} {unit}, lag {lag}.")
        if fleet.shared.judged:
            served = f"{percent(fleet.shared.served)} of {count(fleet.shared.judged)}"
            said.append(
                f"For {served} its error on unseen samples is at most 10 % above that of the device's own filter."
            )
    odd = int(fleet.outlier.sum())
    if odd:
        said.append(f"{plural(odd, 'device')} unlike the others in r or q.")
    return " ".join(said)


def fleet_table(shown: OpenFleet) -> str:
    """The first devices in the chosen order."""
    fleet, rows = shown.fleet, shown.rows
    if not rows:
        return "None."
    devices = fleet.devices
    if not devices.usable[rows].any():
        return "\n".join(
            f"{place}. {_name(fleet, i)}: {escape_markdown(fleet.devices.reasons[i], 120)}"
            for place, i in enumerate(rows, 1)
        )
    lines = ["| | device | q | r | loss |", "|--:|---|--:|--:|--:|"]
    for place, i in enumerate(rows, 1):
        growth = float(fleet.growth[i])
        loss = "–" if math.isnan(growth) else loss_text(growth).replace(" ", "\u00a0")
        name = f"**{_name(fleet, i)}**" if fleet.outlier[i] else _name(fleet, i)
        lines.append(f"| {place} | {name} | {_variance(devices.q[i])} | {_variance(devices.r[i])} | {loss} |")
    return "\n".join(lines)


def device_labels(shown: OpenFleet) -> dict[str, int]:
    """The devices of the table as a menu names them: their place and name, and the row of each."""
    fleet = shown.fleet
    return {f"{place}. {one_line(fleet.devices.name(i))[-60:]}": i for place, i in enumerate(shown.rows, 1)}


def _name(fleet: Fleet, i: int) -> str:
    """The end of a name, which tells devices apart."""
    name = one_line(fleet.devices.name(i))
    return escape_markdown(name if len(name) <= MAX_NAME else f"…{name[1 - MAX_NAME :]}", MAX_NAME)


def _variance(value: float) -> str:
    return "–" if math.isnan(value) else trimmed(float(value))


# A fleet beside the recording: what `kalscope fleet` found, sorted; a device is opened by name or in the map.


NONE = "–"


class FleetView:
    """The folder "Fleet" of the Source tab; only the path is on screen before a fleet is open."""

    def __init__(
        self,
        gui: viser.GuiApi,
        session: Session,
        jobs: Jobs,
        worker: Worker,
        open_device: Callable[[Fleet, int], None],
    ) -> None:
        """Args: the usual; the process that reads; opens the recording of a row."""
        self._session, self._jobs, self._worker, self._open_device = session, jobs, worker, open_device
        self._shown: OpenFleet | None = None
        with gui.add_folder("Fleet", expand_by_default=False):
            with gui.add_form(None) as form:
                self._path = gui.add_text(
                    "fleet folder",
                    "",
                    hint="The output folder (-o) of kalscope fleet.",
                )
            open_button = gui.add_button("Open fleet", hint="Show its devices here and in the map of q and r.")
            self._about = gui.add_markdown("", visible=False)
            self._order = gui.add_dropdown(
                "sort by", tuple(ORDERS), visible=False, hint="Which devices the table begins with."
            )
            self._find = gui.add_text("find device", "", visible=False, hint="Part of its name.")
            self._table = gui.add_markdown("", visible=False)
            self._device = gui.add_dropdown(
                "open device",
                _options({}),
                visible=False,
                hint="Opens its recording; so does a second click on its point in the map.",
            )
            self._at_shared = gui.add_checkbox(
                "at the filter for all", False, visible=False, hint="Open devices with the q and r that all share."
            )
            self._close = gui.add_button("Close fleet", visible=False, hint="Take its devices off the map.")
        for subscribe in (open_button.on_click, form.on_submit):
            on_user(subscribe, lambda _client: self._open(self._path.value.strip()))
        on_user(self._close.on_click, lambda _client: session.request(close_fleet))
        bind(self._order, session, set_fleet_order)
        bind(self._find, session, find_devices)
        bind(self._at_shared, session, set_at_shared)
        on_user(self._device.on_update, lambda _client: self._on_device())

    def _on_device(self) -> None:
        shown = self._shown
        device = None if shown is None else device_labels(shown).get(self._device.value)
        self._device.value = NONE  # no name stays that is not open, and the same device can be chosen again
        if shown is not None and device is not None:
            self._open_device(shown.fleet, device)

    def _open(self, folder: str) -> None:
        def work() -> None:
            if not folder or not Path(folder).is_dir():
                raise BadSetting(f"fleet folder must be the -o of kalscope fleet (got {folder[:200]!r}, no folder)")
            from kalscope.fleet.results import read_fleet  # with the fits of a fleet

            fleet = self._worker.run(partial(read_fleet, Path(folder)), one_line(Path(folder).name)[:100])
            self._session.request(open_fleet(fleet), failed=Failed.FLEET)

        self._jobs.run(work, Failed.FLEET)

    def show(self, shown: OpenFleet | None) -> None:
        """Show the fleet of a frame, once for each."""
        if shown is self._shown:
            return
        before = self._shown
        about = self._about, self._order, self._find, self._table
        for part in (*about, self._device, self._at_shared, self._close):
            put(part, visible=shown is not None)
        if shown is None:
            self._shown = None
            return
        if before is None or before.fleet is not shown.fleet:
            self._about.content = about_fleet(shown.fleet)
        if before is None:
            put(self._find, value=shown.find)
        put(self._table, content=fleet_table(shown))
        put(self._order, value=shown.order)
        put(self._at_shared, value=shown.at_shared)
        offer(self._device, _options(device_labels(shown)), NONE)
        self._shown = shown


def _options(labels: Iterable[str]) -> tuple[str, ...]:
    return (NONE, *labels)
