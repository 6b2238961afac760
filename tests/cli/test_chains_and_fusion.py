"""Chains and fused sensors on the command line: filtered, tuned, reported."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kalscope.catalogue import open_source
from kalscope.cli.app import run
from kalscope.estimation.fusion import estimate_fusion
from kalscope.filtering.classic import Chain, Exponential, OneEuro
from kalscope.filtering.filter import fuse
from kalscope.filtering.params import FilterParams
from kalscope.sources.reading.recording_file import read_recording
from kalscope.tuning.file import load_tuning, save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning

EURO = Chain(5, OneEuro(0.02, 0.7, 0.1))
CHANNELS = (
    ChannelTuning("a", "V", 0.01, 1.0, chain=EURO),
    ChannelTuning("b", "V", 0.02, 1.5, gate=9.0, chain=Chain(3)),
    ChannelTuning("c", "V", 0.02, 1.5),
)


@pytest.fixture
def files(tmp_path: Path) -> tuple[str, str]:
    """A recording of three channels and a tuning of them, two of which are chains."""
    rng = np.random.default_rng(5)
    z = np.cumsum(rng.normal(0.0, 0.1, (400, 3)), axis=0) + rng.normal(0.0, 1.0, (400, 3))
    z[100:110] += 30.0
    log, config = tmp_path / "log.csv", tmp_path / "t.toml"
    lines = (",".join(map(repr, [0.01 * i, *row.tolist()])) for i, row in enumerate(z))
    log.write_text("time,a,b,c\n" + "\n".join(lines) + "\n")
    recording = read_recording(log)
    save_tuning(Tuning(CHANNELS, sha256=recording.sha256, sample_period=recording.sample_period), config)
    return str(log), str(config)


@pytest.mark.slow
def test_a_recording_and_lines_go_through_the_chains_of_the_tuning(files, capsys, monkeypatch):
    recording = read_recording(Path(files[0]))
    expected = [one.filter.run(recording.channel(one.name)) for one in CHANNELS]
    assert run(["filter", files[0], "--config", files[1]]) == 0
    table = np.genfromtxt(io.StringIO(capsys.readouterr().out), delimiter=",", names=True)
    for one, whole in zip(CHANNELS, expected, strict=True):
        np.testing.assert_array_equal(table[f"{one.name}_filtered"], whole.x)
        np.testing.assert_array_equal(table[f"{one.name}_variance"], whole.p)
    lines = "".join(f"{','.join(map(repr, row))}\n" for row in recording.values.tolist())
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(lines.encode())))
    assert run(["filter", "-", "--config", files[1]]) == 0
    answers = np.loadtxt(io.StringIO(capsys.readouterr().out), delimiter=",")
    np.testing.assert_array_equal(answers, np.stack([whole.x for whole in expected], axis=1))


@pytest.mark.slow
def test_a_chain_may_be_given_and_only_kalman_needs_q_and_r(files, capsys, monkeypatch):
    z = read_recording(Path(files[0])).channel("c")
    words = {
        "median 5, one-euro 0.02 0.7 0.1": EURO,
        "exponential 0.25": Chain(1, Exponential(0.25)),
        "kalman": None,
    }
    for text, chain in {**words, "kalman": None}.items():
        assert run(["filter", files[0], "--config", files[1], "--channel", "c", "--chain", text]) == 0
        table = np.genfromtxt(io.StringIO(capsys.readouterr().out), delimiter=",", names=True)
        whole = ChannelTuning("c", "", 0.02, 1.5, chain=chain).filter.run(z)
        np.testing.assert_array_equal(table["c_filtered"], whole.x)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"0\n4\n")))
    assert run(["filter", "-", "--chain", "exponential 0.25"]) == 0
    assert capsys.readouterr().out == "0.0\n1.0\n"


def test_tune_keeps_the_chains_of_other_channels_and_says_which_one_it_replaces(files, capsys):
    assert run(["tune", files[0], "--channel", "b", "--lag-ms", "50", "-o", files[1]]) == 0
    assert "b: median of 3, then Kalman is replaced by the Kalman filter" in capsys.readouterr().err
    after = load_tuning(files[1])
    assert [one.chain for one in after.channels] == [EURO, None, None]


@pytest.mark.slow
def test_the_report_says_which_chain_runs_and_judges_nothing(files: tuple[str, str], tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert run(["report", files[0], "--config", files[1], "--channel", "a", "-o", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "median of 5, then one-euro (cut-off 0.02, β 0.7" in text
    assert "process noise q" not in text
    assert "gain K" not in text
    assert "NIS" not in text
    assert run(["report", files[0], "--config", files[1], "--channel", "b", "-o", str(page), "--force"]) == 0
    text = page.read_text(encoding="utf-8")
    assert "median of 3, then Kalman" in text
    assert "process noise q" in text


Captured = pytest.CaptureFixture[str]

WALK = "synthetic:random_walk?n=1200&sigmas=0.5,1,2&offsets=0.3,0.0,-0.3&every=1,2,5&period=1&seed=7"
SOURCE = "synthetic:random_walk?n=400&sigmas=0.5,1,2&offsets=0.3,0.0,-0.3&every=1,2,5&drop_outs=0.1&seed=7"
FUSION = ChannelTuning("level", "", 0.002, (0.25, 1.0, 4.0), sensors=("a", "b", "c"), offset=(0.3, 0.0, -0.3))


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A tuning with a fusion, and with the single filters of its sensors."""
    path = tmp_path / "tuning.toml"
    channels = tuple(ChannelTuning(name, "", 0.002, r) for name, r in zip("abc", FUSION.r, strict=True))
    save_tuning(Tuning(channels, sample_period=0.01, fusion=FUSION), path)
    return path


