"""`tune --fuse`, `filter --fuse` and the report of a fusion."""

from __future__ import annotations

import csv
import io
import math
import re
from pathlib import Path

import numpy as np
import pytest

from kalscope.catalogue import open_source
from kalscope.cli.app import run
from kalscope.cli.filter.line_filter import LineFilter
from kalscope.filtering.fusion.batch import fuse
from kalscope.filtering.fusion.params import FusionParams
from kalscope.tuning.fusion import FusionTuning
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope.tuning.tuning_file import save_tuning

Captured = pytest.CaptureFixture[str]

SOURCE = "synthetic:random_walk?n=400&sigmas=0.5,1,2&offsets=0.3,0.0,-0.3&every=1,2,5&drop_outs=0.1&seed=7"
FUSION = FusionTuning("level", "", ("a", "b", "c"), 0.002, (0.25, 1.0, 4.0), (0.3, 0.0, -0.3))


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


def test_a_tuning_with_a_fusion_gives_the_sensors_the_fused_value_and_its_variance(
    config: Path, capsys: Captured
) -> None:
    assert run(["filter", SOURCE, "--config", str(config)]) == 0
    header, numbers = table(capsys.readouterr().out)
    assert header == ["time", "a", "b", "c", "level", "level_variance"]
    result = fuse(readings(), FUSION.params)
    np.testing.assert_array_equal(numbers[:, 1:], np.column_stack([readings(), result.x, result.p]))


def test_one_channel_of_it_can_still_be_filtered_alone(config: Path, capsys: Captured) -> None:
    assert run(["filter", SOURCE, "--config", str(config), "--channel", "b"]) == 0
    assert capsys.readouterr().out.startswith("time,b,b_filtered,b_variance\n")


@pytest.mark.parametrize("names", ["c,a", "3,1"])
def test_some_of_its_sensors_are_fused_on_request(names: str, config: Path, capsys: Captured) -> None:
    assert run(["filter", SOURCE, "--config", str(config), "--fuse", names]) == 0
    header, numbers = table(capsys.readouterr().out)
    assert header[1:4] == ["c", "a", "level"]
    expected = fuse(readings()[:, [2, 0]], FUSION.params.only([2, 0])).x
    np.testing.assert_array_equal(numbers[:, 3], expected)


def test_a_sensor_that_the_recording_lacks_is_left_out_and_named(config: Path, capsys: Captured) -> None:
    assert run(["filter", "synthetic:sine?n=5&sigmas=1,1", "--config", str(config)]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("time,a,b,level,level_variance\n")
    assert "no channel c: fused without" in err


def test_options_take_precedence_over_the_file_and_suffice_without_one(config: Path, capsys: Captured) -> None:
    given = ["--q", "0.01", "--r", "a=1,c=9", "--gate", "16", "--momentum", "5"]
    assert run(["filter", SOURCE, "--config", str(config), *given]) == 0
    header, numbers = table(capsys.readouterr().out)
    assert header[-1] == "level_velocity_per_s"
    params = FusionParams(0.01, np.array([1.0, 1.0, 9.0]), np.array(FUSION.offset), gate=16.0, momentum=5.0)
    result = fuse(readings(), params)
    assert result.velocity is not None
    np.testing.assert_array_equal(numbers[:, 4], result.x)
    np.testing.assert_array_equal(numbers[:, 6], result.velocity / 0.01)
    assert run(["filter", SOURCE, "--fuse", "a,b", "--q", "0.01", "--r", "2"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    header, numbers = table(out)
    assert header[3] == "fused"
    expected = fuse(readings()[:, :2], FusionParams(0.01, np.array([2.0, 2.0]))).x
    np.testing.assert_array_equal(numbers[:, 3], expected)


def test_q_follows_the_sample_period_of_the_recording(config: Path, capsys: Captured) -> None:
    slow = f"{SOURCE}&sample_period=0.02"
    assert run(["filter", slow, "--config", str(config)]) == 0
    out, err = capsys.readouterr()
    assert "q was multiplied by 2" in err
    expected = fuse(readings(slow), FusionParams(0.004, np.array(FUSION.r), np.array(FUSION.offset))).x
    np.testing.assert_array_equal(table(out)[1][:, 4], expected)


def test_lines_are_fused_as_the_whole_recording_is_bit_for_bit(config: Path) -> None:
    z = readings()
    lines = LineFilter(FUSION.params)
    answers = [lines.answer(",".join("" if math.isnan(one) else repr(one) for one in row))[0] for row in z.tolist()]
    expected = fuse(z, FUSION.params).x
    silent = np.isnan(z).all(axis=1)
    assert silent.any()
    assert [answer == "" for answer in answers] == silent.tolist()
    assert [float(answer) for answer in answers if answer] == expected[~silent].tolist()


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
        (["--fuse", "a"], "--fuse must be two or more channels of one unit, such as a, b, c (got 'a')"),
        (["--fuse", "a,x"], "--fuse must be two or more channels of one unit, such as a, b, c (got 'x')"),
        (["--fuse", "a,b", "--channel", "a"], "--fuse must stand without --channel"),
        (["--r", "a=1,b=2", "--q", "1"], "--r must be one number without --fuse (got one for a, b)"),
        (["--fuse", "a,b", "--q", "1", "--r", "a=1,z=2"], "--r must be a sensor of --fuse: a, b (got 'z')"),
        (["--fuse", "a,b", "--q", "1", "--r", "a=x"], "--r must be a number (got 'x')"),
        (["--fuse", "a,b", "--q", "0", "--r", "0"], "must not both be 0"),
    ],
)
def test_what_cannot_be_fused_is_refused_with_words(argv: list[str], must: str, capsys: Captured) -> None:
    assert run(["filter", SOURCE, *argv]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert must in err
    assert err.count("\n") == 1


def test_a_tuning_without_a_fusion_says_how_to_make_one(tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "single.toml"
    save_tuning(Tuning((ChannelTuning("a", "", 0.1, 1.0),)), path)
    for source in (SOURCE, "-"):
        assert run(["filter", source, "--config", str(path), "--fuse", "a,b"]) == 2
        assert re.search(r"must hold a fusion \(got channels a alone\): kalscope tune", capsys.readouterr().err)
    assert run(["filter", "-", "--fuse", "a,b"]) == 2
    assert "needs --config with a fusion" in capsys.readouterr().err
