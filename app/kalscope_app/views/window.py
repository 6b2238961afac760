"""The window: panels, header, style, notifications, command palette, and the script of the page."""

from __future__ import annotations

import json
import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from importlib.resources import files
from pathlib import Path
from threading import Lock
from typing import Any, Literal, cast
from weakref import WeakKeyDictionary

import numpy as np
import viser

from kalscope.common.compiled import Compiling
from kalscope.common.text import decibels, lag_text, share_left
from kalscope.filtering.steady import steady_state
from kalscope.recording import Recording
from kalscope.sources.reading.axis import jitter_of, rate_words
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.guard.viser_private import commands_of, is_on_screen, press, widgets_of
from kalscope_app.program.log import sentence_for
from kalscope_app.program.user_settings import UserSettings
from kalscope_app.session.changes import select_channel, set_dark, set_smoother, set_velocity
from kalscope_app.session.session import Failed, Session
from kalscope_app.views.widgets import add_button, bind, capitalised, escape_markdown, offer, put, table_of

# A few rules of style that viser leaves to the browser: legible tables, and space between paragraphs.
#
# `window.py` applies them, so that the first picture already has them.


HEADING = '<span class="kalscope-heading"></span>'
"""Starts a markdown paragraph that is two lines high at least, so that the charts below it do not move."""

HEADER = '<span class="kalscope-header"></span>'
"""Precedes the header, which stays visible while the tab below it scrolls."""

FIGURE = '<span class="kalscope-figure">'
"""Starts a large figure, in bold, and the words below it."""

QUESTION = '<span class="kalscope-question"></span>'
"""Precedes a question above the charts, and its button."""

ONE_CHANNEL = '<span class="kalscope-one-channel"></span>'
"""On the page while the recording has one channel: the page then hides the tab that compares channels."""

VERDICT = '<span class="kalscope-verdict"></span>'
"""Precedes the button that shows the verdict."""

ONE_BUTTON = '<span class="kalscope-one-button"></span>'
"""Precedes a row of one button, which is then as wide as its label."""

STEP_BUTTONS = '<span class="kalscope-steps"></span>'
"""Precedes the row of small buttons, each as wide as where there are three."""

FILES = '<span class="kalscope-files"></span>'
"""Precedes the files in a dialog, which is then wide and high enough for code."""

PRIMARY: Literal["blue"] = "blue"
"""Colour of the one filled button of a tab, shown as the theme's own; buttons without a colour are outlined."""


# The panels, their sizes and the theme. Sizes are for a window 900 px high; `page_script` fits them to others.


LEFT_WIDTH = 345
"""Width of the control panel, px."""

RIGHT_WIDTH = 679
"""Width of the chart panel beside the tuning map in a window 1440 px wide, px."""

RIGHT_WIDTH_WITHOUT_MAP = 965
"""The same without the map, px: viser keeps a strip of its canvas, which the page covers."""

WINDOW_HEIGHT = 900
"""Height of the window for which all heights below are given, px."""

CHROME_HEIGHT = 108
"""Height of everything above and below the charts of the Signal tab: tab bar and heading; px. Firefox draws the
tab bar and the heading 2 px higher than Chromium."""

FRAME_HEIGHT = 26
"""Height of what surrounds each chart: its legend and the gap below it, px."""


def height_of(share: float, charts: int = 3) -> int:
    """Height of one of `charts` charts that takes this share of the space that a window has for them, px."""
    return round(share * (WINDOW_HEIGHT - CHROME_HEIGHT - charts * FRAME_HEIGHT))


def shape_of(client: viser.ClientHandle) -> float | None:
    """Width : height of a browser's canvas; None before it is known."""
    width, height = client.camera.image_width, client.camera.image_height
    return width / height if width > 0 and height > 0 else None


