"""`kalscope filter`: columns bit for bit, lines of a pipe, full disks; and what every command has."""

from __future__ import annotations

import csv
import io
import os
import select
import subprocess
import sys
from importlib.metadata import version

import numpy as np
import pytest
from tests.support.program import command
from tests.support.waiting import PATIENCE

from kalscope.catalogue import open_source
from kalscope.cli.app import run
from kalscope.cli.filter import MAX_LINE_BYTES
from kalscope.common.text import CONTROL
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.filtering.filter import KalmanFilter, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.sources.reading.recording_file import read_recording
from kalscope.tuning.file import save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning

posix_only = pytest.mark.skipif(os.name == "nt", reason="POSIX pipes and devices")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder: a recording of two channels at 100 Hz, one sample missing, and two tunings of it."""
    monkeypatch.chdir(tmp_path)
    noise = np.random.default_rng(3).normal(size=(60, 2))
    lines = [f"{i / 100},{a!r},{b!r}" for i, (a, b) in enumerate(noise.tolist())]
    lines[7] = "0.07,,1.5"
    (tmp_path / "log.csv").write_text("\n".join(["time (s),a (V),b", *lines, ""]))
    a, b = ChannelTuning("a", "V", 0.1 / 3.0, 1.7), ChannelTuning("b", "", 1e-3, 2.0, p0=0.5, x0=-1.0, gate=9.0)
    moving = ChannelTuning("a", "V", 0.125, 1.5, momentum=40.0)
    for name, channels, period in (("tuning", (a, b), 0.01), ("moving", (moving,), 0.005)):
        sha256 = read_recording("log.csv").sha256
        save_tuning(Tuning(channels, sha256=sha256, sample_period=period), f"{name}.toml")
    return tmp_path


def columns(text):
    header, *rows = csv.reader(io.StringIO(text))
    table = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])
    return dict(zip(header, table.T, strict=True))


A, B = FilterParams(0.1 / 3.0, 1.7), FilterParams(1e-3, 2.0, p0=0.5, x0=-1.0, gate=9.0)
BOTH = FilterParams(0.0, 2.0, 1.0, -0.5)
MOVING, LESS = (FilterParams(0.25, 1.5, momentum=momentum) for momentum in (20.0, 7.0))
OTHER, SLOW = "--config tuning.toml --channel a --sample-period 0.04", "--config moving.toml --channel a"
TAKEN = "sample period is taken as 0.04 s; by its time it would be 0.01 s"
CASES = [
    ("--config tuning.toml", {"a": A, "b": B}, ()),
    ("--config tuning.toml --channel b --q 0.25 --p0 diffuse --x0 first", {"b": FilterParams(0.25, 2, gate=9)}, ()),
    ("--q 0 --r 2 --p0 1 --x0 -0.5", {"a": BOTH, "b": BOTH}, ()),
    (OTHER, {"a": FilterParams(0.1 / 3.0 * 4.0, 1.7)}, (TAKEN, "q was multiplied by 4: it was tuned at a sample")),
    (f"{OTHER} --q 1", {"a": FilterParams(1.0, 1.7)}, (TAKEN,)),
    (SLOW, {"a": MOVING}, ("q was multiplied by 2 and momentum was divided by 2: they",)),
    (f"{SLOW} --q 1", {"a": FilterParams(1.0, 1.5, momentum=20.0)}, ("note: momentum was divided by 2: it was",)),
    (f"{SLOW} --momentum 7", {"a": LESS}, ("note: q was multiplied by 2: it was tuned",)),
    (f"{SLOW} --momentum 0 --q 1", {"a": FilterParams(1.0, 1.5)}, ()),
]


@pytest.mark.parametrize(("options", "chosen", "notes"), CASES)
def test_the_filtered_column_is_kalman_filter_bit_for_bit(options, chosen, notes, folder, capsys):
    assert run(["filter", "log.csv", *options.split()]) == 0
    out, err = capsys.readouterr()
    table, recording = columns(out), read_recording("log.csv")
    names = [name for name in chosen for name in (name, f"{name}_filtered", f"{name}_variance")]
    moves = any(params.momentum for params in chosen.values())
    assert list(table) == ["time", *names, *(["a_velocity_per_s"] if moves else [])]
    np.testing.assert_array_equal(table["time"], recording.time)
    for name, params in chosen.items():
        whole = kalman_filter(recording.channel(name), params)
        np.testing.assert_array_equal(table[name], recording.channel(name))
        np.testing.assert_array_equal(table[f"{name}_filtered"], whole.x)
        np.testing.assert_array_equal(table[f"{name}_variance"], whole.p)
    assert [note for note in notes if note not in err] == []
    assert err.count("\n") == len(notes)


@pytest.mark.parametrize("r", [None, 5.0])
def test_what_is_not_given_is_that_of_the_first_answer_and_fills_a_file(r, folder, capsys):
    given = [] if r is None else ["--r", "5"]
    assert run(["filter", "log.csv", "--channel", "a", "-o", "out.csv", *given]) == 0
    out, err = capsys.readouterr()
    z = read_recording("log.csv").channel("a")
    params = find_parameters(z, Request(noise=Noise(r=r))).params
    filtered = columns((folder / "out.csv").read_text())["a_filtered"]
    np.testing.assert_array_equal(filtered, kalman_filter(z, params).x)
    assert out == ""
    assert f"a: q = {params.q:.6g}, r = {params.r:.6g}" in err


@pytest.mark.parametrize("period", [None, "0.005"])
def test_a_recording_without_time_takes_the_tuning_as_it_is_and_says_so(folder, capsys, period):
    z = np.sin(np.arange(30.0))
    (folder / "bare.csv").write_text("a\n" + "\n".join(map(repr, z.tolist())) + "\n")
    option = [] if period is None else ["--sample-period", period]
    assert run(["filter", "bare.csv", "--config", "moving.toml", *option]) == 0
    out, err = capsys.readouterr()
    expected = kalman_filter(z, FilterParams(0.125, 1.5, momentum=40.0)).x
    np.testing.assert_array_equal(columns(out)["a_filtered"], expected)
    used = "q and momentum are used as tuned at a sample period of 0.005 s: the recording gives none"
    assert (used in err) == (period is None)
    if period is not None:
        np.testing.assert_allclose(columns(out)["time"], np.arange(30) * 0.005, rtol=1e-15)


def test_channels_that_the_tuning_lacks_are_left_out_and_its_only_one_fits_any_name(folder, capsys):
    save_tuning(Tuning(tuple(ChannelTuning(name, "", 1.0, 1.0) for name in "bc")), "t.toml")
    assert run(["filter", "log.csv", "--config", "t.toml"]) == 0
    out, err = capsys.readouterr()
    assert err == "kalscope: note: the tuning has no such channel: a\n"
    assert list(columns(out)) == ["time", "b", "b_filtered", "b_variance"]
    save_tuning(Tuning((ChannelTuning("volts", "", 1.0, 1.0),)), "t.toml")
    assert run(["filter", "demo", "--config", "t.toml"]) == 0
    out, err = capsys.readouterr()
    expected = kalman_filter(open_source("demo").values[:, 0], FilterParams(1.0, 1.0)).x
    np.testing.assert_array_equal(columns(out)["flex_filtered"], expected)
    assert "the tuning's only channel, volts" in err


def test_the_report_accounts_for_every_line_and_gaps_become_what_was_chosen(folder, capsys):
    rows = "".join(f"{i};{20 * i};{-200 if i % 5 == 4 else i % 3}\n" for i in range(20))
    (folder / "awkward.csv").write_text(f"n;time (ms);a\n{rows}20;400\n21;420;ERR\n")
    assert run(["filter", "awkward.csv", "--report"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("time,n,n_filtered")
    for words in (
        "23 lines = 21 with data + 1 rejected + 1 header",
        "line 22: must have 3 fields (got 2) (got '20;400')",
        "line 23, \"a\": must be a number (got 'ERR')",
        "is -200 a missing value?",
    ):
        assert words in err
    assert run(["filter", "awkward.csv", "--channel", "a", "--gaps", "missing"]) == 0
    assert len(columns(capsys.readouterr().out)["time"]) == 22
    assert run(["filter", "awkward.csv", "--channel", "a", "--gaps", "dt", "--q", "1", "--r", "2"]) == 0
    recording = read_recording("awkward.csv")
    expected = kalman_filter(recording.channel("a"), FilterParams(1.0, 2.0), recording.steps()).x
    np.testing.assert_array_equal(columns(capsys.readouterr().out)["a_filtered"], expected)


# ---- filter -


def piped(data, monkeypatch, capsys):
    """What the command prints for these lines on stdin, and what it says."""
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
    assert run(["filter", "-", "--q", "1", "--r", "1"]) == 0
    return capsys.readouterr()


def test_unreadable_lines_are_missing_samples_answered_by_an_empty_line(monkeypatch, capsys):
    lines = b"1\n\x1b[2Jboot\n2,3\n\xff\xfe\n1_0\ninf\n\nnan\n0x1F\n# q 0.1\n 5 \r\n6"
    out, err = piped(lines, monkeypatch, capsys)
    x = kalman_filter([1, *[np.nan] * 8, 5, 6], FilterParams(1.0, 1.0)).x.tolist()
    assert out.split("\n") == ["1.0", *[""] * 9, repr(x[9]), repr(x[10]), ""]
    bad = [line.split(" must")[0] for line in err.splitlines()]
    assert bad == [f"kalscope: line {n}" for n in (2, 3, 4, 5, 6, 9)]
    assert not CONTROL.search(err)


def test_a_line_without_end_is_one_unreadable_line(monkeypatch, capsys):
    out, err = piped(b"1\n1." + b"0" * MAX_LINE_BYTES * 2 + b"\n3\n", monkeypatch, capsys)
    assert out == f"1.0\n\n{kalman_filter([1.0, np.nan, 3.0], FilterParams(1.0, 1.0)).x.tolist()[2]!r}\n"
    assert err.startswith("kalscope: line 2 must hold")
    assert len(err) < 300


@posix_only
def test_each_line_of_stdin_is_answered_before_the_next_is_sent():
    argv = [sys.executable, "-m", "kalscope.cli", "filter", "-", "--q", "1", "--r", "1"]
    with subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as program:
        twin = KalmanFilter(FilterParams(1.0, 1.0))
        for z in (1.0, 2.5, -4.0):
            program.stdin.write(f"{z}\n".encode())
            program.stdin.flush()
            assert select.select([program.stdout], [], [], PATIENCE)[0], "no answer to a line"
            assert float(program.stdout.readline()) == twin.update(z)
        program.stdin.close()
        assert program.wait(PATIENCE) == 0


# ---- any command


@posix_only
def test_a_reader_that_leaves_is_no_error():
    with command("filter", "synthetic:sine?n=20000", "--q", "1", "--r", "1") as program:  # more than a pipe holds
        program.stdout.read(10)
        program.stdout.close()
        assert program.stderr.read() == ""
        assert program.wait(PATIENCE) == 0


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_is_one_line():
    change = "import os; os.dup2(os.open('/dev/full', os.O_WRONLY), 1)\n"
    with command("filter", "demo", change=change) as program:
        _, err = program.communicate(PATIENCE)
    assert program.returncode == 2
    assert err.endswith("the disk is full\n")
    assert len(err.splitlines()) == 1


HELP = """
import sys
from kalscope.cli.app import run
slow = {"viser", "serial", "rich", "matplotlib", "numba", "scipy"}
for argv, others in (
    (["--version"], {"numpy", "pydantic"}),
    (["--help"], {"numpy", "pydantic"}),
    (["export", "--help"], {"kalscope.filtering"}),
    (["tune", "--help"], {"kalscope.estimation.request", "kalscope.cli.tune_answer"}),
):
    assert run(argv) == 0
    print("loaded:", *({*slow, *others} & set(sys.modules)))
"""


def test_help_and_version_import_neither_the_dashboard_nor_what_is_slow():
    printed = subprocess.check_output([sys.executable, "-c", HELP], text=True)
    assert [line for line in printed.splitlines() if line.startswith("loaded:")] == ["loaded:"] * 4
    assert printed.startswith(f"kalscope {version('kalscope')}\n")
    assert "--sample-period" in printed
