"""The program `kalscope`: the headless commands, and `open`, which starts and stops the dashboard."""

from __future__ import annotations

import signal
import sys
import threading
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli import app, run
from kalscope.sources.command_options import Delimiter, GapsChoice, Missing, TimeColumnChoice, TimeUnit
from kalscope.sources.read_options import ReadOptions, options_from_text
from kalscope_app.open_options import P0, X0, Channel, Gate, Q, R

if TYPE_CHECKING:
    from kalscope_app.state import State


@app.command("open")
def open_dashboard(
    source: Annotated[
        str, typer.Argument(help='A file, "demo", "sample:NAME", "experiment:NAME" or "synthetic:SHAPE?sigma=1".')
    ] = "",
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on; 0 for any free one.")] = 8080,
    browser: Annotated[bool, typer.Option(help="Open the link in the browser.")] = True,
    allow_host: Annotated[
        list[str] | None, typer.Option(help="Name by which a browser may call this machine, for --host 0.0.0.0.")
    ] = None,
    sample_period: Annotated[
        float | None, typer.Option(help="Time between two samples in s, for a file that has no time.")
    ] = None,
    delimiter: Delimiter = None,
    time_column: TimeColumnChoice = None,
    time_unit: TimeUnit = None,
    missing: Missing = None,
    gaps: GapsChoice = None,
    config: Annotated[Path | None, typer.Option(help="Tuning file to start from.")] = None,
    channel: Channel = None,
    q: Q = None,
    r: R = None,
    p0: P0 = None,
    x0: X0 = None,
    gate: Gate = None,
) -> None:
    """Open the dashboard in a browser."""
    from kalscope_app.dashboard import Dashboard
    from kalscope_app.guard import guarded_server
    from kalscope_app.share import apply_options

    options = options_from_text(delimiter, time_column, time_unit, missing or (), gaps)
    state = apply_options(first_state(source, options, config, sample_period), channel, q, r, p0, x0, gate)
    dashboard: Dashboard | None = None

    def on_refused(why: str) -> None:
        if dashboard is not None:
            dashboard.tell(why)

    with guarded_server(
        host, port, allow_hosts=allow_host or (), on_refused=on_refused, label="Kalscope"
    ) as guarded:
        end = asked_to_end()
        dashboard = Dashboard(guarded.server, state, Path.cwd())
        dashboard.start()
        print(f"Kalscope: {guarded.url}", flush=True)
        if browser:
            webbrowser.open(guarded.url)
        try:
            while not end.wait(timeout=0.5):  # Windows wakes for Ctrl+C only between two waits
                pass
        finally:
            dashboard.stop()


def first_state(
    source: str, options: ReadOptions, config: Path | None, sample_period: float | None = None
) -> State:
    """What the dashboard shows first: the source, with the values of the tuning file if there is one."""
    from dataclasses import replace

    from kalscope.errors import BadSetting
    from kalscope.sources import open_source
    from kalscope.tuning import load_tuning
    from kalscope_app.state import opened, opened_experiment, opened_with

    if source.startswith("experiment:") and config is None:
        return opened_experiment(source)
    if config is None:
        state = opened(open_source(source or "demo", options, sample_period=sample_period))
        return replace(state, options=options, typed_period=sample_period)
    tuning = load_tuning(config)
    spec = source or tuning.source
    if not spec:
        raise BadSetting(
            f"SOURCE must be named, because {config} was made on an uploaded file (got only --config): "
            f"kalscope open {tuning.source_name or 'FILE'} --config {config}"
        )
    state = opened_with(open_source(spec, options, sample_period=sample_period), tuning)
    return replace(state, options=options, typed_period=sample_period or state.typed_period)


def asked_to_end() -> threading.Event:
    """An event that is set by Ctrl+C, SIGTERM or the closing of the terminal."""
    end = threading.Event()
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):  # SIGHUP is unknown on Windows
            signal.signal(getattr(signal, name), lambda *_: end.set())
    return end


def main() -> None:
    """Entry point: without a command the dashboard opens on the demo recording."""
    arguments = sys.argv[1:]
    sys.exit(run(arguments or ["open", "demo"]))


if __name__ == "__main__":
    main()