class Panels:
    """The control panel at the left edge and the chart panel at the right."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._map_shown = False
        self._set_theme(dark=False)
        server.scene.configure_default_lights(False, cast_shadow=False)  # only phones see it: a flat picture
        server.gui.main_panel.dock_left()
        server.gui.main_panel.set_width(LEFT_WIDTH)
        self.right = server.gui.add_panel()
        self.charts = self.right.add_tab("Signal")
        self.right.dock_right()
        self.right.set_width(RIGHT_WIDTH_WITHOUT_MAP)
        self.right.expand()

    def show(self, frame: Frame) -> None:
        """Follow the theme of the frame, and leave space for the map or give it to the charts."""
        view = frame.state.view
        if view.dark != self._dark:
            self._set_theme(dark=view.dark)
        if view.map_shown != self._map_shown:
            self._map_shown = view.map_shown
            self.right.set_width(RIGHT_WIDTH if view.map_shown else RIGHT_WIDTH_WITHOUT_MAP)

    def _set_theme(self, *, dark: bool) -> None:
        """Every call must name all options, or viser takes its own defaults again."""
        self._dark = dark
        self._server.gui.configure_theme(
            dark_mode=dark,
            show_logo=False,
            show_share_button=False,
            brand_color=(86, 180, 233) if dark else (0, 114, 178),
        )


# Sentences that appear over the screen: what was done, what was refused, what went wrong.


log = logging.getLogger(__name__)

NOTICE_S = 8.0
"""Seconds that a notification stays."""


class Notifications:
    """Shows one sentence at a time in every browser, and logs it. Any thread may call it."""

    def __init__(self, server: viser.ViserServer, log_file: Path | None) -> None:
        """Args: the server of the browsers; the log, named where something went wrong."""
        self._server, self._log_file = server, log_file
        self._shown = WeakKeyDictionary[viser.ClientHandle, viser.NotificationHandle]()
        self._last, self._ends = ("", "", True), 0.0  # on the monotonic clock, s
        self._lock = Lock()  # a browser may connect, on a thread of its own, while something is told
        self.is_ending = False
        """True during shutdown: errors are only logged, since what still runs may find the server closed."""

    def tell(self, message: str | Exception, *, good: bool = False, failed: Failed = Failed.OTHER) -> None:
        """Show one sentence.

        Args:
            message: the sentence, or an uncaught exception, which is logged.
            good: whether it is not an error.
            failed: the heading of a refusal.
        """
        if not isinstance(message, Exception):
            self._show("Kalscope" if good else failed, message, good=good)
        elif self.is_ending:
            log.info("at the end: %r", message)
        else:
            log.error("uncaught %s", type(message).__name__, exc_info=message)
            self.show_failure(message)

    def show_compiling(self, progress: Compiling) -> None:
        """Show how far the compiler is, which runs at the first start after an installation."""
        if progress.is_busy and self._server.get_clients():
            self.tell(f"{progress}.".capitalize(), good=True)

    def show_failure(self, error: Exception) -> None:
        """Show what to do after an uncaught exception."""
        self._show("Something went wrong", sentence_for(error, self._log_file))

    def attach(self, client: viser.ClientHandle) -> None:
        """Show a browser what nobody has seen yet, or what it has only begun to show in a connection before."""
        with self._lock:
            if client not in self._shown and time.monotonic() < self._ends:
                self._ends = time.monotonic() + NOTICE_S
                self._show_in(client, *self._last)

    def _show(self, title: str, message: str, *, good: bool = False) -> None:
        """One notification; plain text, so nothing in it can act as markup."""
        (log.info if good else log.warning)("%s", message)
        with self._lock:
            clients = self._server.get_clients().values()
            self._last, self._ends = (title, message, good), time.monotonic() + NOTICE_S if clients else math.inf
            for client in clients:
                self._show_in(client, title, message, good)

    def _show_in(self, client: viser.ClientHandle, title: str, message: str, good: bool) -> None:
        before = self._shown.get(client)
        if before is not None:  # one at a time: a stack of them would cover the charts
            before.remove()
        self._shown[client] = client.add_notification(
            title=title,
            body=message[:1000],
            auto_close_seconds=NOTICE_S,
            color=(0, 158, 115) if good else (213, 94, 0),
        )


# Draws views. One that fails is emptied: it must not go on showing another recording or an earlier setting.


NO_TEXT = "\u200b"
"""What an emptied text shows: it cannot be seen, and no view writes it."""

NO_PICTURE = np.zeros((2, 2, 3), dtype=np.uint8)
"""What an emptied picture shows: the page hides a picture of this size (`map.js`)."""


class GuardedViews:
    """Calls the methods that draw views. An exception is reported once, until the same method has succeeded."""

    def __init__(self, report: Callable[[Exception], object]) -> None:
        """Args: logs an exception and notifies the user."""
        self._report = report
        self._failed: dict[Callable[..., None], type[Exception] | None] = {}  # how the last call ended
        self._emptied: dict[Callable[..., None], list[tuple[Any, str, Any]]] = {}

    def draw(self, show: Callable[..., None], *answer: Any, **options: Any) -> None:
        """Call `show`, a method of a view."""
        try:
            show(*answer, **options)
        except Exception as error:
            self.fail(error, show)
            return
        self._failed[show] = None
        for widget, name, before in self._emptied.pop(show, ()):
            if is_empty(widget):  # the view has not written it again, because it has not changed
                setattr(widget, name, before)

    def fail(self, error: Exception, *shows: Callable[..., None]) -> None:
        """Empty the views of these methods; without any, of all methods that were called."""
        shows = shows or tuple(self._failed)
        if type(error) not in map(self._failed.get, shows):
            self._report(error)
        for show in shows:
            self._failed[show], view = type(error), getattr(show, "__self__", None)
            for widget in [one for one in widgets_in(view) if not is_empty(one)]:
                name, nothing = property_of(widget)
                self._emptied.setdefault(show, []).append((widget, name, getattr(widget, name)))
                setattr(widget, name, nothing)
            if (on_emptied := getattr(view, "on_emptied", None)) is not None:
                on_emptied()


def property_of(widget: Any) -> tuple[str, Any]:
    """The property by which a widget shows something, and its value when it shows nothing; "": it has none."""
    match widget:
        case viser.GuiMarkdownHandle():
            return "content", NO_TEXT
        case viser.GuiTextHandle(multiline=True):  # the others are for typing
            return "value", NO_TEXT
        case viser.GuiUplotHandle():
            return "data", (np.zeros(0),) * len(widget.data)
        case viser.GuiImageHandle():
            return "image", NO_PICTURE
        case _:
            return "", None


def is_empty(widget: Any) -> bool:
    """Whether a widget shows nothing."""
    name, nothing = property_of(widget)
    return np.array_equal(getattr(widget, name), nothing)


def widgets_in(part: object) -> Iterator[Any]:
    """What shows something in a view, and in the parts that it consists of."""
    parts: Iterable[object] = ()
    if property_of(part)[0]:
        yield part
    elif isinstance(part, list | tuple):
        parts = cast("Iterable[object]", part)
    elif type(part).__module__.startswith("kalscope_app.views"):
        parts = vars(part).values()
    for one in parts:
        yield from widgets_in(one)


# The script that fits the layout to each browser's window, in the page itself: no measuring, no round trip.
#
# viser has fixed sizes only, the same for every browser. The script runs before viser's own code and changes the
# sizes in the server's messages as they arrive, so the first picture already fills the window. When the window is
# resized it repeats those messages with new sizes. Without the script the layout fits a window of 1440 × 900 px.
#
# It also lets the charts write the numbers under the mouse to six digits, and their ticks as the texts write
# numbers; uPlot itself writes three decimals, so 0 for any value below 0.0005, and marks a sample that is missing
# in the corner of the chart.
#
# `keep_up.js` keeps a slow browser from falling behind a board, `text_boxes.js` decides when a typed text is sent
# and when it may be overwritten, `keyboard.js` makes the page work without a mouse, `scene.js` without WebGL,
# `stopped.js` says that the program has ended, and `map.js` beside `views/map.py` shows the tuning map.


APPLY_RULES = """{ const style = new CSSStyleSheet();
style.replaceSync(%s);
document.adoptedStyleSheets.push(style); }
"""
"""Adopted rules take precedence over those of viser's own style, wherever it puts them."""

