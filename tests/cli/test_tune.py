from __future__ import annotations

import io
import json
import math
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.support.program import command
from tests.support.waiting import PATIENCE

from kalscope import kalman_filter
from kalscope.cli import console
from kalscope.cli.app import run
from kalscope.cli.console import progress_line
from kalscope.cli.tune_options import still_samples
from kalscope.common import compiled
from kalscope.common.compiled import Compiling
from kalscope.common.progress import Progress
from kalscope.errors import KalscopeError
from kalscope.estimation.fit import estimate
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.sources.reading.recording_file import read_recording
from kalscope.tuning.file import load_tuning

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
    assert said["outliers"] == [19, 39, 59, 79]
    assert said["gate"] == 16.0
    assert (said["plain_q"], said["plain_r"], kept["outliers"]) == (kept["q"], kept["r"], None)
    assert kept["r"] > 100.0 * said["r"]
    assert run(["tune", str(bare), "--robust"]) == 0
    out = capsys.readouterr().out
    assert ", gate 4 σ, 4 spikes set aside\n" in out
    assert "--no-robust keeps spikes" in " ".join(out.split())  # heartbeats look like spikes


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
def test_the_answer_stands_in_a_few_lines(words: str, log: Path, bare: Path, lost: Path, capsys: Captured) -> None:
    argv = words.format(log=log, bare=bare, lost=lost).split()
    assert run(["tune", *argv]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    first, *rest = (line for line in out.splitlines() if not line.startswith("Assumed: "))
    assert " rows, " in first  # how it was read
    assert rest.pop(0).startswith("Read as ")
    assert 3 <= len(rest) <= 9
    assert max(len(line) for line in rest if not line.startswith("Warning: ")) <= 96
    said, page = tuned(capsys, *argv), " ".join(rest)
    assert f"{said['channel']}: q = " in page
    assert (said["message"] if said["reason"] == "constant" else said["judgement"]["headline"]) in page
    assert "Next" in page or said["advice"]
    for one in said["advice"]:
        how = f", {'' if one['option'].startswith('without') else 'with '}{one['option']}" if one["option"] else ""
        is_note = one["action"] == "NoneType" and not one["text"].startswith("keep this filter")
        advice = f"{'Note' if is_note else 'Next'}{how}: {one['text']}"
        assert advice[:80].casefold() in page.casefold()


@pytest.fixture
def lost(tmp_path: Path) -> Path:
    """A log whose sensor is lost for most of it, and stuck before."""
    rows = [f"{i},21.0" if i < 60 else "sensor lost" for i in range(317)]
    path = tmp_path / "lost.csv"
    path.write_text("\n".join(["t,temp", *rows, ""]))
    return path


# ---- JSON


def test_json_says_what_the_library_says_and_the_file_holds_it(log: Path, tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "tuning.toml"
    said = tuned(capsys, str(log), "-o", str(path))
    recording = read_recording(log)
    best = estimate(recording.channel("noisy"))
    assert best.params is not None
    assert (said["q"], said["r"], said["verdict"]) == (best.q, best.r, "ok")
    assert (said["channel"], said["unit"], said["sample_period"]) == ("noisy", "V", recording.sample_period)
    assert said["ratio_interval"] == list(best.ratio_interval)
    assert said["judgement"]["residuals"]["nis"] == pytest.approx(1.0)
    assert said["judgement"]["held_out"]["n"] == 250
    assert said["sha256"] == recording.sha256
    tuning = load_tuning(path)
    (channel,) = tuning.channels
    assert (channel.q, channel.r, channel.how) == (said["q"], said["r"], "maximum likelihood")
    assert (channel.name, channel.unit, tuning.sample_period) == ("noisy", "V", said["sample_period"])
    assert (tuning.sha256, tuning.source) == (said["sha256"], str(log))


@pytest.mark.slow
def test_json_of_an_edge_has_a_filter_all_the_same_its_reason_and_inf_in_words(log: Path, capsys: Captured) -> None:
    said = tuned(capsys, str(log), "--channel", "smooth")
    assert min(said[name] for name in ("q", "r", "ratio")) > 0.0
    assert (said["verdict"], said["reason"]) == ("no_noise", "medium")
    assert [one["name"] for one in said["costs"] if one["name"]] == ["light", "medium", "strong"]
    assert said["ratio_interval"][1] == "inf"
    (option,) = (one["option"] for one in said["advice"] if one["action"] == "ChooseFilter")
    stronger = tuned(capsys, str(log), "--channel", "smooth", *option.split())
    assert stronger["steady"]["lag_samples"] > 1.1 * said["steady"]["lag_samples"]


# ---- what the user knows and wishes


@pytest.mark.slow
@pytest.mark.parametrize("wish", ["lag-ms 150 lag_s 0.15", "cutoff-hz 3 cutoff_hz 3", "gain 0.25 gain 0.25"])
def test_a_wish_is_met_exactly(wish: str, log: Path, capsys: Captured) -> None:
    option, value, field, met = wish.split()
    for channel in ("noisy", "smooth", "stuck"):
        said = tuned(capsys, str(log), f"--{option}", value, "--channel", channel)
        assert said["steady"][field] == pytest.approx(float(met), rel=1e-9)
        assert said["verdict"] == "chosen"


@pytest.mark.slow
def test_an_overshoot_is_met_together_with_the_lag_and_saved(log: Path, tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "t.toml"
    asked = (str(log), "--lag-ms", "150", "--overshoot", "8%", "--channel", "noisy")
    said = tuned(capsys, *asked, "-o", str(path))
    assert said["steady"]["lag_s"] == pytest.approx(0.15, rel=1e-9)
    assert said["steady"]["overshoot"] == pytest.approx(0.08, rel=1e-6)
    assert said["how"].endswith("and 8 % overshoot")
    saved = load_tuning(path).channel("noisy")
    assert (saved.q, saved.r, saved.momentum) == (said["q"], said["r"], said["momentum"])
    assert run(["tune", *asked, "--details"]) == 0
    assert "overshoot (step)  8.0 %" in capsys.readouterr().out


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
def test_channels_without_a_signal_are_left_out_and_said(log: Path, tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "tuning.toml"
    assert run(["tune", str(log), "--all", "-o", str(path)]) == 0
    assert [one.name for one in load_tuning(path).channels] == ["noisy", "smooth"]
    err = capsys.readouterr().err
    assert err == "kalscope: note: left out of the tuning: stuck: constant\n"
    assert run(["tune", str(log), "--channel", "stuck", "-o", str(tmp_path / "none.toml")]) == 2
    assert "give r (--still, --sigma), record while it moves, or choose" in capsys.readouterr().err
    assert not (tmp_path / "none.toml").exists()


# ---- errors


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


def test_a_terminal_shows_what_is_compiled_at_the_first_start(monkeypatch):
    watching, terminal = [], Terminal()
    monkeypatch.setattr(compiled, "watch_compiling", watching.append)
    monkeypatch.setattr(sys, "stderr", terminal)
    console.report_compiling()
    for busy in (True, False):
        watching[0](Compiling(0, is_busy=busy))
    assert "compiling for this computer, only at the first start: 0 done" in terminal.getvalue()


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_ctrl_c_ends_the_program_in_the_middle_of_a_search() -> None:
    change = (
        "import os, signal; from kalscope.cli import tune_answer as answer\n"
        "answer.find_parameters = lambda *a, **k: os.kill(os.getpid(), signal.SIGINT)\n"
    )
    with command("tune", "demo", change=change) as program:
        said = program.communicate(timeout=PATIENCE)
        assert (program.returncode, *said) == (
            130,
            "",
            "kalscope: stopped by Ctrl+C: no file is left half-written\n",
        )


# ---- the world


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
    assert first.endswith("40 lines rejected: must have 4 fields")
    assert warning.startswith("Warning: 7.4 % of the lines were rejected, the first is line 302")
    reading = tuned(capsys, str(log), "--delimiter", "comma")["reading"]
    assert read_as == f"Read as {reading['read_as']}."
    assert (reading["rejected"], reading["options"]) == (40, ["--delimiter", "comma"])
    assert (reading["issues"][0]["text"], len(reading["warnings"])) == ("battery low", 1)


def test_a_reading_that_failed_is_named_before_a_sensor_that_is_stuck(lost: Path, capsys: Captured) -> None:
    assert run(["tune", str(lost)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("lost.csv: 60 rows, 1 channel, 1.00 Hz; 257 lines rejected: must have 2 fields\n")
    assert out.index("81 % of the lines were rejected") < out.index("Next: fix how the file is read first")
    assert run(["tune", str(lost), "-o", str(lost.with_name("t.toml"))]) == 2
    assert "kalscope: 81 % of the lines were rejected, the first is line 62" in capsys.readouterr().err


@pytest.mark.parametrize("size", [*(f"1e{power}" for power in (-300, -30, -9, -3, 4, 12, 30, 300)), "0.9999"])
@pytest.mark.parametrize("option", ["--lag-ms", "--cutoff-hz", "--noise-reduction-db", "--gain", "--ratio"])
def test_a_goal_that_no_filter_of_the_record_can_meet_is_refused_in_words(option, size, capsys):
    """Slower than the record, or too fast to change a sample; no text holds a number without meaning."""
    status = run(["tune", "demo", option, size, "--details"])
    out, err = capsys.readouterr()
    assert status or size in ("1e-3", "1e4", "0.9999")
    if status:
        assert len(err.splitlines()) <= 2
        assert " must " in err
    assert not re.search(r"\d+e[+-]?\d+ (µs|s|h|days|years)\b|∞ dB|\binf\b|\bnan\b|1\.00e12", out + err)


def test_two_speeds_are_advised_for_steps_and_filter_as_saved(tmp_path: Path, capsys: Captured) -> None:
    rng = np.random.default_rng(3)
    z = np.cumsum((rng.random(1500) < 0.006) * rng.normal(size=1500) * 15) + rng.normal(size=1500)
    path, saved = tmp_path / "steps.csv", tmp_path / "steps.toml"
    path.write_text(
        "\n".join(["time,level", *(f"{i / 100:.2f},{each!r}" for i, each in enumerate(z.tolist())), ""])
    )
    assert run(["tune", str(path)]) == 0
    assert "Next, with --two-speeds: the signal rests and moves" in capsys.readouterr().out
    assert run(["tune", str(path), "--two-speeds", "-o", str(saved)]) == 0
    page = capsys.readouterr().out
    assert re.search(r"at rest lag .* s \(.* samples\), noise −.* dB; moving lag .*, noise −.* dB", page)
    assert "Two speeds explain this record clearly better than one." in page
    (one,) = load_tuning(saved).channels
    assert one.fast is not None
    assert one.fast > 100.0
    assert saved.read_text().splitlines()[1] == "format = 5"
    assert run(["filter", str(path), "--config", str(saved)]) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert head == "time,level,level_filtered,level_variance,level_moving"
    result = kalman_filter(z, one.params)
    assert [float(row.split(",")[2]) for row in rows] == result.x.tolist()
    assert [float(row.split(",")[4]) for row in rows] == result.moving.tolist()  # type: ignore[union-attr]
    for other in (["--lag-ms", "50"], ["--r", "1"], ["--momentum", "3"]):
        assert run(["tune", str(path), "--two-speeds", *other]) == 2
        assert "two speeds are found with q and r" in capsys.readouterr().err


def test_two_speeds_are_not_chosen_for_what_one_describes(log: Path, bare: Path, capsys: Captured) -> None:
    for path in (log, bare):
        assert tuned(capsys, str(path), "--two-speeds")["fast"] is None


def test_stdin_is_read_to_its_end_as_a_file(log: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tuned(capsys, str(log), "--lag-ms", "50")
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(log.read_bytes())))
    piped = tuned(capsys, "-", "--lag-ms", "50")
    assert piped.pop("source") == "-"
    assert piped == {name: value for name, value in file.items() if name != "source"}
