"""A fleet beside the recording: what `kalscope fleet` found, sorted; a device is opened by name or in the map."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import viser

from kalscope.common.text import one_line, trimmed
from kalscope.errors import BadSetting
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
    shown_columns = len(HEAD) if any(row[-1] for row in cells) else len(HEAD) - 1
    lines = (HEAD, ("---",) * len(HEAD), *cells)
    return "\n".join(f"| {' | '.join(line[:shown_columns])} |" for line in lines) if cells else "None."


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


class FleetView:
    """The folder "Fleet" of the Source tab: opens and closes one."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs, worker: Worker) -> None:
        self._session, self._jobs, self._worker = session, jobs, worker
        with gui.add_folder("Fleet", expand_by_default=False):
            with gui.add_form(None) as form:
                self._path = gui.add_text("fleet folder", "", hint="The output folder (-o) of kalscope fleet.")
            open_button = gui.add_button(
                "Open fleet", hint="Shows its devices in a tab beside the charts and in the map."
            )
            self._close = gui.add_button("Close fleet", visible=False, hint="Take its devices off the map.")
        for subscribe in (open_button.on_click, form.on_submit):
            on_user(subscribe, lambda _client: self._open(self._path.value.strip()))
        on_user(self._close.on_click, lambda _client: session.request(close_fleet))

    def _open(self, folder: str) -> None:
        def work() -> None:
            if not folder or not Path(folder).is_dir():
                raise BadSetting(f"fleet folder must be the -o of kalscope fleet (got {folder[:200]!r}, no folder)")
            from kalscope.fleet.results import read_fleet  # with the fits of a fleet

            fleet = self._worker.run(partial(read_fleet, Path(folder)), one_line(Path(folder).name)[:100])
            self._session.request(open_fleet(fleet), failed=Failed.FLEET)

        self._jobs.run(work, Failed.FLEET)

    def show(self, shown: OpenFleet | None) -> None:
        """Offer to close what is open."""
        put(self._close, visible=shown is not None)


NONE = "–"


class FleetTab:
    """The tab "Fleet" of the wide pane, there only while a fleet is open; `map.js` brings it to the front."""

    def __init__(
        self,
        gui: viser.GuiApi,
        pane: viser.PanelHandle,
        session: Session,
        jobs: Jobs,
        open_device: Callable[[Fleet, int], None],
    ) -> None:
        """Args: the usual; the wide pane; opens the recording of a row."""
        self._gui, self._pane, self._session, self._jobs, self._open_device = gui, pane, session, jobs, open_device
        self._tab: viser.GuiTabHandle | None = None
        self._shown: OpenFleet | None = None

    def _build(self, shown: OpenFleet) -> viser.GuiTabHandle:
        gui, session = self._gui, self._session
        with self._pane.add_tab("Fleet") as tab:
            self._about = gui.add_markdown("")
            self._order = gui.add_dropdown("sort by", tuple(ORDERS), hint="Which devices the table begins with.")
            self._find = gui.add_text("find device", shown.find, hint="Part of its name.")
            self._table = gui.add_markdown("")
            self._device = gui.add_dropdown(
                "open device",
                list[str]([NONE]),
                hint="Opens its recording; so does a click on its point in the map.",
            )
            self._at_shared = gui.add_checkbox(
                "at the filter for all", False, hint="Open devices with the q and r that all share."
            )
            csv = gui.add_button("Download CSV", hint="The whole table of kalscope fleet.")
            page = gui.add_button("Download page", hint="The answer and the devices in this order: one HTML file.")
        bind(self._order, session, set_fleet_order)
        bind(self._find, session, find_devices)
        bind(self._at_shared, session, set_at_shared)
        on_user(self._device.on_update, lambda _client: self._on_device())
        on_user(csv.on_click, lambda client: self._send(client, "fleet.csv", _csv))
        on_user(page.on_click, lambda client: self._send(client, "fleet.html", html_page))
        return tab

    def _send(self, client: viser.ClientHandle, name: str, make: Callable[[OpenFleet], bytes]) -> None:
        shown = self._shown
        if shown is not None:
            send = client.send_file_download
            self._jobs.run(lambda: send(name, make(shown), save_immediately=True), Failed.SAVE)

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
            put(self._at_shared, value=shown.at_shared)
            offer(self._device, (NONE, *device_labels(shown)), NONE)
        self._shown = shown


def _csv(shown: OpenFleet) -> bytes:
    from kalscope.fleet.results import table_as_csv

    return table_as_csv(shown.fleet)
