"""What every command writes: no file of the user is overwritten unasked, and none is written in part."""

from __future__ import annotations

import os
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from kalscope.cli.app import run
from kalscope.papers import reproduction

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
