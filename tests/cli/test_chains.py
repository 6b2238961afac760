"""A chain of filters on the command line: filtered, tuned beside, reported, exported."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from kalscope.cli.app import run
from kalscope.filtering.classic import Chain, Exponential, OneEuro
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
def test_a_recording_and_lines_go_through_the_chains_of_the_tuning(
    files: tuple[str, str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
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
def test_a_chain_may_be_given_and_only_kalman_needs_q_and_r(
    files: tuple[str, str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
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
    for text, status in {"exponential 0.25": 0, "median 5, kalman": 2}.items():
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"0\n4\n")))
        assert run(["filter", "-", "--chain", text]) == status
        assert capsys.readouterr().out == ("" if status else "0.0\n1.0\n")
    assert run(["filter", files[0], "--chain", "median 4, kalman"]) == 2
    assert "window must be an odd number" in capsys.readouterr().err
    assert run(["filter", files[0], "--fuse", "a,b", "--chain", "median 5, kalman"]) == 2
    assert "--chain must be used without fused channels" in capsys.readouterr().err


def test_tune_keeps_the_chains_of_other_channels_and_says_which_one_it_replaces(
    files: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
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