def table(text: str) -> tuple[list[str], np.ndarray]:
    """Header and numbers of a CSV, NaN for an empty cell."""
    header, *rows = csv.reader(io.StringIO(text))
    return header, np.array([[float(cell) if cell else math.nan for cell in row] for row in rows])


def readings(source: str = SOURCE) -> np.ndarray:
    return open_source(source).values


# ---- filter


MOVING = FilterParams(0.01, [1.0, 1.0, 9.0], offset=FUSION.offset, gate=16.0, momentum=5.0)
SLOW = f"{SOURCE}&sample_period=0.02"


@pytest.mark.parametrize(
    ("source", "options", "columns", "params", "note"),
    [
        (SOURCE, "--config CONFIG", "abc", FUSION.params, ""),
        (SOURCE, "--config CONFIG --fuse c,a", "ca", FUSION.params.only([2, 0]), ""),
        (SOURCE, "--config CONFIG --fuse 3,1", "ca", FUSION.params.only([2, 0]), ""),
        (SOURCE, "--config CONFIG --q 0.01 --r a=1,c=9 --gate 16 --momentum 5", "abc", MOVING, ""),
        (SLOW, "--config CONFIG", "abc", replace(FUSION, q=0.004).params, "q was multiplied by 2"),
    ],
)
def test_the_columns_are_sensors_fused_value_and_variance_bit_for_bit(
    source, options, columns, params, note, config, capsys
):
    assert run(["filter", source, *options.replace("CONFIG", str(config)).split()]) == 0
    out, err = capsys.readouterr()
    header, numbers = table(out)
    z = readings(source)[:, ["abc".index(one) for one in columns]]
    assert header[: -1 if params.momentum else None] == ["time", *columns, "level", "level_variance"]
    result = fuse(z, params)
    velocity = [] if result.velocity is None else [result.velocity / 0.01]
    np.testing.assert_array_equal(numbers[:, 1:], np.column_stack([z, result.x, result.p, *velocity]))
    assert (note in err, err.count("\n")) == (True, bool(note))


def test_a_sensor_that_the_recording_lacks_is_left_out_and_named(config: Path, capsys: Captured) -> None:
    assert run(["filter", "synthetic:sine?n=5&sigmas=1,1", "--config", str(config)]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("time,a,b,level,level_variance\n")
    assert "no channel c: fused without" in err


def test_a_pipe_is_fused_line_by_line(config, monkeypatch, capfdbinary):
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"1.0,1.5,2\n,1.2,\n1,2\n,,\n,,1\n")))
    assert run(["filter", "-", "--config", str(config)]) == 0
    out, err = capfdbinary.readouterr()
    rows = [[1.0, 1.5, 2.0], [math.nan, 1.2, math.nan], [math.nan] * 3, [math.nan] * 3, [math.nan, math.nan, 1.0]]
    expected = fuse(rows, FUSION.params).x.tolist()
    assert out.decode().split("\n") == [repr(expected[0]), repr(expected[1]), "", "", repr(expected[4]), ""]
    assert b"line 3 must hold 3 numbers" in err


# ---- tune


def tuned(capsys: Captured, *argv: str) -> dict:
    """The JSON of `kalscope tune`; NaN and Infinity, which JSON has not, are refused."""
    assert run(["tune", *argv, "--json"]) == 0

    def refuse(word: str) -> None:
        raise ValueError(word)

    return json.loads(capsys.readouterr().out, parse_constant=refuse)


@pytest.mark.slow
def test_json_says_what_the_library_says(capsys: Captured) -> None:
    said = tuned(capsys, WALK, "--fuse", "a,b,c")
    best = estimate_fusion(readings(WALK), names=("a", "b", "c"))
    assert best.params is not None
    assert said["fused"] == ["a", "b", "c"]
    assert (said["q"], said["momentum"], said["verdict"]) == (best.q, best.momentum, "ok")
    assert said["r"] == best.r.tolist()
    assert said["offset_interval"] == best.offset_interval.tolist()
    assert sum(said["shares"]) == pytest.approx(1.0)
    judged = said["judgement"]
    assert all(judged["error"] < min(one["error"], one["error_without"]) for one in judged["sensors"])
    assert judged["headline"].startswith("The fused value has an error of ")
    assert len(judged["prediction"]["single"]) == 3


