"""The program `kalscope`: the headless commands, and `open`, which starts and stops the dashboard."""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import signal
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.app import app, run
from kalscope.cli.options import Delimiter, GapsChoice, Missing, TimeColumnChoice, TimeUnit
from kalscope.sources.lines.read_options import ReadOptions, options_from_text
from kalscope_app.open_options import P0, X0, Channel, Gate, Q, R

if TYPE_CHECKING:
    from kalscope_app.program.log_file import Log
    from kalscope_app.session.state import State


@app.command("open")
def open_dashboard(
    source: Annotated[
        str, typer.Argument(help='A file, a port as "serial:PORT@BAUD", "demo", "sample:NAME", "experiment:NAME".')
    ] = "",
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on; 0 for any free one.")] = 8080,
    browser: Annotated[bool, typer.Option(help="Open the link in the browser.")] = True,
    allow_host: Annotated[
        list[str] | None, typer.Option(help="Name by which a browser may call this machine, for --host 0.0.0.0.")
    ] = None,
    sample_period: Annotated[
        float | None, typer.Option(help="Time between two samples in s; overrules that of the file.")
    ] = None,
    delimiter: Delimiter = None,
    time_column: TimeColumnChoice = None,
    time_unit: TimeUnit = None,
    missing: Missing = None,
    gaps: GapsChoice = None,
    config: Annotated[Path | None, typer.Option(help="Tuning file to start from.")] = None,
    behind: Annotated[
        str | None, typer.Option(metavar="URL", help="https://NAME of a reverse proxy that shows the dashboard.")
    ] = None,
    new_link: Annotated[
        bool, typer.Option("--new-link", help="Lock out whoever has this port's old link.")
    ] = False,
    log: Annotated[Path | None, typer.Option(metavar="FILE", help="Write down what happens, with details.")] = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say on the terminal what happens.")] = False,
    channel: Channel = None,
    q: Q = None,
    r: R = None,
    p0: P0 = None,
    x0: X0 = None,
    gate: Gate = None,
) -> None:
    """Open the dashboard in a browser."""
    from kalscope_app.guard.token_file import kept_token
    from kalscope_app.program.log_file import logging_to
    from kalscope_app.session.share import apply_options

    def token(bound_port: int) -> str:
        return secrets.token_urlsafe(32) if port == 0 else kept_token(bound_port, renew=new_link)

    options = options_from_text(delimiter, time_column, time_unit, missing or (), gaps)
    with logging_to(log, verbose=verbose) as running_log, own_temporary_folder():  # Ctrl+C still interrupts reading
        state = apply_options(first_state(source, options, config, sample_period), channel, q, r, p0, x0, gate)
        door = Door(host, port, tuple(allow_host or ()), behind, token)
        with asked_to_end() as end:
            serve(state, door, end, running_log, browser=browser)


@dataclass(frozen=True)
class Door:
    """Where the dashboard listens, and who may come: the arguments of `guarded_server`."""

    host: str
    port: int
    allow_hosts: tuple[str, ...]
    behind: str | None
    token: Callable[[int], str]


