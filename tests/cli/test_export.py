"""`kalscope export`: what it writes, prints and refuses; and that a kill leaves no broken file."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time

import pytest
from tests.support.waiting import wait_until

from kalscope import BadSetting, ChannelTuning, Tuning, export_tuning, load_tuning, save_tuning
from kalscope.cli import app as cli
from kalscope.export.registry import TARGETS, write_files


@pytest.fixture
def tuning_file(tmp_path):
    channels = (ChannelTuning("raw", "V", 0.01, 0.25), ChannelTuning("../x", "V", 1.0, 2.0, 3.0, gate=9.0))
    path = tmp_path / "tuning.toml"
    save_tuning(Tuning(channels, sample_period=0.01), path)
    return path


def contents(folder):
    return {path.name: path.read_text() for path in sorted(folder.iterdir())}


def test_it_writes_what_export_tuning_says_and_lists_it(tuning_file, tmp_path, capfd):
    out = tmp_path / "a" / "new folder"
    assert cli.run(["export", str(tuning_file), "--to", "python", "-o", str(out)]) == 0
    expected = export_tuning(load_tuning(tuning_file), "python")
    assert contents(out) == expected
    assert capfd.readouterr().out.splitlines() == [str(out / name) for name in expected]


def test_without_a_folder_the_main_file_goes_to_stdout(tuning_file, capfd):
    assert cli.run(["export", str(tuning_file), "--to", "json"]) == 0
    shown = capfd.readouterr()
    assert shown.out == export_tuning(load_tuning(tuning_file), "json")["kalscope_parameters.json"]
    assert shown.err == ""
    assert cli.run(["export", str(tuning_file), "--to", "c"]) == 0
    shown = capfd.readouterr()
    assert shown.out == export_tuning(load_tuning(tuning_file), "c")["kalscope_filter.h"]
    assert shown.err == "kalscope: note: kalscope_filter.h; with -o DIR also kalscope_filter.c\n"


def test_a_fusion_is_exported_and_said_unless_a_channel_is_named(tmp_path, capfd):
    path, fusion = tmp_path / "tuning.toml", ChannelTuning("level", "cm", 0.01, (4.0, 9.0), sensors=("a", "b"))
    channels = (ChannelTuning("a", "cm", 0.01, 0.25), ChannelTuning("b", "cm", 0.02, 0.25))
    save_tuning(Tuning(channels, sample_period=0.01, fusion=fusion), path)
    tuning = load_tuning(path)
    assert cli.run(["export", str(path), "--to", "json", "--sample-period", "0.02"]) == 0
    shown = capfd.readouterr()
    assert shown.out == export_tuning(tuning, "json", sample_period=0.02)["kalscope_parameters.json"]
    assert "note: this is the filter that fuses a, b; --channel NAME exports that of one channel" in shown.err
    assert cli.run(["export", str(path), "--to", "json", "--channel", "b"]) == 0
    shown = capfd.readouterr()
    assert (shown.out, shown.err) == (export_tuning(tuning, "json", channel="b")["kalscope_parameters.json"], "")
    out = tmp_path / "elsewhere"
    assert cli.run(["export", str(path), "--to", "arduino", "-o", str(out)]) == 0
    assert "opens a sketch only from a folder of its name, as with -o" in capfd.readouterr().err
    assert sorted(contents(out)) == ["KalscopeFusion.h", "kalscope_fusion.ino"]


def test_q_is_carried_over_to_the_period_of_the_device(tuning_file, capfd):
    command = ["export", str(tuning_file), "--to", "json", "--sample-period"]
    assert cli.run([*command, "0.04"]) == 0
    document = json.loads(capfd.readouterr().out)
    assert document["sample_period_s"] == 0.04
    assert [channel["process_noise_q"] for channel in document["channels"]] == [0.04, 4.0]
    assert [channel["measurement_noise_r"] for channel in document["channels"]] == [0.25, 2.0]
    assert document["channels"][0]["found"] == "at 0.01 s: by hand; q times 4"
    assert cli.run([*command, "0.01"]) == 0
    assert capfd.readouterr().out == export_tuning(load_tuning(tuning_file), "json")["kalscope_parameters.json"]
    assert cli.run([*command, "0"]) == 2
    assert capfd.readouterr().err == "kalscope: --sample-period must be a number above 0 (got '0')\n"


def test_a_channel_left_out_is_neither_rescaled_nor_refused(tmp_path, capfd):
    """The momentum of a slow one becomes too long for the device."""
    path = tmp_path / "tuning.toml"
    slow, fast = ChannelTuning("slow", "", 1e-3, 1.0, momentum=9e4), ChannelTuning("fast", "", 0.5, 1.0)
    save_tuning(Tuning((slow, fast), sample_period=1.0), path)
    command = ["export", str(path), "--to", "json", "--sample-period", "0.01"]
    assert cli.run(command) == 2
    assert "slow cannot be filtered alike every 10 ms: momentum must" in capfd.readouterr().err
    assert cli.run([*command, "--channel", "fast"]) == 0
    assert json.loads(capfd.readouterr().out)["channels"][0]["process_noise_q"] == 0.005
    assert export_tuning(load_tuning(path), "c", channel="fast", sample_period=0.01)


def test_vectors_of_a_recording_come_along_and_another_sample_period_is_said(tuning_file, tmp_path, capfd):
    recording = tmp_path / "r.csv"
    recording.write_text("time,raw\n" + "".join(f"{i / 10},{i % 7}\n" for i in range(50)))
    out = tmp_path / "out"
    command = ["export", str(tuning_file), "--to", "json", "-o", str(out), "--channel", "raw"]
    assert cli.run([*command, "--vectors", str(recording)]) == 0
    assert "their rows are 0.1 s apart, the tuning is for 0.01 s" in capfd.readouterr().err
    rows = (out / "groundtruth.csv").read_text().splitlines()
    assert rows[:2] == ["time,raw,filtered,gain", "0.0,0.0,0.0,1.0"]
    assert len(rows) == 51


def test_a_sketch_beside_its_folder_is_said(tmp_path, capfd):
    path = tmp_path / "tuning.toml"
    save_tuning(Tuning((ChannelTuning("raw", "", 0.01, 0.25),)), path)
    for folder, notes in (("firmware", 1), ("kalscope_filter", 0)):
        out = tmp_path / folder
        assert cli.run(["export", str(path), "--to", "arduino", "-o", str(out)]) == 0
        assert sorted(contents(out)) == ["KalscopeFilter.h", "kalscope_filter.ino"]
        assert capfd.readouterr().err.count("opens a sketch only from a folder of its name") == notes


def test_where_one_file_cannot_be_written_none_is(tmp_path):
    (tmp_path / "a.txt").write_text("mine")
    (tmp_path / "c.txt").mkdir()
    files = {"a.txt": "new", "sub/b.txt": "new", "c.txt": "new"}
    with pytest.raises(OSError, match=r"c\.txt"):
        write_files(files, tmp_path, force=True)
    assert (tmp_path / "a.txt").read_text() == "mine"
    assert not any((tmp_path / "sub").iterdir())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "c.txt", "sub"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--to", "cobol"], "target must be one of arduino, c,"),
        (["--to", "json", "--channel", "unknown"], "channel must be one of raw, ../x"),
        (["--to", "json", "--vectors", "demo"], "--vectors needs -o"),
        ([], "Missing option"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(tuning_file, capfd, arguments, said, monkeypatch):
    monkeypatch.chdir(tuning_file.parent)
    assert cli.run(["export", str(tuning_file), *arguments]) == 2
    shown = capfd.readouterr()
    assert said in shown.err
    assert shown.err.count("\n") == 1
    assert shown.out == ""
    assert not (tuning_file.parent / "out").exists()


def test_the_list_explains_every_target(capfd):
    assert cli.run(["export", "--to", "list"]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(TARGETS)
    assert lines[0].endswith(TARGETS["arduino"].what)


def test_no_name_leaves_the_folder(tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    for name in ("../x", "/tmp/x", "a/../../x"):
        with pytest.raises(BadSetting, match="inside the working folder"):
            write_files({"good.txt": "a", name: "b"}, folder)
    (folder / "link.txt").symlink_to(tmp_path / "elsewhere.txt")
    with pytest.raises(BadSetting, match="inside the working folder"):
        write_files({"link.txt": "a"}, folder, force=True)
    assert [path.name for path in folder.iterdir()] == ["link.txt"]
    assert not (tmp_path / "elsewhere.txt").exists()


ENDLESS = """\
import sys
from pathlib import Path
from kalscope.export.registry import write_files
files = [{f"{i}.txt": f"{turn} " * 200_000 for i in range(3)} for turn in ("old", "new")]
print("ready", flush=True)
while True:
    for texts in files:
        write_files(texts, Path(sys.argv[1]), force=True)
"""


@pytest.mark.skipif(os.name == "nt", reason="there is no kill -9")
def test_a_kill_leaves_whole_files(tmp_path):
    whole = {"old " * 200_000, "new " * 200_000}
    rng = random.Random(5)
    for turn in range(4):
        command = [sys.executable, "-c", ENDLESS, str(tmp_path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout.readline() == "ready\n"
            if turn == 3:
                wait_until(lambda: len([*tmp_path.glob("[012].txt")]) == 3, "all three files")
            time.sleep(0.02 + rng.random() * 0.1)
            child.send_signal(signal.SIGKILL)
        for path in tmp_path.glob("*.txt"):
            if not path.name.startswith("."):
                assert path.read_text() in whole
    assert {path.name for path in tmp_path.glob("*.txt")} == {"0.txt", "1.txt", "2.txt"}
