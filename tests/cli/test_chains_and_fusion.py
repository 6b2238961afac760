"""Chains and fused sensors on the command line: filtered, tuned, reported."""

from __future__ import annotations

import io
import json
import math
import sys
from dataclasses import replace

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
WALK = "synthetic:random_walk?n=1200&sigmas=0.5,1,2&offsets=0.3,0.0,-0.3&every=1,2,5&period=1&seed=7"
SOURCE = "synthetic:random_walk?n=400&sigmas=0.5,1,2&offsets=0.3,0.0,-0.3&every=1,2,5&drop_outs=0.1&seed=7"
FUSION = ChannelTuning("level", "", 0.002, (0.25, 1.0, 4.0), sensors=("a", "b", "c"), offset=(0.3, 0.0, -0.3))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder: a recording of three channels, a tuning with two chains, and one with a fusion."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(5)
    z = np.cumsum(rng.normal(0.0, 0.1, (400, 3)), axis=0) + rng.normal(0.0, 1.0, (400, 3))
    z[100:110] += 30.0
    lines = (",".join(map(repr, [0.01 * i, *row])) for i, row in enumerate(z.tolist()))
    (tmp_path / "log.csv").write_text("time,a,b,c\n" + "\n".join(lines) + "\n")
    recording = read_recording("log.csv")
    save_tuning(Tuning(CHANNELS, sha256=recording.sha256, sample_period=recording.sample_period), "chains.toml")
    singles = tuple(ChannelTuning(name, "", 0.002, r) for name, r in zip("abc", FUSION.r, strict=True))
    save_tuning(Tuning(singles, sample_period=0.01, fusion=FUSION), "fusion.toml")
    return tmp_path


def table(capsys, *argv):
    """The CSV of `kalscope filter` by column, NaN for an empty cell, and what it says."""
    assert run(["filter", *argv]) == 0
    out, err = capsys.readouterr()
    return np.genfromtxt(io.StringIO(out), delimiter=",", names=True), err


def type_lines(monkeypatch, text):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))


# ---- chains


@pytest.mark.slow
def test_a_recording_and_lines_go_through_the_chains_of_the_tuning_or_the_given_one(capsys, monkeypatch):
    recording = read_recording("log.csv")
    expected = [one.filter.run(recording.channel(one.name)) for one in CHANNELS]
    filtered, _ = table(capsys, "log.csv", "--config", "chains.toml")
    for one, whole in zip(CHANNELS, expected, strict=True):
        np.testing.assert_array_equal(filtered[f"{one.name}_filtered"], whole.x)
        np.testing.assert_array_equal(filtered[f"{one.name}_variance"], whole.p)
    type_lines(monkeypatch, "".join(f"{','.join(map(repr, row))}\n" for row in recording.values.tolist()))
    assert run(["filter", "-", "--config", "chains.toml"]) == 0
    answers = np.loadtxt(io.StringIO(capsys.readouterr().out), delimiter=",")
    np.testing.assert_array_equal(answers, np.stack([whole.x for whole in expected], axis=1))
    words = {
        "median 5, one-euro 0.02 0.7 0.1": EURO,
        "exponential 0.25": Chain(1, Exponential(0.25)),
        "kalman": None,
    }
    for text, chain in words.items():
        filtered, _ = table(capsys, "log.csv", "--config", "chains.toml", "--channel", "c", "--chain", text)
        whole = replace(CHANNELS[2], chain=chain).filter.run(recording.channel("c"))
        np.testing.assert_array_equal(filtered["c_filtered"], whole.x)
    type_lines(monkeypatch, "0\n4\n")
    assert run(["filter", "-", "--chain", "exponential 0.25"]) == 0  # only Kalman's needs q and r
    assert capsys.readouterr().out == "0.0\n1.0\n"


@pytest.mark.slow
def test_tune_keeps_the_chains_of_other_channels_and_says_which_one_it_replaces(capsys):
    assert run(["tune", "log.csv", "--channel", "b", "--lag-ms", "50", "-o", "chains.toml"]) == 0
    assert "b: median of 3, then Kalman is replaced by the Kalman filter" in capsys.readouterr().err
    assert [one.chain for one in load_tuning("chains.toml").channels] == [EURO, None, None]