def serve(state: State, door: Door, end: threading.Event, log: Log, *, browser: bool) -> None:
    """Run the dashboard until `end` is set; then everything is closed."""
    from kalscope_app.dashboard import Dashboard
    from kalscope_app.guard.server import guarded_server
    from kalscope_app.guard.token_file import opening_page
    from kalscope_app.program.error_reporting import Trouble
    from kalscope_app.views.window.page_script import page_script

    trouble, opened = Trouble(), contextlib.ExitStack()
    dashboard: Dashboard | None = None

    def on_refused(why: str) -> None:
        if dashboard is not None:
            dashboard.tell(why)

    with trouble.watch_threads(), opened:
        guarded = guarded_server(
            door.host,
            door.port,
            allow_hosts=door.allow_hosts,
            behind=door.behind,
            token=door.token,
            on_refused=on_refused,
            page_script=page_script(),
            label="Kalscope",
        )
        try:
            log.hide(guarded.token)
            trouble.watch_server(guarded.server._event_loop, guarded.server._thread_executor)
            dashboard = Dashboard(guarded.server, state, Path.cwd(), log.file)
            trouble.tell_with(dashboard.tell)
            dashboard.start()
            print(f"Kalscope: {guarded.url}", flush=True)
            if browser:
                webbrowser.open(opened.enter_context(opening_page(guarded.url)).as_uri())
            while not end.wait(timeout=0.5):  # Windows wakes for Ctrl+C only between two waits
                pass
        finally:
            trouble.is_ending = True
            if dashboard is not None:
                end_within(1.0, "dashboard", dashboard.stop)
            end_within(0.7, "server", guarded.stop)


def end_within(seconds: float, name: str, stop: Callable[[], None]) -> bool:
    """Stop a part of the program, but wait no longer than this; whether it ended."""
    thread = threading.Thread(target=stop, name=f"kalscope-end-{name}", daemon=True)
    thread.start()
    thread.join(seconds)
    if thread.is_alive():
        logging.getLogger(__name__).info("the %s did not end within %g s and is cut off", name, seconds)
    return not thread.is_alive()


def first_state(
    source: str, options: ReadOptions, config: Path | None, sample_period: float | None = None
) -> State:
    """What the dashboard shows first: the source, with the values of the tuning file if there is one."""
    from kalscope.catalogue import open_source
    from kalscope.errors import BadSetting
    from kalscope.sources.live.live_source import LiveSource
    from kalscope.sources.port.port_spec import is_live
    from kalscope.tuning.tuning import load_tuning
    from kalscope_app.session.live import opened_live
    from kalscope_app.session.opening import opened, opened_experiment, opened_with

    if is_live(source):
        live = LiveSource(source, options)
        state = opened_live(live, live.spec.url, tuning=None if config is None else load_tuning(config))
        return state.with_open(options=options)
    if source.startswith("experiment:") and config is None:
        return opened_experiment(source)
    if config is None:
        state = opened(open_source(source or "demo", options, sample_period=sample_period))
        return state.with_open(options=options, typed_period=sample_period)
    tuning = load_tuning(config)
    spec = source or tuning.source
    if not spec:
        raise BadSetting(
            f"SOURCE must be named, because {config} was made on an uploaded file (got only --config): "
            f"kalscope open {tuning.source_name or 'FILE'} --config {config}"
        )
    state = opened_with(open_source(spec, options, sample_period=sample_period), tuning)
    return state.with_open(options=options, typed_period=sample_period or state.open.typed_period)


@contextlib.contextmanager
def asked_to_end() -> Iterator[threading.Event]:
    """An event that is set by Ctrl+C, SIGTERM or the closing of the terminal, while the block runs."""
    end = threading.Event()
    before = {}
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):  # SIGHUP is unknown on Windows
            number = getattr(signal, name)
            before[number] = signal.signal(number, lambda *_: end.set())
    try:
        yield end
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def own_temporary_folder() -> Iterator[None]:
    """One folder for all temporary files, removed at the end: also those of a job that the end cut short."""
    before = tempfile.tempdir
    with tempfile.TemporaryDirectory(prefix="kalscope-", ignore_cleanup_errors=True) as folder:
        tempfile.tempdir = folder
        try:
            yield
        finally:
            tempfile.tempdir = before


def main() -> None:
    """Entry point: without a command the dashboard opens on the demo recording."""
    arguments = sys.argv[1:]
    leave(run(arguments or ["open", "demo"]))


def leave(status: int) -> None:
    """End the program, also while something hangs that nothing can interrupt (a device, a file on a network)."""
    if threading.active_count() > 1:
        with contextlib.suppress(OSError):  # the terminal is gone
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


if __name__ == "__main__":
    main()
