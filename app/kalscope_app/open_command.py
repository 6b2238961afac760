"""`kalscope open`: starts and stops the dashboard."""

from __future__ import annotations

import contextlib
import functools
import logging
import secrets
import tempfile
import threading
import webbrowser
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.console import report_compiling
from kalscope.cli.options import (
    SamplePeriod,
    number_option,
    option_group,
    read_options,
    text_option,
    whole,
    with_options,
)
from kalscope.common.files import temporary_folder
from kalscope.common.stopping import stop_signals
from kalscope.common.text import one_line
from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.port.registry import ADDRESS_EXAMPLES, is_live
from kalscope.sources.port.ssh import FILE_PREFIX

if TYPE_CHECKING:
    from kalscope_app.guard.server import GuardedServer
    from kalscope_app.session.state import State

MAX_RECORDING_S = 2.5
"""Longest time to finish a recording, s: it takes 0.6 s unless the machine is busy or the disk hangs."""


_NOTHING: dict[str, str] = {}
FILTER_OPTIONS = option_group(
    {
        "q": text_option("NUMBER", "Process noise q of that channel, a variance."),
        "r": text_option("NUMBER", "Its measurement noise r, a variance."),
        "p0": text_option("NUMBER", "Its initial variance P₀, or automatic: the first sample."),
        "x0": text_option("NUMBER", "Its initial estimate x₀, or first; goes with --p0."),
        "gate": text_option("NUMBER", "Its outlier gate on v²/s, such as 9, or off."),
        "momentum": text_option("NUMBER", "Its momentum τ in samples, or off."),
        "fast": text_option("NUMBER", "Two speeds: q times this while it moves, or off."),
        "spikes": text_option("NUMBER", "With --fast: the probability of a spike."),
        "chain": text_option("FILTERS", 'Its filters, such as "median 5, kalman", or kalman.'),
    },
    dict[str, str],
)
"""The parameters of the filter, which `apply_options` checks as it does what is typed on the screen."""


