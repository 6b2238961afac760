"""What every command reads and writes: all options about reading, and no file of the user overwritten."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from kalscope.cli.app import run
from kalscope.papers import reproduction
from kalscope.tuning.file import save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.main import add_dashboard

add_dashboard()

WRONG = [
    ("--delimiter=x", "delimiter must be one of"),
    ("--decimal=x", 'decimal must be "." or ","'),
    ("--header-row=x", "header_row must be a line number from 1, or 0 for none (got 'x')"),
    ("--unit-row=-1", "unit_row must be a line number from 1, or 0 for none (got -1)"),
    ("--time-unit=weeks", "time_unit must be one of"),
    ("--rate=0", "rate must be a number of Hz above 0"),
    ("--rate=250 kHz", "rate must be a number of Hz above 0 (got '250 kHz')"),
    ("--gaps=holes", "gaps must be rows, missing or dt"),
]


COMMANDS = "filter demo; tune demo; open demo; report demo --config t -o p; export t --to c --vectors demo"


@pytest.mark.parametrize("command", COMMANDS.split("; "))
def test_every_command_refuses_the_same_wrong_options(capsys, command):
    for option, says in WRONG:
        assert run([*command.split(), option]) == 2
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        assert says in err


FILTER = "filter demo --q 1 --r 9 -o out.csv", "out.csv"
REPORT = "report demo --config tuning.toml -o page.html", "page.html"
EXPORT = "export tuning.toml --to c -o .", "kalscope_filter.h"
REPRODUCE = "reproduce --json -o .", "results.json"
TUNE = "tune demo --lag-ms 50 -o saved.toml", "saved.toml"
RECORD = "record socket://127.0.0.1:9 --no-reconnect -o run.csv", "run.csv"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with a tuning."""
    monkeypatch.chdir(tmp_path)
    done = SimpleNamespace(json="{}" * 99, html="<p>" * 99, failed=[])
    monkeypatch.setattr(reproduction, "reproduce", lambda *_, **__: done)
    save_tuning(Tuning((ChannelTuning("flex", "", 1.0, 9.0),), sample_period=0.02), "tuning.toml")
    return tmp_path


def contents(folder):
    return {path.name: path.is_dir() or path.read_bytes() for path in folder.iterdir()}


def refused(command, name, folder, capsys):
    """The command is refused in one line with the name of the file, and nothing in the folder changes."""
    before = contents(folder)
    assert run(command.split()) == 2
    err = capsys.readouterr().err
    assert name in err
    assert err.count("\n") == 1 + err.count("note: ")
    assert contents(folder) == before


@pytest.mark.slow
@pytest.mark.parametrize(("command", "name"), [FILTER, REPORT, EXPORT, REPRODUCE, TUNE, RECORD])
def test_what_exists_stays_as_it_is(folder, capsys, command, name):
    path = folder / name
    (folder / "mine").write_text("mine")
    for make in (path.mkdir, lambda: path.symlink_to("mine"), lambda: path.write_text("mine")):
        make()
        refused(command, name, folder, capsys)
        (path.rmdir if path.is_dir() else path.unlink)()
    path.write_text("mine")
    path.chmod(0o400)
    refused(command, name, folder, capsys)


@pytest.mark.slow
@pytest.mark.parametrize(("command", "name"), [FILTER, REPORT, EXPORT, REPRODUCE])
def test_force_overwrites(folder, command, name):
    (folder / name).write_text("mine")
    assert run([*command.split(), "--force"]) == 0
    assert (folder / name).read_text() != "mine"


@pytest.mark.slow
@pytest.mark.parametrize(("command", "name"), [FILTER, REPORT, EXPORT, REPRODUCE, TUNE])
def test_a_full_disk_leaves_no_part_of_a_file_and_the_old_one_whole(folder, capsys, command, name):
    """No file may have more than 10 bytes."""
    resource = pytest.importorskip("resource")
    if name != "saved.toml":
        (folder / name).write_text("mine")
        command += " --force"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    try:
        refused(command, name, folder, capsys)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
