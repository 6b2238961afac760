"""Connects widgets with the session, shows the progress of jobs, and writes words as markdown."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import viser

from kalscope.common.progress import Progress
from kalscope.common.text import squared
from kalscope_app.engine.frame import Frame
from kalscope_app.guard.viser_private import set_ends
from kalscope_app.session.changes import set_text
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import Change

H = TypeVar("H", bound=viser.GuiInputHandle[Any])

# Words in markdown: names from outside the program, the beginning of a sentence, and tables.


def escape_markdown(text: str, limit: int = 60) -> str:
    """A name from outside the program on one line, cut to `limit`, with every markup character escaped."""
    line = re.sub(r"[^\S\u202f\xa0]+", " ", text).strip()  # no break within a number
    line = line if len(line) <= limit else line[: limit - 1] + "…"
    return re.sub(r"([\\`*_{}\[\]()#+\-.!|<>&~:$@\"'/^=])", r"\\\1", line)


def capitalised(words: str) -> str:
    """Words with a capital first letter, as at the beginning of a sentence."""
    return f"{words[:1].upper()}{words[1:]}"


MAX_UNBROKEN = 13
"""Characters up to which a cell of a table stays on one line, so that seven columns fit at 1280 px."""


def table_of(rows: Sequence[Mapping[str, str]]) -> str:
    """A markdown table of rows, each the cells by the heads of their columns; empty columns are left out."""
    heads = [head for head in rows[0] if any(row[head] for row in rows)]
    cells = [[row[head] or "–" for head in heads] for row in rows]
    glued = ([one.replace(" ", "\u00a0") if len(one) <= MAX_UNBROKEN else one for one in row] for row in cells)
    return "\n".join(f"| {' | '.join(line)} |" for line in (heads, ["---"] * len(heads), *glued))


# Connects widgets with the session: what a user does with a widget files a request.
#
# Values are set by plain assignment: viser sends nothing for an equal value, and `on_user` ignores assignments.


def on_user(
    subscribe: Callable[[Callable[[Any], Any]], object], act: Callable[[viser.ClientHandle], object]
) -> None:
    """Call `act` with the browser whenever a user does something with a widget.

    Args:
        subscribe: such as `button.on_click` or `slider.on_update`.
        act: runs on viser's event loop, so it must be quick. In the thread pool, events could change their order.
    """

    async def callback(event: Any) -> None:
        if event.client is not None:  # otherwise the program itself has set the value
            act(event.client)

    subscribe(callback)


def add_button(
    gui: viser.GuiApi, label: str, hint: str | None, act: Callable[[viser.ClientHandle], object], **look: Any
) -> viser.GuiButtonHandle:
    """A button that calls `act` with the browser in which it is pressed."""
    button = gui.add_button(label, hint=hint, **look)
    on_user(button.on_click, act)
    return button


MIN_SECONDS = 1.0
"""Seconds after which a job shows its progress and can be cancelled."""


class SlowJob:
    """The progress of a job and its Cancel button. Use it in a `with` statement around the job."""

    def __init__(self, gui: viser.GuiApi, hint: str) -> None:
        """Args: the usual; what Cancel does."""
        self._stop, self._start = threading.Event(), 0.0
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._cancel = add_button(gui, "Cancel", hint, lambda _client: self._stop.set(), visible=False)

    def __enter__(self) -> Progress:
        self._stop, self._start = threading.Event(), time.monotonic()  # Cancel stops what runs, not what waits
        return Progress(self._report, self._stop.is_set)

    def __exit__(self, *_error: object) -> None:
        self._bar.visible = self._cancel.visible = False

    def _report(self, fraction: float, _text: str) -> None:
        if time.monotonic() - self._start > MIN_SECONDS:
            self._bar.value = min(max(100.0 * fraction, 0.0), 100.0)
            self._bar.visible = self._cancel.visible = True


def bind(handle: H, session: Session, change: Callable[[Any], Change]) -> H:
    """The widget, which requests `change(value)` whenever a user edits it."""
    on_user(handle.on_update, lambda _client: session.request(change(handle.value)))
    return handle


def put(handle: Any, **properties: Any) -> None:
    """Set the properties that differ. viser sends no equal value either, but takes 15 µs to find that out.

    Every frame sets the properties of a hundred widgets, and almost none of them changes.
    """
    for name, value in properties.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def typed(value: float) -> str:
    """A value for a text box, up to seven digits, without padding zeros: 0.0589, 1e-9, 1469.18."""
    text = f"{value:.7g}"
    return re.sub(r"e([+-])0*(\d)", lambda m: f"e{m[1].replace('+', '')}{m[2]}", text)


def offer(dropdown: viser.GuiDropdownHandle[str], options: Iterable[str], value: str) -> None:
    """Set the options and the value of a dropdown; equal options are not sent again, which would close its menu."""
    options = tuple(options)
    if tuple(dropdown.options) != options:
        dropdown.options = options
    dropdown.value = value


class TypedNumber:
    """A number typed as text, so that 1e-9 works. `text_boxes.js` sends a finished text, not each key."""

    def __init__(
        self,
        gui: viser.GuiApi,
        session: Session,
        name: str,
        label: str,
        hint: str,
        change: Callable[[str, str], Change] = set_text,
        written: Callable[[float], str] = typed,
    ) -> None:
        self._session, self._name, self._hint, self._change, self._written = session, name, hint, change, written
        self._text = gui.add_text(label, "", hint=hint)
        self._value: object = ...  # nothing has been shown yet
        self._serial, self._stale = 0, False
        on_user(self._text.on_update, lambda _client: self._file())

    def _file(self) -> None:
        """Request what was typed; the frame of it, or of its refusal, writes what the filter uses."""
        self._stale = True  # before the request: its frame may come before its serial
        change = self._change(self._name, self._text.value)
        self._serial = self._session.request(change, key=f"text {self._name}", failed=Failed.NUMBER)

    def show(self, frame: Frame, value: float | None, missing: str, *, visible: bool = True) -> None:
        """Write the frame's value, unless a newer one was typed or the value has not changed."""
        put(self._text, visible=visible)
        if "{unit}" in self._hint:
            put(self._text, hint=self._hint.format(unit=squared(frame.state.tuning.unit)))
        if frame.serial < self._serial or (value == self._value and not self._stale):
            return
        self._value, self._stale = value, False
        self._text.value = missing if value is None else self._written(value)


