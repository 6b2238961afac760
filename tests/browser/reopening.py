"""Run by a program that many tests share: on request it shows what `open SOURCE` shows, as if it had just begun."""

from __future__ import annotations

import contextlib
import itertools
import threading
from multiprocessing.connection import Client
from typing import Any

import viser
from tests.support.waiting import wait_until

from kalscope.sources.grammar.read_options import DEFAULTS
from kalscope_app.dashboard import Dashboard
from kalscope_app.open_command import first_state
from kalscope_app.session.opening import later_answers, with_firsts
from kalscope_app.session.session import History
from kalscope_app.session.state import State

SOURCE = "demo"
"""What the program is started on."""
BUTTONS = viser.GuiButtonHandle | viser.GuiButtonGroupHandle | viser.GuiUploadButtonHandle


def connect(address: str) -> None:
    """Once the dashboard has begun, ask at this address which source it shall begin with."""
    start = Dashboard.start

    def started(dashboard: Dashboard) -> None:
        start(dashboard)
        threading.Thread(target=serve, args=(dashboard, address), daemon=True).start()

    Dashboard.start = started


def serve(dashboard: Dashboard, address: str) -> None:
    """Answer each source with the id of an element that a page has once it shows it, until the next source."""
    server, gui = dashboard._server, dashboard._server.gui
    first = fitted_state(SOURCE)
    chosen = [(handle, choice_of(handle)) for handle in gui._gui_input_handle_from_uuid.values()]
    folders = gui._container_handle_from_uuid.values()
    mark: viser.GuiHtmlHandle | None = None
    with contextlib.suppress(EOFError), Client(address) as tests:
        tests.send([one.label for one in folders if getattr(one, "expand_by_default", None) is False])
        for number in itertools.count():
            source = tests.recv()
            if mark is not None:
                mark.remove()
                mark = None
            try:
                show(dashboard, first)
                for handle, values in chosen:  # what no frame has put back
                    for name, value in values.items():
                        setattr(handle, name, value)
                if source != SOURCE:
                    show(dashboard, fitted_state(source))
            except Exception as error:
                tests.send(error)
                continue
            mark = gui.add_html(f'<i id="reopened-{number}"></i>')
            server.flush()
            tests.send(f"reopened-{number}")


def fitted_state(source: str) -> State:
    """The state of `open SOURCE` once the first answers have come."""
    state = first_state(source, DEFAULTS, None)
    for firsts in later_answers(state):
        state = with_firsts(state, firsts)
    return state


def choice_of(handle: Any) -> dict[str, object]:
    """What a user can choose or type in a widget, by name; empty for buttons."""
    names = () if isinstance(handle, BUTTONS) else ("options", "value")
    return {name: getattr(handle, name) for name in names if hasattr(handle, name)}


def show(dashboard: Dashboard, state: State) -> None:
    """Show a state without a past, in charts that forget their zoom."""
    session = dashboard.session
    serial = session.request(lambda now: state.with_view(resets=now.view.resets + 1))
    wait_until(lambda: dashboard._last is not None and dashboard._last.serial >= serial, "the frame")
    session._history = History()