PHONE_CHECKBOX = "phone"
"""Label of the hidden checkbox with which a page reports whether it is on a phone."""

ZOOM_SLIDER = "zoom"
"""Label of the hidden slider with which a page asks for the part of the window that was dragged over."""

LAG_NUMBER = "lag chosen"
"""Label of the hidden number with which a page reports the lag that was clicked, in the unit of the axis."""

MAP_PICTURE = "map picture"
"""Label of the hidden image that the page shows as the tuning map."""

MAP_PRESENT = "map present"
"""Label of the hidden vector with the position of the mark, in shares of the picture; below 0: there is none."""

MAP_POINTED = "map pointed"
"""Label of the hidden vector with which a page reports where the user points, in shares of the picture, and in
which gesture: a number for each, negative for a click, positive for a drag."""

EXPORT_BUTTON, PERIOD_BUTTON, STEPS_BUTTON = "Export this one", "Give the sample period", "Show the first steps"

GOAL = "Goal: "
"""What the commands begin with that choose a goal; they lead to the tab Tune."""

LEADS = {EXPORT_BUTTON: "Export", PERIOD_BUTTON: "Source", STEPS_BUTTON: "Tune"}
"""Labels of buttons that lead to another tab, and of that tab: viser cannot open a tab itself."""

COPY_BUTTON = "Copy text"
"""Label of a button that copies the text box above it, which only the page can do."""

