"""Every command that reads a file takes every option about reading it, and they reach the reader."""

import inspect
from pathlib import Path

import pytest
from typer import Typer
from typer.testing import CliRunner

from kalscope.cli.app import app, run
from kalscope.cli.options import read_options, reads_source
from kalscope.sources.grammar.read_options import DEFAULTS, OPTIONS, ReadOptions, option_words, options_from_text
from kalscope_app.main import add_dashboard

add_dashboard()

WRONG = [
    ("--delimiter", "x", "delimiter must be one of"),
    ("--decimal", "x", 'decimal must be "." or ","'),
    ("--header-row", "x", "header_row must be a line number from 1, or 0 for none (got 'x')"),
    ("--unit-row", "-1", "unit_row must be a line number from 1, or 0 for none (got -1)"),
    ("--time-unit", "weeks", "time_unit must be one of"),
    ("--rate", "0", "rate must be a number of Hz above 0"),
    ("--rate", "250 kHz", "rate must be a number of Hz above 0 (got '250 kHz')"),
    ("--gaps", "holes", "gaps must be rows, missing or dt"),
]


@pytest.fixture
def files(tmp_path):
    (tmp_path / "a.csv").write_text("t,a\n" + "".join(f"{i},{i % 3}\n" for i in range(40)))
    (tmp_path / "t.toml").write_text('kalscope = 1\n[[channel]]\nname = "a"\nq = 1.0\nr = 2.0\n')
    return tmp_path


@pytest.mark.parametrize(("option", "value", "said"), WRONG)
@pytest.mark.parametrize("command", ["filter", "tune", "report", "export", "open"])
def test_every_command_refuses_the_same_wrong_options(files, capsys, command, option, value, said):
    source, config, page = (str(files / name) for name in ("a.csv", "t.toml", "page.html"))
    words = {
        "report": [source, "--config", config, "-o", page],
        "export": [config, "--to", "c", "--vectors", source, "-o", str(files / "out")],
    }.get(command, [source])
    assert run([command, *words, f"{option}={value}"]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert said in err


def test_options_about_reading_without_a_file_to_read_are_refused(files, capsys):
    assert run(["export", str(files / "t.toml"), "--to", "c", "--decimal", "comma"]) == 2
    assert "--vectors" in capsys.readouterr().err


def test_every_field_of_the_options_can_be_given_and_has_a_line_of_help():
    fields = set(inspect.signature(ReadOptions).parameters)
    assert fields - {"header"} == set(inspect.signature(read_options).parameters)  # header: `--header-row 0`
    shown = CliRunner().invoke(app, ["filter", "--help"]).output
    assert {f"--{name.replace('_', '-')}" for name in fields - {"header"}} | {"--month-first"} == set(OPTIONS)
    assert [option for option in OPTIONS if option not in shown] == []


EXAMPLES = [
    {},
    {"delimiter": "tab", "decimal": "comma", "time_column": "3", "time_unit": "millis"},
    {"time_column": "none", "header_row": "0", "unit_row": "2", "rate": "250 Hz"},
    {"time_format": "%d.%m.%Y %H:%M", "day_first": True, "missing": ("-200", "n/x", "-"), "gaps": "dt"},
    {"time_column": "-t", "day_first": False, "part": "/imu/data", "rate": "0.1"},
]


@pytest.mark.parametrize("given", EXAMPLES)
def test_options_written_as_words_are_read_back_the_same(given):
    options = options_from_text(**given)
    seen = []
    program = Typer()

    @program.command()
    @reads_source
    def command(reading: ReadOptions = DEFAULTS) -> None:
        seen.append(reading)

    assert CliRunner().invoke(program, list(option_words(options))).exit_code == 0
    assert seen == [options]


def test_the_page_on_reading_names_every_option_and_command():
    page = (Path(__file__).parents[2] / "docs" / "files.md").read_text("utf-8")
    assert [option for option in OPTIONS if f"`{option}" not in page] == []