SLIDER_HINT = "Drag, or click and use the arrow keys."

Ends = tuple[tuple[float, str], tuple[float, str]]
"""Position and words of both ends of a slider."""


class NumberWithSlider:
    """One parameter in one row: its exact value as text, and a slider for its position on a scale."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, label: str, box: TypedNumber, change: Callable[[float], Change]
    ) -> None:
        """Args: the usual; the name of the slider; the box before it; the change that a new position asks for."""
        self._session, self._label, self._change, self._box = session, label, change, box
        self.slider = gui.add_slider(label, min=-6.0, max=6.0, step=0.01, initial_value=0.0, hint=SLIDER_HINT)
        self._serial = 0
        on_user(self.slider.on_update, lambda _client: self._file())

    def is_held(self, frame: Frame) -> bool:
        """Whether this frame answers a move of the slider, or is older than that."""
        return 0 < frame.serial <= self._serial

    def _file(self) -> None:
        change = self._change(float(self.slider.value))
        self._serial = self._session.request(change, key=f"slider {self._label}")

    def show(
        self, frame: Frame, value: float | None, missing: str, position: float, ends: Ends, *, visible: bool
    ) -> None:
        """Write the value, and move the slider between its ends unless it was moved since."""
        self._box.show(frame, value, missing, visible=visible)
        put(self.slider, visible=visible)
        if frame.serial < self._serial:
            return
        set_ends(self.slider, *ends)
        if abs(self.slider.value - position) > 0.005:
            self.slider.value = round(position, 2)
