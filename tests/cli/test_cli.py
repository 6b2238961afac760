from __future__ import annotations

import csv
import io
import math
import os
import select
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from tests.support.program import command
from tests.support.waiting import PATIENCE

from kalscope.catalogue import open_source
from kalscope.cli.app import run
from kalscope.cli.filter import MAX_LINE_BYTES
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.filtering.filter import KalmanFilter, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.sources.reading.recording_file import read_recording
from kalscope.tuning.file import save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning

posix_only = pytest.mark.skipif(os.name == "nt", reason="POSIX pipes and devices")
PROGRAM = [sys.executable, "-m", "kalscope.cli"]
NAN = math.nan


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A recording of two channels at 100 Hz, one sample missing."""
    path = tmp_path / "log.csv"
    noise = np.random.default_rng(3).normal(size=(60, 2))
    lines = [f"{i / 100},{a!r},{b!r}" for i, (a, b) in enumerate(noise.tolist())]
    lines[7] = "0.07,,1.5"
    path.write_text("\n".join(["time (s),a (V),b", *lines, ""]))
    return path


@pytest.fixture
def config(tmp_path: Path, log: Path) -> Path:
    """A tuning of both channels of `log`, made on it."""
    path = tmp_path / "tuning.toml"
    recording = read_recording(log)
    channels = (
        ChannelTuning("a", "V", 0.1 / 3.0, 1.7),
        ChannelTuning("b", "", 1e-3, 2.0, p0=0.5, x0=-1.0, gate=9.0),
    )
    save_tuning(Tuning(channels, sha256=recording.sha256, sample_period=0.01), path)
    return path


Captured = pytest.CaptureFixture[str]


def columns(text: str) -> dict[str, np.ndarray]:
    header, *rows = csv.reader(io.StringIO(text))
    table = np.array([[float(cell) if cell else NAN for cell in row] for row in rows])
    return dict(zip(header, table.T, strict=True))


# ---- filter FILE


A, B = FilterParams(0.1 / 3.0, 1.7), FilterParams(1e-3, 2.0, p0=0.5, x0=-1.0, gate=9.0)
BOTH = FilterParams(0.0, 2.0, 1.0, -0.5)
TAKEN = "sample period is taken as 0.04 s; by its time it would be 0.01 s"
CASES: list[tuple[str, dict[str, FilterParams], tuple[str, ...]]] = [
    ("--config tuning", {"a": A, "b": B}, ()),
    ("--config tuning --channel b --q 0.25 --p0 diffuse --x0 first", {"b": FilterParams(0.25, 2.0, gate=9.0)}, ()),
    ("--q 0 --r 2 --p0 1 --x0 -0.5", {"a": BOTH, "b": BOTH}, ()),
    (
        "--config tuning --channel a --sample-period 0.04",
        {"a": FilterParams(0.1 / 3.0 * 4.0, 1.7)},
        (TAKEN, "q was multiplied by 4: it was tuned at a sample period of 0.01 s, here it is 0.04 s"),
    ),
    ("--config tuning --channel a --sample-period 0.04 --q 1", {"a": FilterParams(1.0, 1.7)}, (TAKEN,)),
    (
        "--config moving --channel a",
        {"a": FilterParams(0.25, 1.5, momentum=20.0)},
        ("q was multiplied by 2 and momentum was divided by 2: they",),
    ),
    (
        "--config moving --channel a --q 1",
        {"a": FilterParams(1.0, 1.5, momentum=20.0)},
        ("note: momentum was divided by 2: it was tuned",),
    ),
    (
        "--config moving --channel a --momentum 7",
        {"a": FilterParams(0.25, 1.5, momentum=7.0)},
        ("note: q was multiplied by 2: it was tuned",),
    ),
    ("--config moving --channel a --momentum 0 --q 1", {"a": FilterParams(1.0, 1.5)}, ()),
]


@pytest.mark.parametrize(("options", "chosen", "notes"), CASES)
def test_the_filtered_column_is_kalman_filter_bit_for_bit(options, chosen, notes, log, config, moving, capsys):
    words = [{"tuning": str(config), "moving": str(moving)}.get(word, word) for word in options.split()]
    assert run(["filter", str(log), *words]) == 0
    out, err = capsys.readouterr()
    table, recording = columns(out), read_recording(log)
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
def test_what_is_not_given_is_that_of_the_first_answer_and_fills_a_file(r, log, tmp_path, capsys):
    given = [] if r is None else ["--r", "5"]
    assert run(["filter", str(log), "--channel", "a", "-o", str(tmp_path / "out.csv"), *given]) == 0
    out, err = capsys.readouterr()
    z = read_recording(log).channel("a")
    params = find_parameters(z, Request(noise=Noise(r=r))).params
    assert params is not None
    filtered = columns((tmp_path / "out.csv").read_text())["a_filtered"]
    np.testing.assert_array_equal(filtered, kalman_filter(z, params).x)
    assert out == ""
    assert f"a: q = {params.q:.6g}, r = {params.r:.6g}" in err


@pytest.fixture
def moving(tmp_path: Path, log: Path) -> Path:
    """A tuning of channel a with momentum, at twice the rate of `log`."""
    path = tmp_path / "moving.toml"
    channel = ChannelTuning("a", "V", 0.125, 1.5, momentum=40.0)
    save_tuning(Tuning((channel,), sha256=read_recording(log).sha256, sample_period=0.005), path)
    return path


@pytest.mark.parametrize("period", [None, "0.005"])
def test_a_recording_without_time_takes_the_tuning_as_it_is_and_says_so(tmp_path, moving, capsys, period):
    path, z = tmp_path / "bare.csv", np.sin(np.arange(30.0))
    path.write_text("a\n" + "\n".join(map(repr, z.tolist())) + "\n")
    option = [] if period is None else ["--sample-period", period]
    assert run(["filter", str(path), "--config", str(moving), *option]) == 0
    out, err = capsys.readouterr()
    expected = kalman_filter(z, FilterParams(0.125, 1.5, momentum=40.0)).x
    np.testing.assert_array_equal(columns(out)["a_filtered"], expected)
    used = "q and momentum are used as tuned at a sample period of 0.005 s: the recording gives none"
    assert (used in err) == (period is None)
    if period is not None:
        np.testing.assert_allclose(columns(out)["time"], np.arange(30) * 0.005, rtol=1e-15)


def test_channels_that_the_tuning_lacks_are_left_out(log, tmp_path, capsys):
    config = tmp_path / "t.toml"
    save_tuning(Tuning(tuple(ChannelTuning(name, "", 1.0, 1.0) for name in "bc")), config)
    assert run(["filter", str(log), "--config", str(config)]) == 0
    out, err = capsys.readouterr()
    assert err == "kalscope: note: the tuning has no such channel: a\n"
    assert list(columns(out)) == ["time", "b", "b_filtered", "b_variance"]
    save_tuning(Tuning((ChannelTuning("volts", "", 1.0, 1.0),)), config)
    assert run(["filter", "demo", "--config", str(config)]) == 0
    out, err = capsys.readouterr()
    expected = kalman_filter(open_source("demo").values[:, 0], FilterParams(1.0, 1.0)).x
    np.testing.assert_array_equal(columns(out)["flex_filtered"], expected)
    assert "the tuning's only channel, volts" in err


# ---- errors


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # as main() has it
def test_the_largest_numbers_get_an_answer_in_words(tmp_path: Path, capsys: Captured) -> None:
    log = tmp_path / "alternating.csv"
    log.write_text("".join(f"{(-1) ** i * 1e308}\n" for i in range(300)))
    assert run(["tune", str(log), "--details"]) == 0
    assert "outside 1e-300 to 1e300" in capsys.readouterr().out


def test_version_and_help_are_status_0(capsys: Captured) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"kalscope {version('kalscope')}\n"
    assert run(["--help"]) == 0
    assert "filter" in capsys.readouterr().out
    assert run(["filter", "--help"]) == 0
    assert "--sample-period" in capsys.readouterr().out


# ---- filter -


@pytest.fixture
def feed(monkeypatch: pytest.MonkeyPatch) -> Callable[[bytes], None]:
    def set_stdin(data: bytes) -> None:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))

    return set_stdin


def test_unreadable_lines_are_missing_samples_answered_by_an_empty_line(feed, capsys):
    feed(b"1\nboot\n2,3\n\xff\xfe\n1_0\ninf\n\nnan\n0x1F\n# q 0.1\n 5 \r\n6")
    assert run(["filter", "-", "--q", "1", "--r", "1"]) == 0
    out, err = capsys.readouterr()
    x = kalman_filter([1, *[NAN] * 8, 5, 6], FilterParams(1.0, 1.0)).x
    assert out.split("\n") == ["1.0", *[""] * 9, repr(x[9].item()), repr(x[10].item()), ""]
    bad = [line.split(" must")[0] for line in err.splitlines()]
    assert bad == [f"kalscope: line {n}" for n in (2, 3, 4, 5, 6, 9)]


def test_a_line_without_end_is_one_unreadable_line(feed: Callable[[bytes], None], capsys: Captured) -> None:
    feed(b"1\n" + b"1," * (MAX_LINE_BYTES * 2) + b"1\n" + b"3\n")
    assert run(["filter", "-", "--q", "1", "--r", "1"]) == 0
    out, err = capsys.readouterr()
    x = kalman_filter([1.0, NAN, 3.0], FilterParams(1.0, 1.0)).x
    assert out == f"1.0\n\n{x[2].item()!r}\n"
    assert err.startswith("kalscope: line 2 must hold")
    assert len(err) < 300


# ---- as a program


@posix_only
def test_each_line_of_stdin_is_answered_before_the_next_is_sent() -> None:
    with subprocess.Popen(
        [*PROGRAM, "filter", "-", "--q", "1", "--r", "1"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        twin = KalmanFilter(FilterParams(1.0, 1.0))
        for z in (1.0, 2.5, -4.0):
            program.stdin.write(f"{z}\n".encode())
            program.stdin.flush()
            assert select.select([program.stdout], [], [], PATIENCE)[0], "no answer to a line"
            assert float(program.stdout.readline()) == twin.update(z)
        program.stdin.close()
        assert program.wait(PATIENCE) == 0


@posix_only
def test_a_reader_that_leaves_is_no_error() -> None:
    with command("filter", "synthetic:sine?n=20000", "--q", "1", "--r", "1") as program:  # more than a pipe holds
        program.stdout.read(10)
        program.stdout.close()
        assert program.stderr.read() == ""
        assert program.wait(PATIENCE) == 0


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("output", [[], ["-o", "/dev/full"]])
def test_a_full_disk_is_one_line(output: list[str]) -> None:
    change = "import os; os.dup2(os.open('/dev/full', os.O_WRONLY), 1)\n"
    with command("filter", "demo", *output, change=change) as program:
        _, err = program.communicate(PATIENCE)
    assert program.returncode == 2
    assert err.endswith("the disk is full\n")
    assert len(err.splitlines()) == 1


SLOW = ["viser", "serial", "rich", "matplotlib", "numba", "scipy"]
"""Packages that take long to import."""


@pytest.mark.parametrize(
    ("asked", "slow"),
    [
        *((["--help"], [*SLOW, "numpy", "pydantic"]), (["export", "--help"], [*SLOW, "kalscope.filtering"])),
        (["tune", "--help"], ["kalscope.estimation.request", "kalscope.cli.tune_answer", "scipy.stats"]),
    ],
)
def test_help_imports_neither_the_dashboard_nor_what_is_slow(asked: list[str], slow: list[str]) -> None:
    probe = (
        f"import sys; from kalscope.cli.app import run; run({asked})\n"
        f"print([name for name in {slow} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


# How a file is to be read, and the account of how it was.

AWKWARD = "n;time (ms);a\n" + "".join(f"{i};{20 * i};{-200 if i % 5 == 4 else i % 3}\n" for i in range(20))


@pytest.fixture
def awkward(tmp_path: Path) -> str:
    path = tmp_path / "awkward.csv"
    path.write_text(AWKWARD + "20;400\n21;420;ERR\n")
    return str(path)


def test_the_report_accounts_for_every_line_on_stderr(awkward: str, capsys: Captured) -> None:
    assert run(["filter", awkward, "--report"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("time,n,n_filtered")
    assert "23 lines = 21 with data + 1 rejected + 1 header" in err
    assert "line 22: must have 3 fields (got 2) (got '20;400')" in err
    assert "line 23, \"a\": must be a number (got 'ERR')" in err
    assert "is -200 a missing value?" in err


def test_gaps_in_time_become_what_was_chosen(awkward: str, capsys: Captured) -> None:
    assert run(["filter", awkward, "--channel", "a", "--gaps", "missing"]) == 0
    assert len(columns(capsys.readouterr().out)["time"]) == 22
    assert run(["filter", awkward, "--channel", "a", "--gaps", "dt", "--q", "1", "--r", "2"]) == 0
    recording = read_recording(awkward)
    expected = kalman_filter(recording.channel("a"), FilterParams(1.0, 2.0), recording.steps())
    np.testing.assert_array_equal(columns(capsys.readouterr().out)["a_filtered"][:20], expected.x[:20])
