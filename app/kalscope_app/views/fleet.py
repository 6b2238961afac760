"""A fleet beside the recording: what `kalscope fleet` found, sorted; a device is opened by name or in the map."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import viser

from kalscope.common.text import one_line, trimmed
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes import close_fleet, find_devices, set_fleet_order
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import ORDERS, OpenFleet, loss_text
from kalscope_app.views.export import send_file
from kalscope_app.views.widgets import add_button, bind, escape_markdown, offer, on_user, put, table_of

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet

    OpenDevice = Callable[[Fleet, int], None]

# The texts of the tab "Fleet"; names may hold anything. Pure.


HEAD = ("", "device", "q", "r", "loss", "without q and r because")


def about_fleet(fleet: Fleet) -> str:
    """What `kalscope fleet` prints about it, as markdown."""
    from kalscope.fleet.results import answer_lines

    return "\n\n".join(escape_markdown(line, 600) for line in answer_lines(fleet))


def fleet_rows(fleet: Fleet, rows: list[int]) -> list[list[str]]:
    """Cells under HEAD of these devices."""

    def variance(value: float) -> str:
        return "" if math.isnan(value) else trimmed(float(value))

    devices, growth = fleet.devices, fleet.growth
    return [
        [
            str(place),
            one_line(devices.name(i)),
            variance(devices.q[i]),
            variance(devices.r[i]),
            "" if math.isnan(growth[i]) else loss_text(float(growth[i])),
            one_line(devices.reasons[i])[:120],
        ]
        for place, i in enumerate(rows, 1)
    ]


def fleet_table(shown: OpenFleet) -> str:
    """The first devices in the chosen order as markdown, those unlike the others in bold."""
    cells = [[escape_markdown(text, 200) for text in row] for row in fleet_rows(shown.fleet, shown.rows)]
    for row, i in zip(cells, shown.rows, strict=True):
        row[1] = f"**{row[1]}**" if shown.fleet.outlier[i] else row[1]
    return table_of([dict(zip(HEAD, row, strict=True)) for row in cells]) if cells else "None."


def device_labels(shown: OpenFleet) -> dict[str, int]:
    """The devices of the table as a menu names them: their place and name, and the row of each."""
    fleet = shown.fleet
    return {f"{place}. {one_line(fleet.devices.name(i))[-60:]}": i for place, i in enumerate(shown.rows, 1)}


def html_page(shown: OpenFleet) -> bytes:
    """One page with the answer and the devices, the first MAX_ON_PAGE in the chosen order."""
    from kalscope.fleet.results import answer_page

    rows = shown.ranked[:MAX_ON_PAGE].tolist()
    return answer_page(shown.fleet, HEAD, fleet_rows(shown.fleet, rows)).encode()


MAX_ON_PAGE = 2000


def csv(shown: OpenFleet) -> bytes:
    """The whole table."""
    from kalscope.fleet.results import table_as_csv

    return table_as_csv(shown.fleet)


DOWNLOADS: dict[str, tuple[str, str, Callable[[OpenFleet], bytes]]] = {
    "Download CSV": ("The whole table of kalscope fleet.", "fleet.csv", csv),
    "Download page": ("The answer and the devices in this order: one HTML file.", "fleet.html", html_page),
}
"""Buttons: their hints, the names of their files, and what makes them."""


def fleet_of(folder: Path) -> Fleet:
    """The fleet of the output folder of `kalscope fleet`."""
    from kalscope.fleet.results import read_fleet  # with the fits of a fleet

    return read_fleet(folder)


NONE = "–"


class FleetTab:
    """The tab "Fleet" of the wide pane, there only while a fleet is open; `map.js` brings it to the front."""

    def __init__(
        self, gui: viser.GuiApi, pane: viser.PanelHandle, session: Session, jobs: Jobs, open_device: OpenDevice
    ) -> None:
        """Args: the usual; the wide pane; opens the recording of a row."""
        self._gui, self._pane, self._session, self._jobs, self._open_device = gui, pane, session, jobs, open_device
        self._tab: viser.GuiTabHandle | None = None
        self._shown: OpenFleet | None = None

    def _build(self, shown: OpenFleet) -> viser.GuiTabHandle:
        gui, session = self._gui, self._session
        with self._pane.add_tab("Fleet") as tab:
            self._about = gui.add_markdown("")
            order = gui.add_dropdown("sort by", tuple(ORDERS), hint="Which devices the table begins with.")
            self._order = bind(order, session, set_fleet_order)
            bind(gui.add_text("find device", shown.find, hint="Part of its name."), session, find_devices)
            self._table = gui.add_markdown("")
            hint = "Opens its recording; so does a click on its point in the map."
            self._device = gui.add_dropdown("open device", list[str]([NONE]), hint=hint)
            for label, (hint, name, make) in DOWNLOADS.items():
                add_button(gui, label, hint, partial(self._send, name, make))
            add_button(gui, "Close fleet", "Take its devices off the map.", lambda _: session.request(close_fleet))
        on_user(self._device.on_update, lambda _client: self._on_device())
        return tab

    def _send(self, name: str, make: Callable[[OpenFleet], bytes], client: viser.ClientHandle) -> None:
        shown = self._shown
        if shown is not None:
            self._jobs.run(lambda: send_file(client, name, make(shown)), Failed.SAVE)

    def _on_device(self) -> None:
        shown = self._shown
        device = None if shown is None else device_labels(shown).get(self._device.value)
        self._device.value = NONE  # no name stays that is not open, and the same device can be chosen again
        if shown is not None and device is not None:
            self._open_device(shown.fleet, device)

    def show(self, shown: OpenFleet | None) -> None:
        """Show the fleet of a frame, once for each."""
        if shown is self._shown:
            return
        if shown is None or self._tab is None:
            if self._tab is not None:
                self._tab.remove()
            self._tab = None if shown is None else self._build(shown)
        if shown is not None:
            put(self._about, content=about_fleet(shown.fleet))
            put(self._table, content=fleet_table(shown))
            put(self._order, value=shown.order)
            offer(self._device, (NONE, *device_labels(shown)), NONE)
        self._shown = shown