TYPED = "Other address …"
"""The option of the menu of ports that stands for what is in the text box below."""

TEXT_BOXES = {"port": [TYPED, "address"]}
"""Menus into which a user may type what is no option: the option for that, and the label of its text box."""

SIZES = {
    "scene": 'canvas[width="0"] + div:not([class])',  # the box of viser's 3-D scene
    "phone": PHONE_CHECKBOX,
    "zoom": ZOOM_SLIDER,
    "lag": LAG_NUMBER,
    "phoneWidth": "(max-width: 36em)",  # viser then shows one sheet instead of panels
    "left": LEFT_WIDTH + 10,  # px, with the edges that viser adds to both panels
    "withMap": RIGHT_WIDTH,
    "withoutMap": RIGHT_WIDTH_WITHOUT_MAP,
    "minMap": 300,  # px
    "noMap": 120,  # px of canvas that viser keeps in any case
    "height": WINDOW_HEIGHT,
    "minHeight": CHROME_HEIGHT + 538,  # px; lower windows scroll
    "mapPicture": MAP_PICTURE,
    "mapPresent": MAP_PRESENT,
    "mapPointed": MAP_POINTED,
    "leads": LEADS,
    "goal": GOAL,
    "copyButton": COPY_BUTTON,
    "textBoxes": TEXT_BOXES,
}


NAMES = "keep_up", "stopped", "scene", "page_script", "text_boxes", "keyboard", "map"
"""The scripts beside this module, in the order in which they get each message."""


def page_script() -> str:
    """The script for the head of the page."""
    views, sizes = files("kalscope_app.views"), json.dumps(SIZES)
    page = views.joinpath("page")
    rules = json.dumps(page.joinpath("style.css").read_text("utf-8"))
    parts = (page.joinpath(f"{name}.js").read_text("utf-8") for name in NAMES)
    return APPLY_RULES % rules + "".join(f"{{ const sizes = {sizes};\n{part}}}\n" for part in parts)


# The command palette, Ctrl+K: every button, checkbox and button of a row, by its label.


WITHOUT = {"", "…", "Cancel"}
"""Widgets that have no name of their own, or show only while something runs."""


class Commands:
    """One command for each; made last, when all widgets are there."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui = gui
        self._commands: list[tuple[Any, viser.CommandHandle]] = []
        taken = {*WITHOUT, *commands_of(gui)}
        for widget in widgets_of(gui):
            single = (widget.label,) if isinstance(widget, viser.GuiCheckboxHandle | viser.GuiButtonHandle) else ()
            names = widget.options if isinstance(widget, viser.GuiButtonGroupHandle) else single
            for name in names:
                if name not in taken:
                    self._add(gui, name, widget)

    def _add(self, gui: viser.GuiApi, label: str, widget: Any) -> None:
        command = gui.add_command(f"{label[:1].upper()}{label[1:]}", description=widget.hint)

        async def trigger(event: viser.CommandEvent) -> None:
            if event.client is None or not is_on_screen(gui, widget):
                return
            if isinstance(widget, viser.GuiButtonGroupHandle):
                widget.value = label
            elif isinstance(widget, viser.GuiCheckboxHandle):
                widget.value = not widget.value
            await press(widget, event.client)

        command.on_trigger(trigger)
        self._commands.append((widget, command))

    def show(self) -> None:
        """Follow the names of the buttons, and what is on screen."""
        for widget, command in self._commands:
            put(command, disabled=not is_on_screen(self._gui, widget))
            if isinstance(widget, viser.GuiButtonHandle):
                put(command, label=widget.label)


# The View tab: the theme, and what is drawn beside the filtered signal.


VIEW_BOXES = {
    "dark": ("dark theme", "In every browser that shows this session.", set_dark),
    "smoother": (
        "show smoother (offline bound)",
        "It also uses later samples, which a device cannot.",
        set_smoother,
    ),
    "velocity": ("show velocity", "In place of the gain, where the filter has momentum.", set_velocity),
}
"""Label and hint of each checkbox, and the change that it requests, by the field of the View."""


class ViewTab:
    """Three checkboxes; the map puts its own controls below them."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._boxes = {
            name: bind(gui.add_checkbox(label, False, hint=hint), session, change)
            for name, (label, hint, change) in VIEW_BOXES.items()
        }

    def show(self, frame: Frame) -> None:
        """Follow the frame."""
        for name, box in self._boxes.items():
            box.value = getattr(frame.state.view, name)


# The first steps: three sentences above the goal, which cover nothing.


