"""The headless commands. `run` is the whole program; the dashboard adds its own command to `app`.

What a command needs is imported when it runs, so that --help and a mistyped option answer at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any

import typer

from kalscope.cli.bench.command import bench_command
from kalscope.cli.board.demo_board import demo_board_command
from kalscope.cli.board.ports import ports_command
from kalscope.cli.board.record import record_command
from kalscope.cli.console import INTERRUPTED, USER_ERROR, say, user_message
from kalscope.cli.export import export_command
from kalscope.cli.filter import filter_command
from kalscope.cli.report import report_command
from kalscope.cli.reproduce import reproduce_command
from kalscope.cli.tune.command import tune_command

COMMANDS: dict[str, Callable[..., Any]] = {
    "tune": tune_command,
    "filter": filter_command,
    "export": export_command,
    "reproduce": reproduce_command,
    "record": record_command,
    "ports": ports_command,
    "demo-board": demo_board_command,
    "report": report_command,
    "bench": bench_command,
}
"""The commands in the order of --help."""

app = typer.Typer(
    name="kalscope",
    help="Kalscope, an oscilloscope for the scalar Kalman noise filter.",
    add_completion=False,
    rich_markup_mode=None,  # plain help: importing rich takes longer than all the rest
    pretty_exceptions_enable=False,
)
for name, command in COMMANDS.items():
    app.command(name)(command)


def run(argv: Sequence[str] | None = None) -> int:
    """Run the program and give its exit status; `argv` without the program's name, None = sys.argv.

    Every mistake of the user ends with status 2 and one line on stderr that begins with "kalscope: ".
    """
    try:
        status = app(args=None if argv is None else list(argv), prog_name="kalscope", standalone_mode=False)
    except typer.Abort:
        return INTERRUPTED
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