@pytest.mark.slow
def test_the_report_says_which_chain_runs_and_judges_only_one_of_kalman(folder):
    def report(channel):
        argv = ["report", "log.csv", "--config", "chains.toml", "--channel", channel, "-o", f"{channel}.html"]
        assert run(argv) == 0
        return (folder / f"{channel}.html").read_text("utf-8")

    euro, kalman = report("a"), report("b")
    assert "median of 5, then one-euro (cut-off 0.02, β 0.7" in euro
    assert not any(words in euro for words in ("process noise q", "gain K", "NIS"))
    assert all(words in kalman for words in ("median of 3, then Kalman", "process noise q"))


# ---- fused sensors, filtered


MOVING = FilterParams(0.01, [1.0, 1.0, 9.0], offset=FUSION.offset, gate=16.0, momentum=5.0)
SLOW = f"{SOURCE}&sample_period=0.02"


@pytest.mark.parametrize(
    ("source", "options", "columns", "params", "note"),
    [
        (SOURCE, "", "abc", FUSION.params, ""),
        (SOURCE, "--fuse c,a", "ca", FUSION.params.only([2, 0]), ""),
        (SOURCE, "--fuse 3,1", "ca", FUSION.params.only([2, 0]), ""),
        (SOURCE, "--q 0.01 --r a=1,c=9 --gate 16 --momentum 5", "abc", MOVING, ""),
        (SLOW, "", "abc", replace(FUSION, q=0.004).params, "q was multiplied by 2"),
        ("synthetic:sine?n=50&sigmas=1,1", "", "ab", FUSION.params.only([0, 1]), "no channel c: fused without"),
    ],
)
def test_the_columns_are_sensors_fused_value_and_variance_bit_for_bit(
    source, options, columns, params, note, capsys
):
    filtered, err = table(capsys, source, "--config", "fusion.toml", *options.split())
    z = open_source(source).values[:, ["abc".index(one) for one in columns]]
    assert filtered.dtype.names[: -1 if params.momentum else None] == ("time", *columns, "level", "level_variance")
    result = fuse(z, params)
    velocity = [] if result.velocity is None else [result.velocity / 0.01]
    expected = np.column_stack([z, result.x, result.p, *velocity])
    np.testing.assert_array_equal(np.array(filtered.tolist())[:, 1:], expected)
    assert (note in err, err.count("\n")) == (True, bool(note))


def test_a_pipe_is_fused_line_by_line(monkeypatch, capsys):
    type_lines(monkeypatch, "1.0,1.5,2\n,1.2,\n1,2\n,,\n,,1\n")
    assert run(["filter", "-", "--config", "fusion.toml"]) == 0
    out, err = capsys.readouterr()
    nan = math.nan
    rows = [[1.0, 1.5, 2.0], [nan, 1.2, nan], [nan] * 3, [nan] * 3, [nan, nan, 1.0]]
    x = list(map(repr, fuse(rows, FUSION.params).x.tolist()))
    assert out.split("\n") == [x[0], x[1], "", "", x[4], ""]
    assert "line 3 must hold 3 numbers" in err


# ---- fused sensors, tuned


def tuned(capsys, *argv):
    """The JSON of `kalscope tune`; NaN and Infinity, which JSON has not, are refused."""
    assert run(["tune", *argv, "--json"]) == 0
    return json.loads(capsys.readouterr().out, parse_constant=pytest.fail)


@pytest.mark.slow
def test_json_has_what_the_library_finds(capsys):
    answer = tuned(capsys, WALK, "--fuse", "a,b,c")
    best = estimate_fusion(open_source(WALK).values, names=("a", "b", "c"))
    assert (answer["q"], answer["momentum"], answer["verdict"]) == (best.q, best.momentum, "ok")
    assert (answer["fused"], answer["r"]) == (["a", "b", "c"], best.r.tolist())
    assert answer["offset_interval"] == best.offset_interval.tolist()
    assert sum(answer["shares"]) == pytest.approx(1.0)
    judged = answer["judgement"]
    assert all(judged["error"] < min(one["error"], one["error_without"]) for one in judged["sensors"])
    assert judged["headline"].startswith("The fused value has an error of ")
    assert len(judged["prediction"]["single"]) == 3


