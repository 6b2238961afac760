"""`tune --fuse`, `filter --fuse` and the report of a fusion."""

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
from kalscope.filtering.filter import fuse
from kalscope.filtering.params import FilterParams
from kalscope.tuning.file import load_tuning, save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning

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
def test_the_columns_are_the_sensors_the_fused_value_and_its_variance_bit_for_bit(
    source: str, options: str, columns: str, params: FilterParams, note: str, config: Path, capsys: Captured
) -> None:
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


def test_a_pipe_is_fused_line_by_line(
    config: Path, monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"1.0,1.5,2\n,1.2,\n1,2\n,,\n,,1\n")))
    assert run(["filter", "-", "--config", str(config)]) == 0
    out, err = capfdbinary.readouterr()
    rows = [[1.0, 1.5, 2.0], [math.nan, 1.2, math.nan], [math.nan] * 3, [math.nan] * 3, [math.nan, math.nan, 1.0]]
    expected = fuse(rows, FUSION.params).x.tolist()
    assert out.decode().split("\n") == [repr(expected[0]), repr(expected[1]), "", "", repr(expected[4]), ""]
    assert b"line 3 must hold 3 numbers" in err


@pytest.mark.parametrize(
    ("argv", "must"),
    [
        (["--fuse", "a,x"], "of one unit, of a, b, c (got 'x', which is not a channel)"),
        (["--fuse", "a,b", "--channel", "a"], "--fuse must be used without --channel"),
        (["--r", "a=1,b=2", "--channel", "a"], "--r must be one number without --fuse (got one for a, b)"),
        (["--r", "a=x"], "--r must be a number (got 'x')"),
    ],
)
def test_what_cannot_be_fused_is_refused_with_words(
    argv: list[str], must: str, config: Path, capsys: Captured
) -> None:
    assert run(["filter", SOURCE, "--config", str(config), *argv]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert must in err
    assert err.count("\n") == 1


def test_a_tuning_without_a_fusion_says_how_to_make_one(tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "single.toml"
    save_tuning(Tuning((ChannelTuning("a", "", 0.1, 1.0),)), path)
    for argv in ([SOURCE, "--config", str(path)], ["-", "--config", str(path)], [SOURCE], ["-"]):
        assert run(["filter", *argv, "--fuse", "a,b"]) == 2
        assert "--fuse needs --config with a fusion: kalscope tune" in capsys.readouterr().err


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
def test_a_target_is_met_while_all_sensors_answer(
    options: list[str], field: str, met: float, capsys: Captured
) -> None:
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
def test_a_saved_fusion_filters_as_it_was_found_and_a_channel_tuned_later_leaves_it(
    tmp_path: Path, capsys: Captured
) -> None:
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


@pytest.mark.parametrize(
    ("argv", "must"),
    [
        (["--fuse", "a"], "--fuse must be two or more channels of one unit, of a, b, c (got 'a')"),
        (["--fuse", "a,b", "--all"], "--fuse must be used without --channel and --all"),
        (["--reference", "a"], "--reference needs --fuse"),
        (["--fuse", "a,b", "--reference", "c"], "--reference must be a sensor of --fuse: a, b (got 'c')"),
        (["--fuse", "a,b", "--r", "a=1", "--sigma", "b=1"], "only one of --still, --sigma, --density, --r"),
        (["--r", "a=1"], "--r must be one number without --fuse (got one for a)"),
        (["--fuse", "a,b", "--lag-ms", "1e11"], "the goal must be a filter that is not slower than the record"),
    ],
)
def test_what_cannot_be_tuned_together_is_refused_with_words(argv: list[str], must: str, capsys: Captured) -> None:
    assert run(["tune", SOURCE, *argv]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert must in err
    assert err.count("\n") == 1


# ---- report


@pytest.mark.slow
def test_the_report_of_a_fusion_shows_its_sensors_and_says_what_it_brings(tmp_path: Path, config: Path) -> None:
    page = tmp_path / "report.html"
    assert run(["report", SOURCE, "--config", str(config), "-o", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert all(words in text for words in ("a + b + c", "noise σ", "What does fusing bring?", "RMSE to the truth"))
    assert all(f">{name}<" in text for name in ("a", "b", "c", "level"))
