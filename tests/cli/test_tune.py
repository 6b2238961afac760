"""`kalscope tune` of one channel: the page, the JSON, what is known and wished, the file, and refusals."""

from __future__ import annotations

import io
import json
import math
import re
import sys

import numpy as np
import pytest

from kalscope import kalman_filter
from kalscope.cli import console
from kalscope.cli.app import run
from kalscope.common import compiled
from kalscope.common.compiled import Compiling
from kalscope.common.progress import Progress
from kalscope.estimation.fit import estimate
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.sources.reading.recording_file import read_recording
from kalscope.tuning.file import load_tuning


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder.

    log.csv has three channels at 100 Hz: a random walk under noise, constant for 1 s, a smooth one and a constant;
    bare.csv the first without time; lost.csv a sensor that is stuck and then lost.
    """
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    steps = rng.normal(scale=0.3, size=500)
    steps[:100] = 0.0
    noisy = (np.cumsum(steps) + rng.normal(size=500)).tolist()
    rows = [f"{10 + i / 100:.2f},{z!r},{math.sin(i / 40)!r},7" for i, z in enumerate(noisy)]
    lost = [f"{i},21.0" if i < 60 else "sensor lost" for i in range(317)]
    for name, lines in (
        ("log.csv", ["time (s),noisy (V),smooth,stuck", *rows]),
        ("bare.csv", ["noisy", *map(repr, noisy)]),
        ("lost.csv", ["t,temp", *lost]),
    ):
        (tmp_path / name).write_text("\n".join([*lines, ""]))
    return tmp_path


def printed(capsys, *argv):
    assert run(["tune", *argv]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return out


def page(capsys, *argv):
    """What it prints, in lines that fit; those on how the file was read may be wider."""
    text = printed(capsys, *argv)
    assert max(len(line) for line in text.splitlines()[2:] if not line.startswith(("Assumed: ", "Warning: "))) <= 96
    return text


def tuned(capsys, *argv):
    """Its JSON; NaN and Infinity, which JSON has not, are refused."""
    return json.loads(printed(capsys, *argv, "--json"), parse_constant=pytest.fail)


@pytest.mark.slow
def test_spikes_are_set_aside_counted_and_gated(folder, capsys):
    lines = (folder / "bare.csv").read_text().splitlines()
    lines[20:90:20] = ["1000"] * 4
    (folder / "bare.csv").write_text("\n".join([*lines, ""]))
    answer, kept = tuned(capsys, "bare.csv"), tuned(capsys, "bare.csv", "--no-robust")
    assert (answer["outliers"], answer["gate"]) == ([19, 39, 59, 79], 16.0)
    assert (answer["plain_q"], answer["plain_r"], kept["outliers"]) == (kept["q"], kept["r"], None)
    assert kept["r"] > 100.0 * answer["r"]
    text = page(capsys, "bare.csv", "--robust")
    assert ", gate 4 σ, 4 spikes set aside\n" in text
    assert "--no-robust keeps spikes" in " ".join(text.split())  # heartbeats look like spikes


@pytest.mark.slow
def test_json_has_what_the_library_finds_and_the_file_holds_it(folder, capsys):
    answer = tuned(capsys, "log.csv", "-o", "tuning.toml")
    recording = read_recording("log.csv")
    best = estimate(recording.channel("noisy"))
    assert (answer["q"], answer["r"], answer["verdict"]) == (best.q, best.r, "ok")
    assert (answer["channel"], answer["unit"], answer["sample_period"]) == ("noisy", "V", recording.sample_period)
    assert answer["ratio_interval"] == list(best.ratio_interval)
    assert answer["judgement"]["residuals"]["nis"] == pytest.approx(1.0)
    assert answer["judgement"]["held_out"]["n"] == 250
    assert answer["sha256"] == recording.sha256
    tuning = load_tuning("tuning.toml")
    (channel,) = tuning.channels
    assert (channel.q, channel.r, channel.how) == (answer["q"], answer["r"], "maximum likelihood")
    assert (channel.name, channel.unit, tuning.sample_period) == ("noisy", "V", answer["sample_period"])
    assert (tuning.sha256, tuning.source) == (answer["sha256"], str(folder / "log.csv"))


@pytest.mark.slow
def test_a_channel_without_noise_has_a_filter_all_the_same_its_reason_and_inf_in_words(capsys):
    answer = tuned(capsys, "log.csv", "--channel", "smooth")
    assert min(answer[name] for name in ("q", "r", "ratio")) > 0.0
    assert (answer["verdict"], answer["reason"]) == ("no_noise", "medium")
    assert [one["name"] for one in answer["costs"] if one["name"]] == ["light", "medium", "strong"]
    assert answer["ratio_interval"][1] == "inf"
    (option,) = (one["option"] for one in answer["advice"] if one["action"] == "ChooseFilter")
    stronger = tuned(capsys, "log.csv", "--channel", "smooth", *option.split())
    assert stronger["steady"]["lag_samples"] > 1.1 * answer["steady"]["lag_samples"]


# ---- what the user knows and wishes


@pytest.mark.slow
@pytest.mark.parametrize("wish", ["lag-ms 150 lag_s 0.15", "cutoff-hz 3 cutoff_hz 3", "gain 0.25 gain 0.25"])
def test_a_wish_is_met_exactly(wish, capsys):
    option, value, field, met = wish.split()
    for channel in ("noisy", "stuck"):
        answer = tuned(capsys, "log.csv", f"--{option}", value, "--channel", channel)
        assert answer["steady"][field] == pytest.approx(float(met), rel=1e-9)
        assert answer["verdict"] == "chosen"


@pytest.mark.slow
def test_an_overshoot_is_met_together_with_the_lag_and_saved(capsys):
    wish = ("log.csv", "--lag-ms", "150", "--overshoot", "8%", "--channel", "noisy")
    answer = tuned(capsys, *wish, "-o", "t.toml")
    assert answer["steady"]["lag_s"] == pytest.approx(0.15, rel=1e-9)
    assert answer["steady"]["overshoot"] == pytest.approx(0.08, rel=1e-6)
    assert answer["how"].endswith("and 8 % overshoot")
    saved = load_tuning("t.toml").channel("noisy")
    assert (saved.q, saved.r, saved.momentum) == (answer["q"], answer["r"], answer["momentum"])
    assert "overshoot (step)  8.0 %" in page(capsys, *wish, "--details")


@pytest.mark.slow
def test_what_is_known_of_the_noise_gives_r(capsys):
    assert tuned(capsys, "log.csv", "--r", "1.5")["r"] == 1.5
    assert tuned(capsys, "log.csv", "--sigma", "1.5")["r"] == 2.25
    assert tuned(capsys, "log.csv", "--density", "0.1", "--bandwidth-hz", "50")["r"] == pytest.approx(0.5)
    assert tuned(capsys, "log.csv", "--ratio", "0.01", "--sigma", "2")["q"] == pytest.approx(0.04)
    assert tuned(capsys, "log.csv", "--ratio", "0.01")["ratio"] == pytest.approx(0.01)


@pytest.mark.slow
def test_a_still_stretch_is_given_in_the_time_of_the_recording(capsys):
    z = read_recording("log.csv").channel("noisy")
    by_time = tuned(capsys, "log.csv", "--still", "10:10.995")
    by_sample = tuned(capsys, "bare.csv", "--still", "0:99")
    assert by_time["r"] == by_sample["r"] == find_parameters(z, Request(noise=Noise(still=(0, 100)))).params.r
    assert by_time["how"] == "r from a still stretch, q by maximum likelihood"


@pytest.mark.slow
@pytest.mark.parametrize("option", ["--lag-ms", "--cutoff-hz", "--noise-reduction-db", "--gain", "--ratio"])
def test_a_goal_that_no_filter_of_the_record_can_meet_is_refused_in_words(option, capsys):
    """Slower than the record, or too fast to change a sample; no text holds a number without meaning."""
    for size in ("1e-300", "1e-9", "1e-3", "0.9999", "1e4", "1e12", "1e300"):
        status = run(["tune", "demo", option, size, "--details"])
        out, err = capsys.readouterr()
        assert status or size in ("1e-3", "1e4", "0.9999")
        assert not status or (" must " in err and len(err.splitlines()) <= 2)
        assert not re.search(r"\d+e[+-]?\d+ (µs|s|h|days|years)\b|∞ dB|\binf\b|\bnan\b|1\.00e12", out + err)


@pytest.mark.slow
def test_two_speeds_are_advised_for_steps_only_and_filter_as_saved(folder, capsys):
    rng = np.random.default_rng(3)
    z = np.cumsum((rng.random(1500) < 0.006) * rng.normal(size=1500) * 15) + rng.normal(size=1500)
    rows = (f"{i / 100:.2f},{each!r}\n" for i, each in enumerate(z.tolist()))
    (folder / "steps.csv").write_text("time,level\n" + "".join(rows))
    assert "Next, with --two-speeds: the signal rests and moves" in page(capsys, "steps.csv")
    text = page(capsys, "steps.csv", "--two-speeds", "-o", "steps.toml")
    assert re.search(
        r"at rest lag .* s \(.* samples\), noise left .* dB\); moving lag .*, noise left\s.* dB\)", text
    )
    assert "Two speeds explain this record clearly better than one." in text
    (one,) = load_tuning("steps.toml").channels
    assert one.fast > 100.0
    assert (folder / "steps.toml").read_text().splitlines()[1] == "format = 5"
    assert run(["filter", "steps.csv", "--config", "steps.toml"]) == 0
    table = np.genfromtxt(io.StringIO(capsys.readouterr().out), delimiter=",", names=True)
    assert table.dtype.names == ("time", "level", "level_filtered", "level_variance", "level_moving")
    result = kalman_filter(z, one.params)
    np.testing.assert_array_equal(table["level_filtered"], result.x)
    np.testing.assert_array_equal(table["level_moving"], result.moving)
    assert tuned(capsys, "log.csv", "--two-speeds")["fast"] is None  # one describes it


# ---- how it was read, and what is left out


@pytest.mark.slow
def test_channels_without_a_signal_are_left_out_of_the_tuning_and_named(folder, capsys):
    assert run(["tune", "log.csv", "--all", "-o", "tuning.toml"]) == 0
    assert [one.name for one in load_tuning("tuning.toml").channels] == ["noisy", "smooth"]
    assert capsys.readouterr().err == "kalscope: note: left out of the tuning: stuck: constant\n"
    assert run(["tune", "log.csv", "--channel", "stuck", "-o", "none.toml"]) == 2
    assert "give r (--still, --sigma), record while it moves, or choose" in capsys.readouterr().err
    assert not (folder / "none.toml").exists()


@pytest.mark.slow
def test_a_counter_is_not_tuned_unless_it_is_asked_for(folder, capsys):
    header, *rows = (folder / "log.csv").read_text().splitlines()
    rows = (f"{i},{row}" for i, row in enumerate(rows))
    (folder / "log.csv").write_text("\n".join([f"seq,{header}", *rows, ""]))
    text = page(capsys, "log.csv")
    assert "\nnoisy: q = " in text
    assert "Other channels (--channel, --all): seq (a counter), smooth, stuck (constant)\n" in text
    assert "\nseq: q = " in page(capsys, "log.csv", "--channel", "seq")


@pytest.mark.slow
def test_how_the_file_was_read_comes_first_and_whole_in_json(folder, capsys):
    header, *rows = (folder / "log.csv").read_text().splitlines()
    lines = [header, *rows[:300], *["battery low"] * 40, *rows[300:], ""]
    (folder / "log.csv").write_text("\n".join(lines))
    first, read_as, warning, *_ = page(capsys, "log.csv", "--delimiter", "comma").splitlines()
    assert first.startswith("log.csv: 500 rows, 3 channels, 100 Hz")
    assert first.endswith("40 lines rejected: must have 4 fields")
    assert warning.startswith("Warning: 7.4 % of the lines were rejected, the first is line 302")
    reading = tuned(capsys, "log.csv", "--delimiter", "comma")["reading"]
    assert read_as == f"Read as {reading['read_as']}."
    assert (reading["rejected"], reading["options"]) == (40, ["--delimiter", "comma"])
    assert (reading["issues"][0]["text"], len(reading["warnings"])) == ("battery low", 1)


@pytest.mark.slow
def test_a_reading_that_failed_is_named_before_a_sensor_that_is_stuck(capsys):
    text = page(capsys, "lost.csv")
    assert text.startswith("lost.csv: 60 rows, 1 channel, 1.00 Hz; 257 lines rejected: must have 2 fields\n")
    assert text.index("81 % of the lines were rejected") < text.index("Next: fix how the file is read first")
    assert run(["tune", "lost.csv", "-o", "t.toml"]) == 2
    assert "kalscope: 81 % of the lines were rejected, the first is line 62" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # as main() has it
def test_the_largest_numbers_get_an_answer_in_words(folder, capsys):
    (folder / "log.csv").write_text("".join(f"{(-1) ** i * 1e308}\n" for i in range(300)))
    assert "outside 1e-300 to 1e300" in page(capsys, "log.csv", "--details")


@pytest.mark.slow
def test_stdin_is_read_to_its_end_as_a_file(folder, capsys, monkeypatch):
    file = tuned(capsys, "log.csv", "--lag-ms", "50")
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO((folder / "log.csv").read_bytes())))
    assert tuned(capsys, "-", "--lag-ms", "50") == {**file, "source": "-"}


# ---- a terminal


def terminal_in(monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr(sys, "stderr", terminal)
    return terminal


def test_a_long_search_shows_one_line_that_disappears(monkeypatch):
    now, terminal = 0.0, terminal_in(monkeypatch)
    monkeypatch.setattr(console.time, "monotonic", lambda: now)
    with console.progress_line() as whole:
        report = Progress(whole).part(0.5, 1.0)
        report(0.0, "too early")
        assert terminal.getvalue() == ""
        now = 1.5
        report(0.5, "b: EM pass 10")
        report(0.6, "too soon after it")
        assert terminal.getvalue() == "\r 75% b: EM pass 10"
        now = 2.0
        report(0.9, "done")
    assert terminal.getvalue().endswith(f"\r{' ' * 18}\r")
    assert "\n" not in terminal.getvalue()


def test_what_is_compiled_at_the_first_start_is_shown(monkeypatch):
    watching, terminal = [], terminal_in(monkeypatch)
    monkeypatch.setattr(compiled, "watch_compiling", watching.append)
    console.report_compiling()
    for busy in (True, False):
        watching[0](Compiling(0, is_busy=busy))
    assert "compiling for this computer, only at the first start: 0 done" in terminal.getvalue()
