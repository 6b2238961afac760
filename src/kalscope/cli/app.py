"""The headless commands. `run` is the whole program; the dashboard offers its own command too.

What a command needs is imported when it runs, so that --help and a mistyped option respond at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from kalscope.cli.console import USER_ERROR, say, user_message, writes_stdout
from kalscope.cli.offers import Function, OfferedCommands, offers
from kalscope.common.stopping import INTERRUPTED


@offers("tune", "Find q and r for a recording, and say why.")
def _tune() -> Function:
    from kalscope.cli.tune.command import tune_command

    return tune_command


@offers("fleet", "Tune many recordings, on all cores or a Dask cluster.")
def _fleet() -> Function:
    from kalscope.cli.tune.fleet import fleet_command

    return fleet_command


@offers("filter", "Filter a recording, or lines on stdin.")
def _filter() -> Function:
    from kalscope.cli.filter.command import filter_command

    return filter_command


@offers("export", "Write a tuned filter as code for a device or a program.")
def _export() -> Function:
    from kalscope.cli.export import export_command

    return export_command


@offers("reproduce", "Reproduce the results of the three source documents.")
def _reproduce() -> Function:
    from kalscope.cli.reproduce import reproduce_command

    return reproduce_command


@offers("record", "Record what a board sends, without the dashboard.")
def _record() -> Function:
    from kalscope.cli.board.record import record_command

    return record_command


@offers("ports", "List the serial ports: device, description, serial number.")
def _ports() -> Function:
    from kalscope.cli.board.ports import ports_command

    return ports_command


@offers("calibrate", "Let a board measure its own noise r.")
def _calibrate() -> Function:
    from kalscope.cli.board.calibrate import calibrate_command

    return calibrate_command


@offers("demo-board", "Send a recording over a port, as a board would.")
def _demo_board() -> Function:
    from kalscope.cli.board.demo_board import demo_board_command

    return demo_board_command


@offers("report", "Write a one-page report of a tuned recording.")
def _report() -> Function:
    from kalscope.cli.report import report_command

    return report_command


app = typer.Typer(
    name="kalscope",
    cls=OfferedCommands,
    help="Kalscope, an oscilloscope for the scalar Kalman noise filter.\n\n"
    "Without a command it opens the dashboard on the demo recording.",
    add_completion=False,
    rich_markup_mode=None,  # plain help: importing rich takes longer than all the rest
    pretty_exceptions_enable=False,
)


def run(argv: Sequence[str] | None = None) -> int:
    """Run the program and give its exit status; `argv` without the program's name, None = sys.argv.

    Every user error ends with status 2 and one line on stderr that begins with "kalscope: ".
    """
    try:
        status = app(args=None if argv is None else list(argv), prog_name="kalscope", standalone_mode=False)
        with writes_stdout():
            pass  # whatever was printed
    except typer.Abort:
        return INTERRUPTED
    except typer.Exit as end:
        return end.exit_code
    except Exception as error:
        message = user_message(error)
        if message is None:
            raise  # a bug: its traceback is needed
        say(message)
        return USER_ERROR
    return status if isinstance(status, int) else 0


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version as installed

        print(f"kalscope {installed('kalscope')}")
        raise typer.Exit


@app.callback()
def program(
    version: Annotated[  # acts in its callback, before a missing command is noticed
        bool,
        typer.Option("--version", help="Show the version and exit.", is_eager=True, callback=_print_version),
    ] = False,
) -> None:
    """Take the options of the program itself."""