@with_options(reading=read_options, given=FILTER_OPTIONS)
def open_dashboard(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help=f'A file; a live source: {ADDRESS_EXAMPLES}; "demo", "sample:NAME", "experiment:NAME".',
        ),
    ] = "",
    follow: Annotated[
        bool, typer.Option("--follow", "-f", help="Keep reading the file while another program writes to it.")
    ] = False,
    host: Annotated[str, text_option("ADDRESS", "Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, number_option("Port to listen on; 0 for any free one.", whole)] = 8080,
    browser: Annotated[bool, typer.Option(help="Open the link in the browser.")] = True,
    allow_host: Annotated[
        list[str] | None, text_option("NAME", "Name of this machine that browsers may use, for --host 0.0.0.0.")
    ] = None,
    sample_period: SamplePeriod = None,
    reading: ReadOptions = DEFAULTS,
    config: Annotated[Path | None, text_option("FILE", "Tuning file to start from.")] = None,
    behind: Annotated[
        str | None, text_option("URL", "https://NAME of the reverse proxy in front of the dashboard.")
    ] = None,
    new_link: Annotated[
        bool, typer.Option("--new-link", help="Make a new link; the old one of this port no longer works.")
    ] = False,
    log: Annotated[Path | None, text_option("FILE", "Write a detailed log to this file.")] = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print the log on the terminal.")] = False,
    channel: Annotated[str | None, text_option("NAME", "Channel to show: its name, or its number from 1.")] = None,
    given: dict[str, str] = _NOTHING,
) -> None:
    """Open the dashboard in a browser."""
    from kalscope_app.guard.requests import kept_token
    from kalscope_app.guard.server import guarded_server
    from kalscope_app.guard.viser_private import replaced
    from kalscope_app.program.log import logging_to
    from kalscope_app.session.changes import apply_options
    from kalscope_app.views.window import page_script

    def token(bound_port: int) -> str:
        return secrets.token_urlsafe(32) if port == 0 else kept_token(bound_port, renew=new_link)

    report_compiling()
    # All temporary files, also those of unfinished tasks, are removed at the end. Ctrl+C still interrupts reading.
    with (
        logging_to(log, verbose=verbose) as hidden,
        temporary_folder() as own,
        replaced(tempfile, "tempdir", str(own)),
    ):
        state = first_state(followed(source) if follow else source, reading, config, sample_period)
        state = apply_options(state, channel, **given)
        start = functools.partial(guarded_server, host, port, allow_hosts=allow_host or (), behind=behind)
        start = functools.partial(start, token=token, page_script=page_script(), hold=True)
        serve(state, start, log, hidden, browser=browser)


def serve(
    state: State, start_server: Callable[..., GuardedServer], log: Path | None, hidden: list[str], *, browser: bool
) -> None:
    """Show `state` in a dashboard until a signal ends it; `start_server` needs only `on_refused`.

    The token is added to what `hidden` keeps out of the file `log`.
    """
    from kalscope.common.compiled import watch_compiling
    from kalscope_app.guard.requests import opening_page
    from kalscope_app.guard.viser_private import callback_errors_to, thread_pool
    from kalscope_app.program.log import ErrorReporter
    from kalscope_app.session.session import Failed

    errors, opened, folder = ErrorReporter(), contextlib.ExitStack(), Path.cwd()
    dashboard: Dashboard | None = None

    def on_refused(why: str) -> None:
        if dashboard is not None:
            dashboard.notifications.tell(why, failed=Failed.OPEN)

    with errors.watch_threads(), callback_errors_to(functools.partial(errors.report, "callback")), opened:
        guarded = start_server(on_refused=on_refused)
        with stop_signals() as end:
            try:
                with end.interrupting():
                    hidden.append(guarded.token)
                    errors.watch_server(guarded.server.get_event_loop(), thread_pool(guarded.server))
                    print(f"Kalscope: {guarded.url}", flush=True)
                    if browser:
                        webbrowser.open(opened.enter_context(opening_page(guarded.url)).as_uri())
                    from kalscope_app.dashboard import Dashboard  # while the page loads

                    dashboard = Dashboard(guarded.server, state, folder, log)
                    errors.notify = dashboard.notifications.show_failure
                    dashboard.start()
                    watch_compiling(dashboard.notifications.show_compiling)
                    guarded.let_in()
                while not end.wait(timeout=0.5):  # Windows wakes for Ctrl+C only between two waits
                    pass
            finally:
                errors.is_ending = True
                if dashboard is not None:
                    end_within(MAX_RECORDING_S, "recording", dashboard.finish_recording)
                    end_within(0.5, "dashboard", dashboard.stop)
                end_within(0.7, "server", guarded.stop)


def end_within(seconds: float, name: str, stop: Callable[[], None]) -> None:
    """Stop a part of the program, but wait no longer than this."""
    thread = threading.Thread(target=stop, name=f"kalscope-end-{name}", daemon=True)
    thread.start()
    thread.join(seconds)
    if thread.is_alive():
        logging.getLogger(__name__).info("the %s did not end within %g s and is abandoned", name, seconds)


def first_state(
    source: str, options: ReadOptions, config: Path | None, sample_period: float | None = None
) -> State:
    """The state that is shown first; a live board is not connected yet."""
    from kalscope.catalogue import open_source
    from kalscope.sources.live.source import LiveSource
    from kalscope.tuning.file import load_tuning
    from kalscope_app.program.user_settings import KeptTunings
    from kalscope_app.session.changes import opened_live
    from kalscope_app.session.opening import adapted, opened_experiment, opened_raw

    tuning = None if config is None else load_tuning(config)
    if is_live(source):
        board = LiveSource(source, options)
        return replace(opened_live(board, board.spec.url, tuning=tuning), options=options)
    if tuning is None and source.startswith("experiment:"):
        return opened_experiment(source)
    spec = source or ("demo" if tuning is None else tuning.source)
    if not spec and tuning is not None:
        raise BadSetting(
            f"SOURCE must be given, because {config} was made from an uploaded file (got only --config): "
            f"kalscope open {tuning.source_name or 'FILE'} --config {config}"
        )
    state = opened_raw(open_source(spec, options, sample_period=sample_period))
    if tuning is not None:
        state = adapted(state, tuning)
    elif not source and (last := one_line(Path(KeptTunings().last()).name)[:80]):
        state = replace(state, note=f"{last} was open last: Open this path, in the Source tab, brings it back.")
    return replace(state, options=options, typed_period=sample_period or state.typed_period)


def followed(source: str) -> str:
    """The address of a file that is read as it grows; a live source is returned as it is."""
    if is_live(source):
        return source
    if not Path(source).is_file():
        raise BadSetting(f"--follow needs an existing file (got {source!r})")
    return f"{FILE_PREFIX}{Path(source).absolute()}"
