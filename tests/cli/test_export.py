"""`kalscope export`: what it writes, prints and refuses; and that a kill leaves no broken file."""

from __future__ import annotations

import json

import pytest

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


def test_it_writes_what_export_tuning_makes_or_prints_the_main_file(tuning_file, tmp_path, capfd):
    tuning, out = load_tuning(tuning_file), tmp_path / "a" / "new folder"
    files = export_tuning(tuning, "c")
    assert exported(capfd, tuning_file, "c", "-o", str(out)) == ("".join(f"{out / name}\n" for name in files), "")
    assert contents(out) == files
    note = "kalscope: note: kalscope_filter.h; with -o DIR also kalscope_filter.c\n"
    assert exported(capfd, tuning_file, "c") == (files["kalscope_filter.h"], note)
    assert exported(capfd, tuning_file, "json") == (export_tuning(tuning, "json")["kalscope_parameters.json"], "")


def exported(capfd, path, target, *options):
    """What the command prints and says."""
    assert cli.run(["export", str(path), "--to", target, *options]) == 0
    return tuple(capfd.readouterr())


def test_a_fusion_is_exported_and_named_unless_a_channel_is_chosen(tmp_path, capfd):
    path, fusion = tmp_path / "tuning.toml", ChannelTuning("level", "cm", 0.01, (4.0, 9.0), sensors=("a", "b"))
    channels = (ChannelTuning("a", "cm", 0.01, 0.25), ChannelTuning("b", "cm", 0.02, 0.25))
    save_tuning(Tuning(channels, sample_period=0.01, fusion=fusion), path)
    tuning = load_tuning(path)
    out, err = exported(capfd, path, "json", "--sample-period", "0.02")
    assert out == export_tuning(tuning, "json", sample_period=0.02)["kalscope_parameters.json"]
    assert "note: this is the filter that fuses a, b; --channel NAME exports that of one channel" in err
    one = export_tuning(tuning, "json", channel="b")["kalscope_parameters.json"]
    assert exported(capfd, path, "json", "--channel", "b") == (one, "")
    _, err = exported(capfd, path, "arduino", "-o", str(tmp_path / "elsewhere"))
    assert "opens a sketch only from a folder of its name, as with -o" in err
    assert sorted(contents(tmp_path / "elsewhere")) == ["KalscopeFusion.h", "kalscope_fusion.ino"]


def test_q_is_carried_over_to_the_period_of_the_device(tuning_file, tmp_path, capfd):
    document = json.loads(exported(capfd, tuning_file, "json", "--sample-period", "0.04")[0])
    assert document["sample_period_s"] == 0.04
    assert [channel["process_noise_q"] for channel in document["channels"]] == [0.04, 4.0]
    assert [channel["measurement_noise_r"] for channel in document["channels"]] == [0.25, 2.0]
    assert document["channels"][0]["found"] == "at 0.01 s: by hand; q times 4"
    same = export_tuning(load_tuning(tuning_file), "json")["kalscope_parameters.json"]
    assert exported(capfd, tuning_file, "json", "--sample-period", "0.01") == (same, "")
    path, options = tmp_path / "slow.toml", ("--sample-period", "0.01")  # of which the momentum becomes too long
    slow, fast = ChannelTuning("slow", "", 1e-3, 1.0, momentum=9e4), ChannelTuning("fast", "", 0.5, 1.0)
    save_tuning(Tuning((slow, fast), sample_period=1.0), path)
    assert cli.run(["export", str(path), "--to", "json", *options]) == 2
    assert "slow cannot be filtered alike every 10 ms: momentum must" in capfd.readouterr().err
    document = json.loads(exported(capfd, path, "json", *options, "--channel", "fast")[0])
    assert document["channels"][0]["process_noise_q"] == 0.005


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


def test_where_one_file_cannot_be_written_none_is(tmp_path):
    (tmp_path / "a.txt").write_text("mine")
    (tmp_path / "c.txt").mkdir()
    files = {"a.txt": "new", "sub/b.txt": "new", "c.txt": "new"}
    with pytest.raises(OSError, match=r"c\.txt"):
        write_files(files, tmp_path, force=True)
    assert (tmp_path / "a.txt").read_text() == "mine"
    assert not any((tmp_path / "sub").iterdir())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "c.txt", "sub"]


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
