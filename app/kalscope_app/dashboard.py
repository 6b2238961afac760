"""The whole screen: builds the views, passes every frame to them, and shows errors."""

from __future__ import annotations

import contextlib
import gc
import logging
import threading
from collections.abc import Callable, Collection
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import viser

from kalscope.errors import KalscopeError, describe
from kalscope_app.engine.engine import Engine, Part, Studies, Study
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.live import BoardConnection, BoardRecording
from kalscope_app.program.user_settings import KeptTunings, UserSettings
from kalscope_app.session.changes import as_it_was_left
from kalscope_app.session.opening import later_answers, with_firsts
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.studies import checks, comparisons
from kalscope_app.studies.tuning_map import compute_map
from kalscope_app.views import window
from kalscope_app.views.board import BoardView, compared
from kalscope_app.views.chart_tabs import AllanView, AlternativesView, ChannelsView, SpectrumView
from kalscope_app.views.checks import ChecksView, VerdictView
from kalscope_app.views.export import CodeView, CommandLineView, add_downloads, device_notes
from kalscope_app.views.fleet import FleetTab
from kalscope_app.views.fusion import FusionView
from kalscope_app.views.goal import MORE_FOLDER, CostsView, GoalView
from kalscope_app.views.live import LiveView
from kalscope_app.views.map import TuningMapView
from kalscope_app.views.phone import PhonePictures
from kalscope_app.views.signal import SignalView, WindowView
from kalscope_app.views.source import QuestionView, SourceView
from kalscope_app.views.tune import ChainView, MoreView, ParametersView, StepsView
from kalscope_app.views.variants import VariantsView
from kalscope_app.worker.worker import Worker

log = logging.getLogger(__name__)

WARM_UP_AFTER_S = 2.0
"""Seconds from the first frame to the start of the worker: the browser loads the page first."""

MIN_NEW_OBJECTS = 50_000
"""New objects after which Python collects garbage from then on: in a few ms, which nobody sees."""


