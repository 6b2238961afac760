"""The headless commands, each imported when it runs: --help and a mistyped option do not wait for what it needs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from kalscope.cli.console import USER_ERROR, say, user_message, writes_stdout
from kalscope.common.stopping import INTERRUPTED

# Commands that are imported when they run: --help and a mistyped option do not wait for what the others import.


Function = Callable[..., Any]
"""A command: its options are its arguments."""


@dataclass(frozen=True)
class Offer:
    """A command that can be asked for."""

    help: str
    """What it does: the first sentence of its own help."""
    load: Callable[[], Function]
    """Imports and returns it."""


OFFERS: dict[str, Offer] = {}
"""By name, in the order of --help."""


def offers(name: str, text: str) -> Callable[[Callable[[], Function]], Callable[[], Function]]:
    """Offer the command that a function imports and returns.

    Args:
        name: what the user types.
        text: what the command does, as its own help begins.
    """

    def decorate(load: Callable[[], Function]) -> Callable[[], Function]:
        OFFERS[name] = Offer(text, load)
        return load

    return decorate


class _Loaded(Mapping[str, Any]):
    """The commands as typer knows them, each made when it is looked up."""

    def __getitem__(self, name: str) -> Any:
        only = typer.Typer(add_completion=False, rich_markup_mode=None)
        only.command(name)(OFFERS[name].load())
        return get_command(only)

    def __iter__(self) -> Iterator[str]:
        return iter(OFFERS)

    def __len__(self) -> int:
        return len(OFFERS)


class OfferedCommands(TyperGroup):
    """The program: its commands are those of OFFERS."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        commands: Any = _Loaded()
        self.commands = commands

    def list_commands(self, ctx: Any) -> list[str]:
        """Their names."""
        del ctx
        return list(OFFERS)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of --help, as typer does for commands that are there."""
        del ctx
        width = formatter.width - 6 - max(map(len, OFFERS))
        with formatter.section("Commands"):
            texts = {name: TyperCommand(name, help=offer.help) for name, offer in OFFERS.items()}
            formatter.write_dl([(name, one.get_short_help_str(width)) for name, one in texts.items()])


# The headless commands. `run` is the whole program; the dashboard offers its own command too.
#
# What a command needs is imported when it runs, so that --help and a mistyped option respond at once.


@offers("tune", "Find q and r for a recording, and say why.")
def _tune() -> Function:
    from kalscope.cli.tune import tune_command

    return tune_command


@offers("fleet", "Tune many recordings, on all cores or a Dask cluster.")
def _fleet() -> Function:
    from kalscope.cli.fleet import fleet_command

    return fleet_command


@offers("filter", "Filter a recording, or lines on stdin.")
def _filter() -> Function:
    from kalscope.cli.filter import filter_command

    return filter_command


@offers("export", "Write a tuned filter as code for a device or a program.")
def _export() -> Function:
    from kalscope.cli.export import export_command

    return export_command


@offers("reproduce", "Reproduce the results of the three source documents.")
def _reproduce() -> Function:
    from kalscope.cli.report import reproduce_command

    return reproduce_command


@offers("record", "Record what a board sends, without the dashboard.")
def _record() -> Function:
    from kalscope.cli.board import record_command

    return record_command


@offers("ports", "List the serial ports: device, description, serial number.")
def _ports() -> Function:
    from kalscope.cli.board import ports_command

    return ports_command


@offers("calibrate", "Let a board measure its own noise r.")
def _calibrate() -> Function:
    from kalscope.cli.board import calibrate_command

    return calibrate_command


@offers("demo-board", "Send a recording over a port, as a board would.")
def _demo_board() -> Function:
    from kalscope.cli.board import demo_board_command

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
