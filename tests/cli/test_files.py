"""What every command reads and writes: all options about reading, and no file of the user overwritten."""

from __future__ import annotations

import os
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
from typer import Typer
from typer.testing import CliRunner

from kalscope.cli.app import run
from kalscope.cli.options import reads_source
from kalscope.papers import reproduction
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions, option_words, options_from_text
from kalscope_app.main import add_dashboard

add_dashboard()

WRONG = [
    *(("--delimiter", "x", "delimiter must be one of"), ("--decimal", "x", 'decimal must be "." or ","')),
    ("--header-row", "x", "header_row must be a line number from 1, or 0 for none (got 'x')"),
    ("--unit-row", "-1", "unit_row must be a line number from 1, or 0 for none (got -1)"),
    *(("--time-unit", "weeks", "time_unit must be one of"), ("--rate", "0", "rate must be a number of Hz above 0")),
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


FILTER = "filter demo --q 1 --r 9 -o {}/out.csv", "out.csv"
REPORT = "report demo --config {}/tuning.toml -o {}/page.html", "page.html"
EXPORT = "export {}/tuning.toml --to c -o {}", "kalscope_filter.h"
REPRODUCE = "reproduce --json -o {}", "results.json"
TUNE = "tune demo -o {}/saved.toml", "saved.toml"
RECORD = "record socket://127.0.0.1:9 --no-reconnect -o {}/run.csv", "run.csv"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    done = SimpleNamespace(json="{}" * 99, html="<p>" * 99, failed=[])
    monkeypatch.setattr(reproduction, "reproduce", lambda *_, **__: done)
    assert run(["tune", "demo", "-o", str(tmp_path / "tuning.toml")]) == 0
    return tmp_path


def call(command, folder, *more):
    return run([*command.replace("{}", str(folder)).split(), *more])


def contents(folder):
    return {path.name: path.is_dir() or path.read_bytes() for path in folder.iterdir()}


@contextmanager
def small_files():
    """No file may have more than 10 bytes, as on a full disk."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize(("command", "name"), [FILTER, REPORT, EXPORT, REPRODUCE, TUNE, RECORD])
@pytest.mark.parametrize("kind", ["file", "read-only", "link", "folder"])
def test_what_exists_stays_as_it_is(folder, capsys, command, name, kind):
    (folder / "mine").write_text("mine")
    if kind == "folder":
        (folder / name).mkdir()
    elif kind == "link":
        (folder / name).symlink_to("mine")
    else:
        (folder / name).write_text("mine")
        (folder / name).chmod(0o400 if kind == "read-only" else 0o600)
    before = contents(folder)
    capsys.readouterr()
    assert call(command, folder) == 2
    err = capsys.readouterr().err
    assert name in err
    assert err.count("\n") == 1 + err.count("note: ")
    assert contents(folder) == before


@pytest.mark.parametrize(("command", "name"), [FILTER, REPORT, EXPORT, REPRODUCE])
def test_force_overwrites(folder, command, name):
    (folder / name).write_text("mine")
    assert call(command, folder, "--force") == 0
    assert (folder / name).read_text() != "mine"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such limit")
@pytest.mark.parametrize(("command", "name"), [FILTER, REPORT, EXPORT, REPRODUCE, TUNE])
def test_a_full_disk_leaves_no_part_of_a_file_and_the_old_one_whole(folder, capsys, command, name):
    force = [] if name == "saved.toml" else ["--force"]
    if force:
        (folder / name).write_text("mine")
    before = contents(folder)
    capsys.readouterr()
    with small_files():
        assert call(command, folder, *force) == 2
    err = capsys.readouterr().err
    assert name in err
    assert err.count("\n") == 1 + err.count("note: ")
    assert contents(folder) == before