class Dashboard:
    """Views, session and engine on one server."""

    def __init__(self, server: viser.ViserServer, state: State, folder: Path, log_file: Path | None = None) -> None:
        """Build every view; nothing is shown yet.

        Args:
            server: the guarded server.
            state: what to show first; `start` connects its live board.
            folder: the folder that recordings stay in.
            log_file: the log, named in notifications.
        """
        self._server, self.notifications = server, window.Notifications(server, log_file)
        tell = self.notifications.tell
        self._port_jobs = Jobs(tell)  # a port must not wait for a long search
        self._connection = BoardConnection(self._port_jobs, state.live and state.live.board)
        self._settings = UserSettings()
        state = state.with_view(map_shown=self._settings.has("map_shown"))
        self.session = Session(state, self._connection)
        self._jobs, self._worker = Jobs(tell), Worker()
        self._panels = window.Panels(server)
        self._note, self._fitting = "", None
        self._views = window.GuardedViews(tell)
        self._last: Frame | None = None
        self._kept, self._opened, self._written = KeptTunings(), "", None
        self._map = TuningMapView(self.session)
        self._phones = PhonePictures()
        self._build(folder)
        judge, still = partial(checks.judge_sensors, kept=Cache()), partial(checks.still_stretch, kept=Cache())
        speeds, make_map = partial(checks.two_speeds_in, kept=Cache()), partial(compute_map, kept=Cache())
        rounds = [
            self._study(partial(comparisons.compute_variants, kept=Cache()), self._variants.show_table),
            Study(
                lambda state: (state, make_map(state)) if state.view.map_shown else None,
                lambda answer: self._draw(answer, self._map.show),  # not as a batch: frames must not wait for it
                lambda error: self._fail(error, self._map.show),
            ),
            self._study(compared, self._board.show_check),
            self._study(
                lambda state: judge(state) or checks.compute_checks(state, still, speeds),
                *(self._verdict.show_checks, self._checks.show, self._fusion.show_judged),
            ),
            self._study(lambda state: device_notes(state, self._code.choice), self._code.show_notes),
            self._study(partial(comparisons.compute_overview, kept=Cache()), self._channels.show_overview),
            self._study(checks.compute_spectra, self._spectrum.show),
            self._study(checks.compute_allan, self._allan.show),
            self._study(partial(comparisons.compute_alternatives, kept=Cache()), self._alternatives.show),
            Study(self._keep_tuning, lambda _kept: None, lambda error: log.info("not kept: %s", describe(error))),
        ]
        self.engine = Engine(self.session, self.show, tell, Studies(rounds), self._fail)
        server.on_client_connect(self._on_connect)
        server.on_client_disconnect(self._phones.detach)

    def _build(self, folder: Path) -> None:
        """All widgets, from top to bottom; the command palette last."""
        gui = self._server.gui
        names = ("Check", "Compare", "Channels", "Noise")
        check, compare, channels, noise = (self._panels.right.add_tab(name) for name in names)
        with check:
            self._checks = ChecksView(gui)
        self._build_left(gui, folder)
        self._variants = VariantsView(gui, compare, self.session)
        with self._panels.charts:
            self._question = QuestionView(gui, self._source)
            self._window = WindowView(gui, self.session)
            self.signal = SignalView(gui, self._question.asks)
        with compare:
            self._alternatives = AlternativesView(gui, self.session)
        with channels:
            self._channels = ChannelsView(gui, self.session)
        self._fleet = FleetTab(gui, self._panels.right, self.session, self._jobs, self._source.open_device)
        with noise:
            self._spectrum, self._allan = SpectrumView(gui), AllanView(gui)
        self._commands = window.Commands(gui)

    def _build_left(self, gui: viser.GuiApi, folder: Path) -> None:
        """The header and the tabs below it."""
        self._header = window.HeaderView(gui, self.session)
        self._verdict = VerdictView(gui, self.session)
        self._map.build_button(gui, self._settings, self._jobs)
        self._verdict.build_reasons(gui)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Tune"):
            steps = window.FirstSteps(gui, self._settings, self._jobs)
            self._build_tune(gui)
        with tabs.add_tab("Source"):
            self._source = SourceView(gui, self.session, self._jobs, self._worker, self._kept.last())
            recording = BoardRecording(self._connection, folder, self.notifications.tell, self.session.wakeup.set)
            self._live = LiveView(
                gui, self.session, self._port_jobs, self._connection, recording, self._source.open_spec
            )
            self._source.build_rest(gui)
            self._map.on_device = self._source.open_device
        with tabs.add_tab("Export"):
            self._code = CodeView(gui, self.session, self._jobs)
            self._board = BoardView(gui, self.session, self._jobs, self.notifications.tell, self._connection)
            add_downloads(gui, self.session, self._jobs)
            self._command_line = CommandLineView(gui)
        with tabs.add_tab("View"):
            self._view = window.ViewTab(gui, self.session)
            self._map.build_controls(gui)
        with tabs.add_tab("Help"):
            window.add_help(gui, steps)

    def _build_tune(self, gui: viser.GuiApi) -> None:
        self._chain = ChainView(gui, self.session)
        self._goal = GoalView(gui, self.session, self._jobs)
        self._parameters = ParametersView(gui, self.session, "q", "r", "p0")
        self._steps = StepsView(gui, self.session)
        with gui.add_folder(MORE_FOLDER, expand_by_default=False):
            self._fusion = FusionView(gui, self.session, self._jobs)
            self._more = MoreView(gui, self.session)
        self._costs = CostsView(gui, self._goal)
        self._verdict.search = self._goal.search

    def start(self) -> None:
        """Connect the board if there is one and show the first frame; returns once it is drawn, or after 60 s."""
        self._connection.start()
        self.engine.start()
        self.engine.first_frame.wait(timeout=60.0)
        later = threading.Timer(WARM_UP_AFTER_S, self._settle)
        later.daemon = True
        later.start()

    def _settle(self) -> None:
        """Do now what would otherwise interrupt a recording of a board."""
        gc.freeze()  # what is loaded by now stays: collecting garbage in it blocks the interpreter for 0.1 s
        gc.set_threshold(MIN_NEW_OBJECTS)
        with contextlib.suppress(OSError):  # the first task tries again, and reports why it fails
            self._worker.warm_up()

    def finish_recording(self) -> None:
        """Finish a recording and free the port; no further frame is computed meanwhile."""
        self.notifications.is_ending = True
        self.engine.end()
        self._connection.close(timeout=0.3)

    def _keep_tuning(self, state: State) -> None:
        """Keep the filters of the file on screen for the next start, if they have changed."""
        kept = state.recording.source, state.tunings, state.fused
        if state.live is None and kept != self._written and Path(state.recording.source).is_file():
            self._written = kept
            self._kept.keep(state.as_tuning())

    def stop(self) -> None:
        """Finish a recording, then end the worker and the engine, whose last frame may exceed the time left."""
        self.finish_recording()
        with contextlib.suppress(OSError, KalscopeError):
            if self._last is not None:
                self._keep_tuning(self._last.state)
        self._worker.close()
        self.engine.stop()

    def show(self, frame: Frame, parts: Collection[Part]) -> None:
        """Draw parts of a frame, as one message batch. Runs on the engine's thread."""
        with self._server.atomic():
            if Part.FULL in parts or Part.SIGNAL in parts:
                self._panels.show(frame)
                self._views.draw(self.signal.show, frame, thinned=Part.FULL not in parts)
            if Part.NUMBERS in parts:
                main = self._header, self._verdict, self._goal, self._parameters, self._more, self._chain
                views = *main, self._steps, self._costs, self._fusion
                self._draw(frame, *(view.show for view in views), self._map.follow)
            if Part.CHARTS in parts:
                self._draw(frame, self.signal.show_below)
            if Part.OTHER in parts:
                self._show_other(frame)
        self._server.flush()
        if Part.NUMBERS in parts:
            self._draw(frame, self._phones.show)
        if frame.state.note != self._note:
            self._note = frame.state.note
            if self._note:
                self.notifications.tell(self._note, good=True)

    def _show_other(self, frame: Frame) -> None:
        views = self._view, self._question, self._window, self._source, self._live
        self._draw(frame, *(view.show for view in views))
        if self._last is None or not only_grown(self._last, frame):
            views = self._variants, self._channels, self._code, self._board, self._command_line
            self._draw(frame, *(view.show for view in views))
        self._draw(frame.state.fleet, self._fleet.show)
        self._commands.show()
        self._last = frame
        source = frame.state.recording.source
        if self._fitting != frame.state.record_key:
            self._fitting = frame.state.record_key
            is_new, self._opened = source != self._opened, source
            self._jobs.run(lambda: self._fit(frame.state, is_new=is_new))

    def _fit(self, state: State, *, is_new: bool) -> None:
        """Find the first answers that the first picture did not wait for; what was left in a file comes after."""
        for firsts in later_answers(state):
            self.session.request(
                lambda now, firsts=firsts: with_firsts(now, firsts) if now.record_key == state.record_key else now
            )
        source = state.recording.source
        if is_new and Path(source).is_file() and (tuning := self._kept.of(source)) is not None:
            self.session.request(as_it_was_left(tuning))

    def _draw(self, answer: Any, *shows: Callable[[Any], None]) -> None:
        for show in shows:
            self._views.draw(show, answer)

    def _fail(self, error: Exception, *shows: Callable[[Any], None]) -> None:
        """Empty the views that would show what could not be computed; without any, all."""
        with self._server.atomic():
            self._views.fail(error, *shows)
        self._server.flush()

    def _study(self, compute: Callable[[State], Any], *shows: Callable[[Any], None]) -> Study:
        """A study whose answer is drawn as one message batch."""

        def draw(answer: Any) -> None:
            with self._server.atomic():
                self._draw(answer, *shows)
            self._server.flush()

        return Study(compute, draw, lambda error: self._fail(error, *shows))

    def _on_connect(self, client: viser.ClientHandle) -> None:
        """A new browser: its own upload button, its picture if it is on a phone, and what it missed."""
        self._source.add_upload(client)
        self._phones.attach(client)
        self.notifications.attach(client)
        if client.client_id not in self._server.get_clients():  # gone already: both run in a pool, in any order
            self._phones.detach(client)


def only_grown(last: Frame, frame: Frame) -> bool:
    """Whether a live record has new samples and nothing else is new, not even a request that was refused."""
    old, new = last.state, frame.state
    others = {one.name for one in fields(State)} - {"recording", "live"}
    same = all(getattr(old, name) is getattr(new, name) for name in others)
    return same and last.serial == frame.serial and None not in (old.live, new.live)