@pytest.mark.slow
def test_a_target_is_met_while_all_sensors_answer(capsys):
    answer = tuned(capsys, WALK, "--fuse", "a,b,c", "--noise-reduction-db", "9", "--overshoot", "8")
    assert answer["steady"]["noise_reduction_db"] == pytest.approx(9.0, rel=1e-9)
    assert answer["r"] == pytest.approx([0.25, 1.0, 4.0], rel=0.3)


@pytest.mark.slow
def test_what_is_known_of_a_sensor_is_kept(capsys):
    assert tuned(capsys, WALK, "--fuse", "a,b", "--r", "b=1.1")["r"][1] == 1.1
    assert tuned(capsys, WALK, "--fuse", "a,b", "--sigma", "2=3,1=2")["r"] == [4.0, 9.0]
    assert tuned(capsys, WALK, "--fuse", "a,c", "--sigma", "2")["r"] == [4.0, 4.0]
    answer = tuned(capsys, WALK, "--fuse", "a,b", "--reference", "b", "--gate", "16")
    assert (answer["offset"][1], answer["gate"]) == (0.0, 16.0)


@pytest.mark.slow
def test_the_gain_of_a_sensor_in_another_unit_is_estimated(folder, capsys):
    truth = open_source("synthetic:random_walk?n=600&noise=none&period=1&amplitude=5").values[:, 0]
    z = np.c_[truth, 32 + 1.8 * truth] + np.random.default_rng(4).normal(0.0, (0.4, 0.8), (600, 2))
    rows = (f"{i / 100},{a!r},{b!r}\n" for i, (a, b) in enumerate(z.tolist()))
    (folder / "units.csv").write_text("time (s),inside (°C),shown (°F)\n" + "".join(rows), encoding="utf-8")
    assert run(["tune", "units.csv", "--fuse", "1,2"]) == 2
    assert "must have one unit (got inside in °C, shown in °F)" in capsys.readouterr().err
    answer = tuned(capsys, "units.csv", "--fuse", "1,2", "--sensor-gains", "--reference", "inside")
    assert (answer["unit"], answer["gain"]) == ("°C", [1.0, pytest.approx(1.8, rel=0.02)])
    assert answer["offset"] == [0.0, pytest.approx(32.0, abs=0.5)]


@pytest.mark.slow
def test_a_saved_fusion_filters_as_it_was_found_and_a_channel_tuned_later_leaves_it(capsys):
    answer = tuned(capsys, WALK, "--fuse", "a,c", "-o", "saved.toml")
    saved = load_tuning("saved.toml")
    assert (saved.fusion.sensors, saved.fusion.q, list(saved.fusion.r)) == (("a", "c"), answer["q"], answer["r"])
    assert [one.name for one in saved.channels] == ["a", "c"]
    expected = fuse(open_source(WALK).values[:, [0, 2]], saved.fusion.params).x
    columns, _ = table(capsys, WALK, "--config", "saved.toml")
    np.testing.assert_array_equal(columns[columns.dtype.names[3]], expected)
    assert run(["tune", WALK, "--channel", "b", "--momentum", "0", "-o", "saved.toml"]) == 0
    again = load_tuning("saved.toml")
    assert again.fusion == saved.fusion
    assert [one.name for one in again.channels] == ["a", "b", "c"]


@pytest.mark.slow
def test_a_dead_sensor_gives_no_filter_but_words(folder, capsys):
    (folder / "dead.csv").write_text("t,a,b\n" + "".join(f"{i},{math.sin(i) + i % 3},5\n" for i in range(80)))
    assert run(["tune", "dead.csv", "--fuse", "a,b"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "a + b: no q and r to recommend (constant)" in text
    assert "All readings of b are equal" in text
    assert run(["tune", "dead.csv", "--fuse", "a,b", "-o", "t.toml"]) == 2
    assert "-o needs a usable q and r, and the record gives none (a + b: constant)" in capsys.readouterr().err


@pytest.mark.slow
def test_the_report_of_a_fusion_shows_its_sensors_and_says_what_it_brings(folder):
    assert run(["report", SOURCE, "--config", "fusion.toml", "-o", "page.html"]) == 0
    text = (folder / "page.html").read_text("utf-8")
    assert all(words in text for words in ("a + b + c", "noise σ", "What does fusing bring?", "RMSE to the truth"))
    assert all(f">{name}<" in text for name in ("a", "b", "c", "level"))
