"""What SOURCE names: every file below it once, and what is no file with its reason."""

from __future__ import annotations

import os

import pytest

from kalscope.errors import BadFile, BadSetting
from kalscope.fleet.read import find_units, read_list


@pytest.fixture
def tree(tmp_path):
    """Two files, one in a folder named as a file, an empty folder, a hidden file, a dead link and a pipe."""
    (tmp_path / "logs" / "x.csv").mkdir(parents=True)
    (tmp_path / "logs" / "none").mkdir()
    (tmp_path / "logs" / "a.csv").write_text("1\n2\n3\n")
    (tmp_path / "logs" / "x.csv" / "b.csv").write_text("1\n2\n3\n")
    (tmp_path / "logs" / ".DS_Store").write_text("")
    os.symlink(tmp_path / "nowhere", tmp_path / "logs" / "link.csv")
    os.mkfifo(tmp_path / "logs" / "pipe.csv")
    return tmp_path / "logs"


def found(*sources, output="out"):
    return {unit.id: unit for unit in find_units([str(one) for one in sources], output)}


def reasons(*sources):
    return {name: unit.reason for name, unit in found(*sources).items()}


def test_everything_in_a_folder_is_accounted_for(tree):
    assert reasons(tree) == {
        "a.csv": "",
        "link.csv": f"'{tree / 'link.csv'}' cannot be used: it or its folder does not exist",
        "none": "the folder is empty",
        "pipe.csv": "it must be a file (got a folder, a device or a pipe)",
        "x.csv/b.csv": "",
    }


def test_a_pattern_stands_for_the_files_and_folders_that_it_meets(tree):
    assert set(reasons(tree / "*.csv")) == {"a.csv", "link.csv", "pipe.csv", "x.csv/b.csv"}


@pytest.mark.parametrize("source", ["nowhere.csv", "nowhere/*.csv", "**", ""])
def test_a_source_that_names_nothing_is_refused(tmp_path, source):
    with pytest.raises(BadSetting, match=r"SOURCE must be a folder, a file, @LIST, or a pattern .*\(got "):
        find_units([str(tmp_path / source) if source else ""], tmp_path)


def test_a_list_names_files_each_once_and_one_that_is_gone_has_a_reason(tree):
    (tree.parent / "list.txt").write_text("# devices\nlogs/a.csv\nlogs/a.csv\n\nlogs/x.csv\nlogs/gone.csv\n")
    named = reasons(f"@{tree.parent / 'list.txt'}", tree / "x.csv" / "b.csv")
    assert set(named) == {"a.csv", "gone.csv", "x.csv/b.csv"}
    assert named["gone.csv"].endswith("it or its folder does not exist")


def test_only_the_end_of_a_line_ends_the_path_in_a_list(tree):
    names = ["form\ffeed.csv", "line\u2028separator.csv", "a, b.csv", "group\x1dmark.csv"]
    (tree / "list.txt").write_bytes("\r\n".join(names).encode() + b"\nlast.csv\n")
    assert read_list(str(tree / "list.txt")) == [str(tree / name) for name in (*names, "last.csv")]


@pytest.mark.parametrize("text", ["", "# nothing\n"])
def test_a_list_without_files_is_refused(tmp_path, text):
    (tmp_path / "list.txt").write_text(text)
    with pytest.raises(BadFile, match="must name at least one file"):
        read_list(str(tmp_path / "list.txt"))


def test_folders_and_patterns_leave_out_the_results_of_an_earlier_run(tmp_path):
    for name in ("logs/a.csv", "logs/out/fleet.json", "logs/out/parts/x.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1\n2\n3\n")
    for source in (tmp_path / "logs", tmp_path / "logs" / "*"):
        assert list(found(source, output=tmp_path / "logs" / "out")) == ["a.csv"]
        assert "out/fleet.json" in found(source)
