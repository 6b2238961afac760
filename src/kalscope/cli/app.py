"""The headless commands, each imported when it runs: --help and a mistyped option do not wait for what it needs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from kalscope.cli.console import USER_ERROR, say, user_message, utf8_streams, writes_stdout
from kalscope.common.stopping import INTERRUPTED

COMMANDS = {
    "tune": ("Find q and r for a recording, and say why.", "kalscope.cli.tune:tune_command"),
    "fleet": ("Tune many recordings, on all cores or a Dask cluster.", "kalscope.cli.fleet:fleet_command"),
    "filter": ("Filter a recording, or lines on stdin.", "kalscope.cli.filter:filter_command"),
    "export": (
        "Write a tuned filter as code for a device or a program.",
        "kalscope.cli.export:export_command",
    ),
    "reproduce": (
        "Reproduce the results of the three source documents.",
        "kalscope.cli.report:reproduce_command",
    ),
    "record": ("Record what a board sends, without the dashboard.", "kalscope.cli.board:record_command"),
    "ports": (
        "List the serial ports: device, description, serial number.",
        "kalscope.cli.board:ports_command",
    ),
    "calibrate": ("Let a board measure its own noise r.", "kalscope.cli.board:calibrate_command"),
    "demo-board": ("Send a recording over a port, as a board would.", "kalscope.cli.demo_board:demo_board_command"),
    "report": ("Write a one-page report of a tuned recording.", "kalscope.cli.report:report_command"),
    "page": (
        "Write a page with the recording, its filter and sliders, which opens in any browser.",
        "kalscope.cli.report:page_command",
    ),
}
"""By name, in the order of --help: the first sentence of its own help, and its function, whose arguments are its
options. The dashboard adds its command."""


GROUPS = {
    "Goal": "lag_ms cutoff_hz noise_reduction_db gain overshoot ratio",
    "Noise": "still sigma density bandwidth_hz q r",
    "Filter": "config momentum two_speeds gate robust p0 x0 fast spikes chain notch fuse reference sensor_gains",
    "Reading": "channel every sample_period delimiter decimal header_row unit_row time_column time_unit time_format"
    " day_first rate missing gaps part unpack_gb follow",
    "Output": "output details as_json report force vectors",
}
"""The headings of --help, and the options below each; all others come last."""
HELP = {"help_option_names": ["-h", "--help"]}


def function_of(name: str) -> Callable[..., Any]:
    """Import the function of a command."""
    module, function = COMMANDS[name][1].split(":")
    return getattr(import_module(module), function)


class Command(TyperCommand):
    """A command whose --help lists its options by GROUPS, and names no types of Python."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the sections."""
        heading_of = {name: heading for heading, names in GROUPS.items() for name in names.split()}
        sections: dict[str, list[Any]] = {heading: [] for heading in ("Arguments", *GROUPS, "Options")}
        for param in self.get_params(ctx):
            is_option = param.param_type_name == "option"
            name, text = param.get_help_record(ctx) or ("", "")
            heading = heading_of.get(param.name or "", "Options") if is_option else "Arguments"
            sections[heading].append((name if is_option else param.metavar, text))
        for heading, rows in sections.items():
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)


def command(name: str) -> Any:
    """A command with its options, as typer makes it."""
    only = typer.Typer(add_completion=False, rich_markup_mode=None)
    only.command(name, cls=Command, context_settings=HELP)(function_of(name))
    return get_command(only)


class LazyCommands(TyperGroup):
    """The program: its commands are those of COMMANDS; the one that runs is imported."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.commands = {name: TyperCommand(name, help=text) for name, (text, _) in COMMANDS.items()}

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that was typed, and its arguments."""
        name, _, rest = super().resolve_command(ctx, args)
        return name, command(name or ""), rest


app = typer.Typer(
    name="kalscope",
    cls=LazyCommands,
    help="Kalscope, an oscilloscope for the scalar Kalman noise filter.\n\n"
    "Without a command it opens the dashboard on the demo recording.",
    add_completion=False,
    context_settings=HELP,
    rich_markup_mode=None,  # plain help: importing rich takes longer than all the rest
    pretty_exceptions_enable=False,
)


def run(argv: Sequence[str] | None = None) -> int:
    """Run the program and give its exit status; `argv` without the program's name, None = sys.argv.

    Every user error ends with status 2 and one line on stderr that begins with "kalscope: ".
    """
    utf8_streams()
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


def _print_version(wanted: bool) -> None:
    if wanted:
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