FIRST_STEPS = (
    "**First steps.** Grey is the raw signal, orange the filtered one: less noise, but late.\n\n"
    "1. Enter the largest lag that you can accept and press **Apply**: of all filters within that lag you get "
    "the one that leaves the least noise.\n"
    "2. Adjust it: a larger **q** follows faster, a larger **r** smooths more; Ctrl+Z undoes.\n"
    "3. **Source** opens your file or a live board. **Export** writes the code."
)


class FirstSteps:
    """They stand there until they are put away, and again when asked."""

    def __init__(self, gui: viser.GuiApi, settings: UserSettings, jobs: Jobs) -> None:
        self._text = gui.add_markdown(FIRST_STEPS)

        def put_away(_client: viser.ClientHandle) -> None:
            self.show(visible=False)
            jobs.run(partial(settings.keep, tour_seen=True))

        self._done = add_button(gui, "Got it", "The Help tab shows them again.", put_away)
        self.show(visible=not settings.has("tour_seen"))

    def show(self, *, visible: bool = True) -> None:
        """Show or hide them."""
        self._text.visible = self._done.visible = visible


# The Help tab: keys and mouse on one card, and the first steps again.


KEYS = {
    "drag across a chart": "zoom in",
    "double-click a chart": "zoom out",
    "click a line's name": "hide or show it",
    "← → on a slider": "one step, 2.3 %",
    "Home, End on a slider": "minimum, maximum",
    "number, Enter": "exact value, such as 1e‑9",
    "Ctrl+Z": "undo",
    "Ctrl+Shift+Z, Ctrl+Y": "redo",
    "Ctrl+K": "every goal and button by its name",
    "drag a panel's edge": "make it wider",
}
"""Keys and mouse actions, and what they do."""


def add_help(gui: viser.GuiApi, steps: FirstSteps) -> None:
    """The Help tab: a card and a button."""
    rows = [{"keys and mouse": what, "what it does": does} for what, does in KEYS.items()]
    gui.add_markdown(f"{table_of(rows)}\n\nOn a Mac: Cmd for Ctrl.")
    add_button(gui, STEPS_BUTTON, "In the Tune tab, above the goal.", lambda _client: steps.show())
    gui.add_markdown("Point at a control to read what it does.")


# The header above the tabs: what is open, its channel and rate, and what the filter costs and gives.


class HeaderView:
    """What is open, its channel where there are several, and two large figures."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        gui.add_html(HEADER)
        self._record = gui.add_markdown("")
        self._channel = gui.add_dropdown("channel", list[str](["–"]), hint="Each channel has its own filter.")
        self._one = gui.add_html(ONE_CHANNEL)
        self._figures = gui.add_markdown("")
        self._described: Recording | None = None
        bind(self._channel, session, select_channel)

    def show(self, frame: Frame) -> None:
        """Write them."""
        record, fusion = frame.state.recording, frame.state.fused
        if record is not self._described:  # every stamp is read: once a recording, not once a frame
            self._described, self._record.content = record, record_line(record)
        names = record.names if fusion is None else (*record.names, fusion.tuning.name)
        offer(self._channel, names, frame.state.channel if frame.state.fusion is None else names[-1])
        put(self._one, visible=len(record.names) == 1)
        put(self._channel, visible=len(record.names) > 1)
        self._figures.content = figures(frame)


def record_line(recording: Recording) -> str:
    """Name and rate, with how far the steps vary; markdown, escaped."""
    rate = rate_words(recording.sample_period, jitter_of(recording))
    return f"**{escape_markdown(recording.title, 40)}** · {rate}"


def figures(frame: Frame) -> str:
    """The lag and what is left of the noise, as two large figures; first the filter, where it is another one."""
    steady, chain = frame.steady, frame.state.tuning.chain
    left, level = share_left(steady.noise_reduction_db), decibels(-steady.noise_reduction_db)
    name = "" if chain is None else f"**{capitalised(chain.words)}**  \n"
    lag = lag_text(steady.lag_samples, period := frame.state.recording.sample_period)
    params = frame.state.params
    if params.fast is not None and frame.state.uses_parameters:
        moving, both = steady_state(params.moving), ", at rest → moving"
        lags = f"{lag} → {lag_text(moving.lag_samples, period)}"
        noises = f"{left} → {share_left(moving.noise_reduction_db)}"
        return f"{FIGURE}**{lags}** lag{both}</span> {FIGURE}**{noises}** noise left{both}</span>"
    return f"{name}{FIGURE}**{lag}** lag</span> {FIGURE}**{left}** noise left ({level})</span>"