@pytest.mark.parametrize(
    ("options", "field", "met"),
    [
        (["--cutoff-hz", "3", "--momentum", "5"], "cutoff_hz", 3.0),
        (["--noise-reduction-db", "9", "--overshoot", "8"], "noise_reduction_db", 9.0),
    ],
)
def test_a_target_is_met_while_all_sensors_answer(options, field, met, capsys):
    said = tuned(capsys, WALK, "--fuse", "a,b,c", *options)
    assert said["steady"][field] == pytest.approx(met, rel=1e-9)
    assert said["r"] == pytest.approx([0.25, 1.0, 4.0], rel=0.3)


@pytest.mark.slow
def test_what_is_known_of_a_sensor_is_kept(capsys: Captured) -> None:
    assert tuned(capsys, WALK, "--fuse", "a,b", "--r", "b=1.1")["r"][1] == 1.1
    assert tuned(capsys, WALK, "--fuse", "a,b", "--sigma", "2=3,1=2")["r"] == [4.0, 9.0]
    assert tuned(capsys, WALK, "--fuse", "a,c", "--sigma", "2")["r"] == [4.0, 4.0]
    assert tuned(capsys, WALK, "--fuse", "a,b", "--reference", "b")["offset"][1] == 0.0
    assert tuned(capsys, WALK, "--fuse", "a,b", "--gate", "16")["gate"] == 16.0


@pytest.mark.slow
def test_the_gain_of_a_sensor_in_another_unit_is_estimated(tmp_path: Path, capsys: Captured) -> None:
    truth = open_source("synthetic:random_walk?n=600&noise=none&period=1&amplitude=5").values[:, 0]
    noise = np.random.default_rng(4).normal(0.0, (0.4, 0.8), (600, 2))
    path = tmp_path / "units.csv"
    rows = [f"{i / 100},{a!r},{b!r}" for i, (a, b) in enumerate((np.c_[truth, 32 + 1.8 * truth] + noise).tolist())]
    path.write_text("\n".join(["time (s),inside (°C),shown (°F)", *rows, ""]), encoding="utf-8")
    assert run(["tune", str(path), "--fuse", "1,2"]) == 2
    assert "must have one unit (got inside in °C, shown in °F)" in capsys.readouterr().err
    said = tuned(capsys, str(path), "--fuse", "1,2", "--sensor-gains", "--reference", "inside")
    assert said["unit"] == "°C"
    assert said["gain"] == [1.0, pytest.approx(1.8, rel=0.02)]
    assert said["offset"] == [0.0, pytest.approx(32.0, abs=0.5)]
    assert run(["tune", str(path), "--fuse", "1,2", "--sensor-gains", "--reference", "inside"]) == 0
    assert "gain" in capsys.readouterr().out


@pytest.mark.slow
def test_a_saved_fusion_filters_as_it_was_found_and_a_channel_tuned_later_leaves_it(tmp_path, capsys):
    path = tmp_path / "tuning.toml"
    said = tuned(capsys, WALK, "--fuse", "a,c", "-o", str(path))
    fusion = load_tuning(path).fusion
    assert fusion is not None
    assert (fusion.sensors, fusion.q, list(fusion.r)) == (("a", "c"), said["q"], said["r"])
    assert [one.name for one in load_tuning(path).channels] == ["a", "c"]
    assert run(["filter", WALK, "--config", str(path)]) == 0
    expected = fuse(readings(WALK)[:, [0, 2]], fusion.params).x
    np.testing.assert_array_equal(table(capsys.readouterr().out)[1][:, 3], expected)
    assert run(["tune", WALK, "--channel", "b", "--momentum", "0", "-o", str(path)]) == 0
    again = load_tuning(path)
    assert again.fusion == fusion
    assert [one.name for one in again.channels] == ["a", "b", "c"]


def test_a_dead_sensor_gives_no_filter_but_words(tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "dead.csv"
    path.write_text("t,a,b\n" + "".join(f"{i},{math.sin(i) + i % 3},5\n" for i in range(80)))
    assert run(["tune", str(path), "--fuse", "a,b"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "a + b: no q and r to recommend (constant)" in out
    assert "All readings of b are equal" in out
    assert run(["tune", str(path), "--fuse", "a,b", "-o", str(tmp_path / "t.toml")]) == 2
    assert "-o needs a usable q and r, and the record gives none (a + b: constant)" in capsys.readouterr().err


# ---- report


@pytest.mark.slow
def test_the_report_of_a_fusion_shows_its_sensors_and_says_what_it_brings(tmp_path: Path, config: Path) -> None:
    page = tmp_path / "report.html"
    assert run(["report", SOURCE, "--config", str(config), "-o", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert all(words in text for words in ("a + b + c", "noise σ", "What does fusing bring?", "RMSE to the truth"))
    assert all(f">{name}<" in text for name in ("a", "b", "c", "level"))
