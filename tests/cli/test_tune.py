from __future__ import annotations

import io
import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from program import command
from waiting import PATIENCE

from kalscope.catalogue import open_source
from kalscope.cli import console
from kalscope.cli.app import run
from kalscope.cli.console import progress_line
from kalscope.cli.tune_options import still_samples
from kalscope.common import compiled
from kalscope.common.compiled import Compiling
from kalscope.common.progress import Progress
from kalscope.errors import KalscopeError
from kalscope.estimation.fit import METHODS, estimate
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.sources.reading.recording_file import read_recording
from kalscope.tuning.file import load_tuning

SHARED_DATA = Path(__file__).parents[3] / "shared" / "data"
Captured = pytest.CaptureFixture[str]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Three channels at 100 Hz: a random walk under noise, constant for 1 s; a smooth one; a constant."""
    rng = np.random.default_rng(3)
    steps = rng.normal(scale=0.3, size=500)
    steps[:100] = 0.0
    noisy = np.cumsum(steps) + rng.normal(size=500)
    path = tmp_path / "log.csv"
    rows = [f"{10 + i / 100:.2f},{z!r},{math.sin(i / 40)!r},7" for i, z in enumerate(noisy.tolist())]
    path.write_text("\n".join(["time (s),noisy (V),smooth,stuck", *rows, ""]))
    return path


@pytest.fixture
def bare(log: Path) -> Path:
    """The noisy channel of `log` without a time column."""
    path = log.with_name("bare.csv")
    path.write_text("\n".join(["noisy", *(line.split(",")[1] for line in log.read_text().splitlines()[1:]), ""]))
    return path


def tuned(capsys: Captured, *argv: str) -> dict:
    """The JSON of `kalscope tune`; NaN and Infinity, which JSON has not, are refused."""
    assert run(["tune", *argv, "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""

    def refuse(word: str) -> None:
        raise ValueError(word)

    return json.loads(out, parse_constant=refuse)


@pytest.mark.slow
def test_spikes_are_set_aside_counted_and_gated(bare: Path, capsys: Captured) -> None:
    lines = bare.read_text().splitlines()
    for row in range(20, 90, 20):
        lines[row] = "1000"
    bare.write_text("\n".join([*lines, ""]))
    said, kept = tuned(capsys, str(bare)), tuned(capsys, str(bare), "--no-robust")
    assert said["set_aside"]["samples"] == [19, 39, 59, 79]
    assert said["gate"] == 16.0
    assert (said["set_aside"]["plain"]["q"], said["set_aside"]["plain"]["r"]) == (kept["q"], kept["r"])
    assert kept["set_aside"] is None
    assert kept["r"] > 100.0 * said["r"]
    assert run(["tune", str(bare), "--robust"]) == 0
    out = capsys.readouterr().out
    assert ", gate 4 σ, 4 spikes set aside\n" in out
    assert "--no-robust keeps them" in " ".join(out.split())  # heartbeats look like spikes


@pytest.mark.slow
@pytest.mark.parametrize("options", [[], ["--lag-ms", "50"]])
def test_spikes_are_kept_out_of_the_second_opinions_and_of_the_range(
    options: list[str], tmp_path: Path, capsys: Captured
) -> None:
    g = np.random.default_rng(5)
    z = np.cumsum(g.normal(0.0, 0.1, 2000)) + g.normal(size=2000)
    clean, spiky = tmp_path / "clean.csv", tmp_path / "spiky.csv"
    for path in (clean, spiky):
        path.write_text("t_s,z\n" + "".join(f"{i / 100:.2f},{x!r}\n" for i, x in enumerate(z.tolist())))
        z[50::100] += 30.0
    right, said = tuned(capsys, str(clean), *options), tuned(capsys, str(spiky), *options)
    for one, other in zip(said["opinions"], right["opinions"], strict=True):
        assert one["r"] == pytest.approx(other["r"], rel=0.15)
    assert said["lag_interval"] == pytest.approx(right["lag_interval"], rel=0.2)
    kept = tuned(capsys, str(spiky), *options, "--no-robust")
    assert kept["opinions"][0]["r"] > 5.0 * said["opinions"][0]["r"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("period", "option"), [(0.01, "--lag-ms 50"), (3600.0, "--gain 0.2"), (2e-9, "--gain 0.2")]
)
def test_the_filter_that_is_offered_is_written_in_plain_digits(
    period: float, option: str, tmp_path: Path, capsys: Captured
) -> None:
    path = tmp_path / "z.csv"
    path.write_text("z\n" + "".join(f"{i}\n" for i in range(100)))
    assert run(["tune", str(path), "--sample-period", str(period)]) == 0
    assert f"with {option}: " in capsys.readouterr().out


# ---- the page


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        *("demo", "demo --lag-ms 50", "sample:nile", "sample:ultrasonic"),
        *("{log}", "{log} --still 10:10.995", "{log} --channel smooth", "{log} --channel stuck"),
        *("{lost}", "{bare} --gain 0.2"),
    ],
)
def test_the_answer_stands_in_six_lines(words: str, log: Path, bare: Path, lost: Path, capsys: Captured) -> None:
    argv = words.format(log=log, bare=bare, lost=lost).split()
    assert run(["tune", *argv]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    first, *rest = (line for line in out.splitlines() if not line.startswith("Assumed: "))
    assert " rows, " in first  # how it was read
    assert rest.pop(0).startswith("Read as ")
    assert 3 <= len(rest) <= 5
    assert max(len(line) for line in rest if not line.startswith("Warning: ")) <= 96
    said, page = tuned(capsys, *argv), " ".join(rest)
    assert f"{said['channel']}: {'no q and r' if said['q'] is None else 'q = '}" in page
    judged = said["judgement"]
    assert judged["headline"] in page
    assert "Next" in page or judged["advice"]
    for one in judged["advice"][:1]:
        how = f", {'' if one['option'].startswith('without') else 'with '}{one['option']}" if one["option"] else ""
        assert f"{'Next' if one['action'] else 'Note'}{how}: {one['text']}"[:80] in page


@pytest.mark.slow
def test_the_six_lines_say_the_filter_and_what_it_does(capsys: Captured) -> None:
    assert run(["tune", "sample:nile"]) == 0
    _, _, found, does, *_ = capsys.readouterr().out.splitlines()
    assert found == "volume: q = 1\u202f469, r = 15\u202f100 (1e8 m3)², no momentum, no gate"
    assert does == "lag 2.74 years (2.74 samples; 95 %: 340 days to 8.06 years), noise −8.12 dB, no overshoot"
    assert run(["tune", "demo", "--lag-ms", "50"]) == 0
    does = capsys.readouterr().out.splitlines()[3]
    assert does.startswith("lag 50 ms (2.5 samples; the record favours ")
    assert does.endswith("), noise −7.78 dB, no overshoot")


@pytest.mark.slow
def test_a_note_of_several_sentences_begins_each_with_a_capital(tmp_path: Path, capsys: Captured) -> None:
    g = np.random.default_rng(3)
    z = np.cumsum(g.normal(size=2000)) + g.normal(size=2000)
    z[100::200] += 60.0
    log = tmp_path / "spikes.csv"
    log.write_text("t,z\n" + "".join(f"{i / 100},{value}\n" for i, value in enumerate(z)))
    assert run(["tune", str(log), "--lag-ms", "200"]) == 0
    assert "Note: You chose a lag of 200 ms. The best statistical fit" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_all_channels_have_their_six_lines(log: Path, capsys: Captured) -> None:
    assert run(["tune", str(log), "--all"]) == 0
    *_, rest = capsys.readouterr().out.split("\n", 2)
    blocks = rest.rstrip("\n").split("\n\n")
    assert [block.split(":")[0] for block in blocks] == ["noisy", "smooth", "stuck"]
    assert all(len(block.splitlines()) <= 5 for block in blocks)


@pytest.mark.slow
def test_a_gate_is_taken_told_and_saved(log: Path, tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "t.toml"
    said = tuned(capsys, str(log), "--gate", "12.25", "-o", str(path))
    assert said["gate"] == load_tuning(path).channel("noisy").gate == 12.25
    assert run(["tune", str(log), "--gate", "12.25"]) == 0
    assert ", gate 3.5 σ\n" in capsys.readouterr().out
    assert tuned(capsys, str(log), "--gate", "off")["gate"] is None


@pytest.mark.slow
def test_the_details_say_q_r_and_why(capsys: Captured) -> None:
    assert run(["tune", "sample:nile"]) == 0
    summary = capsys.readouterr().out
    assert run(["tune", "sample:nile", "--details"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.startswith(summary)
    assert "q = 1\u202f469 (1e8 m3)²" in out
    assert "r = 15\u202f100 (1e8 m3)²" in out
    assert "how: maximum likelihood" in out
    assert "lag (delay)      2.74 years (2.74 samples)" in out
    assert "The record allows (95 %): q/r 0.0137 to 0.557" in out
    assert "Compare estimators" in out
    assert "judged on the second: NIS" in out
    assert max(map(len, out.removeprefix(summary).splitlines())) <= 96


@pytest.mark.slow
def test_a_method_outside_the_interval_is_named(capsys: Captured) -> None:
    assert run(["tune", "demo", "--momentum", "0", "--details"]) == 0
    out = capsys.readouterr().out
    assert "Outside the 95 % interval of maximum likelihood: " in out
    assert re.search(r"  Allan variance( +\S+){3} +no  ok\n", out)


@pytest.mark.slow
def test_an_edge_is_told_in_words_and_never_as_an_answer(log: Path, capsys: Captured) -> None:
    assert run(["tune", str(log), "--channel", "smooth", "--details"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "smooth: no q and r to recommend (r → 0: no noise seen)\n" in out
    assert "Instead: take r from a still stretch" in " ".join(out.split())
    assert "Next, with --lag-ms 50: " in out
    assert "What this filter does" not in out
    assert "Residuals:" not in out


@pytest.mark.slow
def test_the_first_channel_is_tuned_and_the_others_are_named(log: Path, capsys: Captured) -> None:
    assert run(["tune", str(log)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("log.csv: 500 rows, 3 channels, 100 Hz\nRead as 500 rows over 4.99 s; ")
    assert out.endswith("Other channels (--channel, --all): smooth, stuck (constant)\n")
    assert run(["tune", str(log), "--all", "--details"]) == 0
    out = capsys.readouterr().out
    assert [name for name in ("noisy", "smooth", "stuck") if f"\n{name}: " in out] == ["noisy", "smooth", "stuck"]
    assert out.count("samples            500\n") == 3
    assert "Other channels" not in out


@pytest.mark.slow
def test_without_time_the_lag_is_in_samples_only(bare: Path, capsys: Captured) -> None:
    assert run(["tune", str(bare), "--details"]) == 0
    out = capsys.readouterr().out
    assert "sample period unknown (see --rate)" in out
    assert "× the sample rate" in out
    assert " ms" not in out
    assert run(["tune", str(bare), "--sample-period", "0.01", "--details"]) == 0
    assert " ms (" in capsys.readouterr().out


@pytest.fixture
def lost(tmp_path: Path) -> Path:
    """A log whose sensor is lost for most of it, and stuck before."""
    rows = [f"{i},21.0" if i < 60 else "sensor lost" for i in range(317)]
    path = tmp_path / "lost.csv"
    path.write_text("\n".join(["t,temp", *rows, ""]))
    return path


@pytest.fixture
def moving(tmp_path: Path) -> Path:
    """A signal that keeps its direction for 20 samples, 100 Hz."""
    rng = np.random.default_rng(5)
    velocity = np.convolve(rng.normal(size=1319), np.exp(-np.arange(320) / 20.0), mode="valid")
    z = np.cumsum(velocity) + rng.normal(scale=5.0, size=1000)
    path = tmp_path / "moving.csv"
    path.write_text("\n".join(["time (s),z", *(f"{i / 100:.2f},{one!r}" for i, one in enumerate(z.tolist())), ""]))
    return path


@pytest.mark.slow
def test_momentum_is_found_and_its_gain_and_cost_are_told(moving: Path, capsys: Captured) -> None:
    assert run(["tune", str(moving), "--details"]) == 0
    out = capsys.readouterr().out
    assert "momentum           τ = " in out
    assert "  overshoot (step) " in out
    assert "all of them look for a signal without momentum" in out
    assert "error of predicting unseen samples is" in " ".join(out.split())
    said = tuned(capsys, str(moving))
    low, high = said["momentum_interval"]
    assert low < said["momentum"] < high
    assert low < 20.0 < high
    assert said["prediction_gain"] > 0.02


@pytest.mark.slow
def test_a_given_momentum_is_kept_and_none_is_the_random_walk(moving: Path, capsys: Captured) -> None:
    z = read_recording(moving).channel("z")
    for text, momentum in (("0", 0.0), ("7.5", 7.5)):
        said, best = tuned(capsys, str(moving), "--momentum", text), estimate(z, momentum=momentum)
        assert (said["q"], said["r"], said["momentum"]) == (best.q, best.r, momentum)
    assert tuned(capsys, str(moving), "--momentum", "auto") == tuned(capsys, str(moving))


@pytest.mark.parametrize("options", [["--method", "em"], ["--ratio", "0.1"], ["--sigma", "1"]])
def test_what_knows_no_momentum_says_so(moving: Path, capsys: Captured, options: list[str]) -> None:
    assert run(["tune", str(moving), "--momentum", "5", *options]) != 0
    assert 'momentum must be "auto" or 0' in capsys.readouterr().err


# ---- JSON


@pytest.mark.slow
def test_estimators_without_momentum_are_named_so_also_where_momentum_finds_no_noise(
    tmp_path: Path, capsys: Captured
) -> None:
    path = tmp_path / "ramp.csv"
    path.write_text("time,a\n" + "".join(f"{i * 0.02:.2f},{i * 0.3:.1f}\n" for i in range(400)))
    assert run(["tune", str(path), "--details"]) == 0
    page = " ".join(capsys.readouterr().out.split())
    assert "also with momentum" in page
    assert "Compare estimators without momentum" in page
    assert "They need not agree here" in page


def test_json_says_what_the_library_says(log: Path, capsys: Captured) -> None:
    said = tuned(capsys, str(log))
    recording = read_recording(log)
    best = estimate(recording.channel("noisy"))
    assert best.params is not None
    assert (said["q"], said["r"], said["verdict"]) == (best.q, best.r, "ok")
    assert (said["channel"], said["unit"], said["sample_period"]) == ("noisy", "V", recording.sample_period)
    assert said["ratio_interval"] == list(best.ratio_interval)
    assert [one["method"] for one in said["opinions"]] == list(METHODS)
    assert said["opinions"][0]["gain"] == pytest.approx(said["steady"]["gain"])
    assert said["advice"]
    assert said["residuals"]["nis"] == pytest.approx(1.0)
    assert said["held_out"]["n"] == 250
    assert said["sha256"] == recording.sha256


@pytest.mark.slow
def test_json_of_an_edge_has_null_for_the_pair_and_inf_in_words(log: Path, capsys: Captured) -> None:
    said = tuned(capsys, str(log), "--channel", "smooth")
    assert [said[name] for name in ("q", "r", "ratio", "steady", "advice", "held_out")] == [None] * 6
    assert said["verdict"] == "no_noise"
    assert said["ratio_interval"][1] == "inf"
    assert said["opinions"][0]["ratio"] == "inf"


@pytest.mark.slow
def test_json_of_all_channels_is_one_object(log: Path, capsys: Captured) -> None:
    said = tuned(capsys, str(log), "--all")
    assert [(one["channel"], one["verdict"]) for one in said["channels"]] == [
        *(("noisy", "ok"), ("smooth", "no_noise"), ("stuck", "constant"))
    ]


@pytest.mark.slow
def test_a_filter_too_quick_for_a_cutoff_has_none(log: Path, capsys: Captured) -> None:
    assert tuned(capsys, str(log), "--gain", "0.95")["steady"]["cutoff_hz"] is None
    assert run(["tune", str(log), "--gain", "0.95", "--details"]) == 0
    assert "cut-off (−3 dB)  none" in capsys.readouterr().out


# ---- what the user knows and wishes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("option", "value", "field", "met"),
    [
        ("--lag-ms", "150", "lag_s", 0.15),
        ("--cutoff-hz", "3", "cutoff_hz", 3.0),
        ("--noise-reduction-db", "9", "noise_reduction_db", 9.0),
        ("--gain", "0.25", "gain", 0.25),
    ],
)
def test_a_wish_is_met_exactly(
    option: str, value: str, field: str, met: float, log: Path, capsys: Captured
) -> None:
    for channel in ("noisy", "smooth", "stuck"):
        said = tuned(capsys, str(log), option, value, "--channel", channel)
        assert said["steady"][field] == pytest.approx(met, rel=1e-9)
        assert said["verdict"] == "chosen"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("option", "value", "field", "met"),
    [("--lag-ms", "150", "lag_s", 0.15), ("--noise-reduction-db", "9", "noise_reduction_db", 9.0)],
)
@pytest.mark.parametrize("overshoot", ["8", "8%"])
def test_an_overshoot_is_met_together_with_the_lag_and_saved(
    option: str, value: str, field: str, met: float, overshoot: str, log: Path, tmp_path: Path, capsys: Captured
) -> None:
    path = tmp_path / "t.toml"
    asked = (str(log), option, value, "--overshoot", overshoot, "--channel", "noisy")
    said = tuned(capsys, *asked, "-o", str(path))
    assert said["steady"][field] == pytest.approx(met, rel=1e-9)
    assert said["steady"]["overshoot"] == pytest.approx(0.08, rel=1e-6)
    assert said["how"].endswith("and 8 % overshoot")
    saved = load_tuning(path).channel("noisy")
    assert (saved.q, saved.r, saved.momentum) == (said["q"], said["r"], said["momentum"])
    assert run(["tune", *asked, "--details"]) == 0
    out = capsys.readouterr().out
    assert "momentum           τ = " in out
    assert "overshoot (step) 8.0 %" in out
    assert "The best statistical fit would" not in out  # with momentum the record names no faster one


@pytest.mark.slow
def test_no_overshoot_is_the_filter_without_momentum(log: Path, capsys: Captured) -> None:
    asked = (str(log), "--lag-ms", "150", "--channel", "noisy")
    plain = tuned(capsys, *asked)
    allowed = tuned(capsys, *asked, "--overshoot", "0")
    judged, also = plain.pop("judgement"), allowed.pop("judgement")
    assert allowed == plain
    assert judged["headline"] == also["headline"]  # only the options to leave out differ
    assert plain["momentum"] == 0.0


def test_a_lag_is_met_at_a_given_momentum(log: Path, capsys: Captured) -> None:
    said = tuned(capsys, str(log), "--lag-ms", "150", "--momentum", "12", "--channel", "noisy")
    assert said["momentum"] == 12.0
    assert said["steady"]["lag_s"] == pytest.approx(0.15, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_the_method_is_the_one_asked_for(method: str, log: Path, capsys: Captured) -> None:
    said = tuned(capsys, str(log), "--method", method)
    best = estimate(read_recording(log).channel("noisy"), method)
    assert (said["q"], said["r"]) == (best.q, best.r)


@pytest.mark.slow
def test_what_is_known_of_the_noise_gives_r(log: Path, capsys: Captured) -> None:
    assert tuned(capsys, str(log), "--r", "1.5")["r"] == 1.5
    assert tuned(capsys, str(log), "--sigma", "1.5")["r"] == 2.25
    assert tuned(capsys, str(log), "--density", "0.1", "--bandwidth-hz", "50")["r"] == pytest.approx(0.5)
    assert tuned(capsys, str(log), "--ratio", "0.01", "--sigma", "2")["q"] == pytest.approx(0.04)
    assert tuned(capsys, str(log), "--ratio", "0.01")["ratio"] == pytest.approx(0.01)


@pytest.mark.slow
def test_a_still_stretch_is_given_in_the_time_of_the_recording(log: Path, bare: Path, capsys: Captured) -> None:
    z = read_recording(log).channel("noisy")
    expected = find_parameters(z, Request(noise=Noise(still=(0, 100)))).params
    assert expected is not None
    by_time = tuned(capsys, str(log), "--still", "10:10.995")
    by_sample = tuned(capsys, str(bare), "--still", "0:99")
    assert by_time["r"] == by_sample["r"] == expected.r
    assert by_time["how"] == "r from a still stretch, q by maximum likelihood"


@pytest.mark.slow
def test_a_still_stretch_is_found_where_the_recording_pauses(tmp_path: Path, capsys: Captured) -> None:
    moving = np.where((np.arange(1200) > 400) & (np.arange(1200) < 800), 0.0, 1.0)
    g = np.random.default_rng(0)
    values = np.cumsum(moving * g.normal(0, 1, 1200)) + g.normal(size=1200)
    path = tmp_path / "pause.csv"
    path.write_text("v\n" + "".join(f"{value:.4f}\n" for value in values))
    said = tuned(capsys, str(path), "--still", "auto")
    assert said["r"] == pytest.approx(1.0, rel=0.3)
    assert said["how"] == "r from a still stretch, q by maximum likelihood"
    assert "r is the variance of the still stretch, samples 4" in said["message"]
    assert run(["tune", "sample:nile", "--still", "auto"]) == 2
    assert "must show a still stretch" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["", "5", "x:y", "11:10", "10:10", "1:2:3", "nan:11", "0:9.5", "99:100"])
def test_a_still_stretch_must_lie_in_the_recording(text: str, log: Path, capsys: Captured) -> None:
    assert run(["tune", str(log), "--still", text]) == 2
    assert "--still must" in capsys.readouterr().err


def test_a_still_stretch_must_not_span_a_step_back_of_time(tmp_path: Path) -> None:
    path = tmp_path / "restarted.csv"
    path.write_text("time (s),v\n" + "".join(f"{i % 50},{i % 7}\n" for i in range(100)))
    with pytest.raises(KalscopeError, match="steps back"):
        still_samples(read_recording(path), "10:20")


# ---- the tuning file


@pytest.mark.slow
def test_the_tuning_file_filters_as_the_page_says(log: Path, tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "tuning.toml"
    said = tuned(capsys, str(log), "-o", str(path))
    tuning = load_tuning(path)
    (channel,) = tuning.channels
    assert (channel.q, channel.r, channel.how) == (said["q"], said["r"], "maximum likelihood")
    assert (channel.name, channel.unit, tuning.sample_period) == ("noisy", "V", said["sample_period"])
    assert (tuning.sha256, tuning.source) == (said["sha256"], str(log))
    assert run(["filter", str(log), "--config", str(path), "--channel", "noisy"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_channels_without_a_pair_are_left_out_and_said(log: Path, tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "tuning.toml"
    assert run(["tune", str(log), "--all", "-o", str(path)]) == 0
    assert [one.name for one in load_tuning(path).channels] == ["noisy"]
    err = capsys.readouterr().err
    assert err == (
        "kalscope: note: left out of the tuning: smooth: r → 0: no noise seen; stuck: all readings equal\n"
    )


@pytest.mark.slow
def test_channels_are_tuned_one_after_another_into_one_file(log: Path, tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "tuning.toml"
    assert run(["tune", str(log), "--channel", "smooth", "--lag-ms", "50", "-o", str(path)]) == 0
    assert run(["tune", str(log), "--channel", "noisy", "-o", str(path)]) == 0
    assert [one.name for one in load_tuning(path).channels] == ["noisy", "smooth"]
    assert "kept as they were in the tuning: smooth" in capsys.readouterr().err
    assert run(["tune", "demo", "-o", str(path)]) == 0
    assert [one.name for one in load_tuning(path).channels] == ["flex"]


@pytest.mark.parametrize(
    ("argv", "says"),
    [(["--channel", "smooth"], "give r (--still, --sigma) or choose"), (["--channel", "stuck"], "or choose")],
)
def test_an_edge_is_not_saved(argv: list[str], says: str, log: Path, tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "tuning.toml"
    assert run(["tune", str(log), *argv, "-o", str(path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert says in err
    assert not path.exists()


def test_the_recording_is_never_written_over(log: Path, capsys: Captured) -> None:
    before = log.read_bytes()
    assert run(["tune", str(log), "-o", str(log)]) == 2
    assert "must be a tuning file to be overwritten" in capsys.readouterr().err
    assert log.read_bytes() == before


# ---- errors


USER_ERRORS: list[tuple[list[str], str]] = [
    ([], "Missing argument 'SOURCE'"),
    (["missing.csv"], "missing.csv"),
    (["serial:COM3@9600"], "a board that streams"),
    (["demo", "--channel", "zz"], "channel must be one of flex (got 'zz')"),
    (["demo", "--channel", "flex", "--all"], "--all must be used without --channel"),
    (["demo", "--method", "magic"], "method must be one of ml"),
    (["demo", "--lag-ms", "x"], "--lag-ms must be a number above 0 (got 'x')"),
    (["demo", "--lag-ms", "-5"], "--lag-ms must be a number above 0 (got '-5')"),
    (["demo", "--r", "0"], "--r must be a number above 0"),
    (["demo", "--sigma", "nan"], "--sigma must be a number above 0"),
    (["demo", "--ratio", "inf"], "--ratio must be a number above 0"),
    (["demo", "--sample-period", "0"], "--sample-period must be a number above 0"),
    (["demo", "--gain", "1"], "gain must lie between 0 and 1"),
    (["demo", "--cutoff-hz", "26"], "at most half the sample rate, 25 Hz"),
    (["demo", "--lag-ms", "5", "--gain", "0.1"], "can decide q/r (got --lag-ms and --gain)"),
    (["demo", "--ratio", "1", "--gain", "0.1"], "can decide q/r (got --gain and --ratio)"),
    (["demo", "--r", "1", "--sigma", "1"], "can give r (got --sigma and --r)"),
    (["demo", "--r", "1", "--still", "0:1"], "can give r (got --still and --r)"),
    (["demo", "--density", "1"], "given together (got only --density)"),
    (["demo", "--bandwidth-hz", "1"], "given together (got only --bandwidth-hz)"),
    (["demo", "--method", "em", "--r", "1"], "--method em must be used without --r"),
    (["demo", "--still", "0:0.1"], "still stretch must hold at least 8 samples"),
    (["demo", "--still", "1-2"], "--still must be FROM:TO"),
    (
        ["demo", "--overshoot", "5"],
        "--overshoot needs one of --lag-ms, --cutoff-hz, --noise-reduction-db, --gain (got",
    ),
    (["demo", "--overshoot", "5", "--ratio", "1"], "--overshoot needs one of --lag-ms"),
    (
        ["demo", "--overshoot", "x", "--gain", "0.1"],
        "--overshoot must be a percentage of at least 0 and below 100 (got 'x')",
    ),
    (
        ["demo", "--overshoot", "-1", "--gain", "0.1"],
        "--overshoot must be a percentage of at least 0 and below 100 (got '-1')",
    ),
    (["demo", "--overshoot", "nan", "--gain", "0.1"], "--overshoot must be a percentage"),
    (["demo", "--overshoot", "100", "--gain", "0.1"], "--overshoot must be a percentage"),
    (
        ["demo", "--overshoot", "30", "--lag-ms", "90"],
        "overshoot must be at most 20.56 % of a step with this target",
    ),
    (
        ["demo", "--overshoot", "5", "--lag-ms", "90", "--momentum", "9"],
        "overshoot needs a target such as a lag, and",
    ),
    (["demo", "-o", "missing/t.toml"], "'missing/t.toml': No such file or directory"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("argv", "says"), USER_ERRORS)
def test_every_user_error_is_status_2_and_one_line_on_stderr(
    argv: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["tune", *argv]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("kalscope: ")
    assert len(err.splitlines()) == 1
    assert says in err
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("option", ["--lag-ms", "--cutoff-hz"])
def test_a_wish_in_time_needs_time(option: str, bare: Path, capsys: Captured) -> None:
    assert run(["tune", str(bare), option, "5"]) == 2
    assert f"{option} needs the time between two samples: give --sample-period" in capsys.readouterr().err


# ---- a long search


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_long_search_shows_one_line_that_disappears(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(console.time, "monotonic", lambda: now)
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with progress_line() as whole:
        report = Progress(whole).part(0.5, 1.0)
        report(0.0, "too early")
        assert terminal.getvalue() == ""
        now = 1.5
        report(0.5, "b: EM pass 10")
        assert terminal.getvalue() == "\r 75% b: EM pass 10"
        report(0.6, "too soon after it")
        now = 2.0
        report(0.9, "done")
    assert "too soon" not in terminal.getvalue()
    assert terminal.getvalue().endswith(f"\r{' ' * 18}\r")
    assert "\n" not in terminal.getvalue()


def test_a_short_search_and_a_pipe_show_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal, pipe = Terminal(), io.StringIO()
    monkeypatch.setattr(sys, "stderr", terminal)
    with progress_line() as report:
        report(0.5, "quick")
    now = 0.0
    monkeypatch.setattr(console.time, "monotonic", lambda: now)
    monkeypatch.setattr(sys, "stderr", pipe)
    with progress_line() as report:
        now = 9.0
        report(0.5, "slow")
    assert terminal.getvalue() == pipe.getvalue() == ""


def test_a_terminal_shows_what_is_compiled_at_the_first_start(monkeypatch: pytest.MonkeyPatch) -> None:
    watching: list[Callable[[Compiling], None]] = []
    monkeypatch.setattr(compiled, "watch_compiling", watching.append)
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    console.tell_compiling()
    assert watching == []
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    console.tell_compiling()
    (show,) = watching
    for done in range(2):
        show(Compiling(done, is_busy=True))
        show(Compiling(done + 1, is_busy=False))
    shown = [line.strip() for line in terminal.getvalue().split("\r") if line.strip()]
    beginning = "compiling for this computer, only at the first start: "
    assert shown == [f"{beginning}0 done", f"{beginning}1 done"]
    assert terminal.getvalue().endswith(" \r")


def test_the_line_disappears_when_the_search_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "PROGRESS_DELAY_S", 0.0)
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)

    def fail() -> None:
        with progress_line() as report:
            report(0.5, "working")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert terminal.getvalue().endswith(" \r")


def test_ctrl_c_is_status_130_and_says_nothing(monkeypatch: pytest.MonkeyPatch, capsys: Captured) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("kalscope.cli.tune_answer.compare_methods", interrupted)
    assert run(["tune", "demo"]) == 130
    out, err = capsys.readouterr()
    assert (out, err) == ("", "")


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_ctrl_c_ends_the_program_in_the_middle_of_a_search() -> None:
    change = (
        "import os, signal; from kalscope.cli import tune_answer as answer\n"
        "answer.compare_methods = lambda *a, **k: os.kill(os.getpid(), signal.SIGINT)\n"
    )
    with command("tune", "demo", change=change) as program:
        said = program.communicate(timeout=PATIENCE)
        assert (program.returncode, *said) == (
            130,
            "",
            "kalscope: stopped by Ctrl+C: no file is left half-written\n",
        )


def test_a_reader_that_leaves_is_no_error() -> None:
    with command("tune", "demo") as program:
        program.stdout.close()
        assert program.stderr.read() == ""
        assert program.wait(PATIENCE) == 0


def test_help_answers_at_once() -> None:
    probe = (
        "import sys; from kalscope.cli.app import run; run(['tune', '--help'])\n"
        "heavy = 'kalscope.estimation.request', 'kalscope.cli.tune_answer', 'scipy.stats'\n"
        "print([n for n in heavy if n in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    *page, heavy = done.stdout.splitlines()
    assert any("--noise-reduction-db" in line for line in page)
    assert heavy == "[]"


# ---- the world


REAL = (
    "co2_weekly/co2.csv",  # samples are missing
    "flex_arm/flex_sensor_data.csv",
    "field_logs/labview_two_times.lvm",  # three samples
    "basic_motions/BasicMotions_TRAIN.ts",  # no table
)
"""tests/estimation/test_real_recordings.py asks for every channel of every file."""


@pytest.mark.slow
@pytest.mark.skipif(not SHARED_DATA.is_dir(), reason="the folder of real recordings is absent")
@pytest.mark.parametrize("name", REAL)
def test_a_real_recording_gets_an_estimate_or_a_verdict_in_words(name: str, capsys: Captured) -> None:
    path = SHARED_DATA / name
    try:
        recording = open_source(str(path))
    except KalscopeError:
        assert run(["tune", str(path)]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
        return
    channel = recording.names[len(recording.names) // 2]
    said = tuned(capsys, str(path), "--channel", channel)
    assert said["message"].endswith(".")
    if said["q"] is None:
        assert said["verdict"] in ("no_noise", "no_movement", "too_few", "constant", "bad_unit")
        assert said["r"] is None
    else:
        assert said["q"] > 0.0
        assert said["r"] > 0.0
        assert said["judgement"]["headline"].endswith(".")


@pytest.mark.slow
def test_the_options_of_reading_reach_the_estimate(tmp_path, capsys):
    rng = np.random.default_rng(11)
    time = np.cumsum(np.where(rng.random(400) < 0.1, 25.0, 1.0))  # long gaps, in which the level wanders on
    level = np.cumsum(rng.normal(size=400) * np.sqrt(np.diff(time, prepend=0.0)))
    file = tmp_path / "gaps.csv"
    rows = zip(time, level + rng.normal(size=400), strict=True)
    file.write_text("t;z\n" + "".join(f"{t:.1f};{z:.6f}\n" for t, z in rows) + "500.0;-200\n")

    def q_of(*options):
        assert run(["tune", str(file), "--json", *options]) == 0
        return json.loads(capsys.readouterr().out)["q"]

    plain, elapsed = q_of("--missing=-200"), q_of("--missing=-200", "--gaps", "dt")
    assert 0.6 < elapsed < 1.6  # the truth is 1 a second
    assert plain > 2 * elapsed
    assert run(["tune", str(file), "--delimiter", "nope"]) == 2
    assert "delimiter must be" in capsys.readouterr().err


@pytest.mark.slow
def test_a_counter_is_not_tuned_unless_it_is_asked_for(log: Path, capsys: Captured) -> None:
    header, *rows = log.read_text().splitlines()
    log.write_text("\n".join([f"seq,{header}", *(f"{i},{row}" for i, row in enumerate(rows)), ""]))
    assert tuned(capsys, str(log))["channel"] == "noisy"
    assert tuned(capsys, str(log), "--channel", "seq")["channel"] == "seq"
    assert run(["tune", str(log)]) == 0
    assert (
        "Other channels (--channel, --all): seq (a counter), smooth, stuck (constant)\n" in capsys.readouterr().out
    )


@pytest.mark.slow
def test_how_the_file_was_read_comes_first_and_whole_in_json(log: Path, capsys: Captured) -> None:
    header, *rows = log.read_text().splitlines()
    log.write_text("\n".join([header, *rows[:300], *["battery low"] * 40, *rows[300:], ""]))
    assert run(["tune", str(log), "--delimiter", "comma"]) == 0
    first, read_as, warning, *_ = capsys.readouterr().out.splitlines()
    assert first.startswith("log.csv: 500 rows, 3 channels, 100 Hz")
    assert first.endswith("40 lines rejected: another number of fields")
    assert warning.startswith("Warning: 7.4 % of the lines were rejected, the first is line 302")
    reading = tuned(capsys, str(log), "--delimiter", "comma")["reading"]
    assert read_as == f"Read as {reading['read_as']}."
    assert (reading["rejected"], reading["options"]) == (40, ["--delimiter", "comma"])
    assert (reading["issues"][0]["text"], len(reading["warnings"])) == ("battery low", 1)


def test_a_reading_that_failed_is_named_before_a_sensor_that_is_stuck(lost: Path, capsys: Captured) -> None:
    assert run(["tune", str(lost)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("lost.csv: 60 rows, 1 channel, 1.00 Hz; 257 lines rejected: another number of fields\n")
    assert out.index("81 % of the lines were rejected") < out.index("Next: fix how the file is read first")
    assert run(["tune", str(lost), "-o", str(lost.with_name("t.toml"))]) == 2
    assert "kalscope: 81 % of the lines were rejected, the first is line 62" in capsys.readouterr().err


@pytest.mark.parametrize("size", [*(f"1e{power}" for power in (-300, -30, -9, -3, 4, 12, 30, 300)), "0.9999"])
@pytest.mark.parametrize("option", ["--lag-ms", "--cutoff-hz", "--noise-reduction-db", "--gain", "--ratio"])
def test_a_goal_that_no_filter_of_the_record_can_meet_is_refused_in_words(
    option: str, size: str, capsys: Captured
) -> None:
    """Slower than the record, or too fast to change a sample; no text holds a number without meaning."""
    status = run(["tune", "demo", option, size, "--details"])
    out, err = capsys.readouterr()
    assert status or size in ("1e-3", "1e4", "0.9999")
    if status:
        assert len(err.splitlines()) <= 2
        assert " must " in err
    assert not re.search(r"\d+e[+-]?\d+ (µs|s|h|days|years)\b|∞ dB|\binf\b|\bnan\b|1\.00e12", out + err)
