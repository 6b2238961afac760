"""Mistakes of the user, of every command: status 2, one line on stderr, and no file made."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from kalscope.cli.app import run
from kalscope.papers import reproduction
from kalscope.tuning.file import save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.main import add_dashboard

add_dashboard()

FUSION = ChannelTuning("level", "", 0.002, (0.25, 1.0, 4.0), sensors=("a", "b", "c"), offset=(0.3, 0.0, -0.3))
MISTAKES = [
    *(("", "Missing command"), ("nope", "No such command 'nope'"), ("filter", "Missing argument 'SOURCE'")),
    *(("filter demo extra", "unexpected extra argument"), ("filter demo --q", "'--q' requires an argument")),
    ("filter demo --q abc", "--q must be a number (got 'abc')"),
    ("filter demo --q -1 --r 1", "q must be a finite variance from 0 to 1e300 (got -1.0)"),
    ("filter demo --p0 x", "--p0 must be a number or \"diffuse\" (got 'x')"),
    ("filter demo --x0 x", "--x0 must be a number or \"first\" (got 'x')"),
    ("filter demo --x0 1", "x0 needs p0"),
    ("filter demo --sample-period -1", "--sample-period must be a number above 0 (got '-1')"),
    ("filter demo --channel zz", "channel must be one of"),
    *(("filter demo --config missing.toml", "missing.toml"), ("filter missing.csv", "missing.csv")),
    *(("filter ''", "source must be"), ("filter 'two\nlines.csv'", "lines.csv")),
    ("filter demo -o no/out.csv", "'no/out.csv' cannot be used: it or its folder does not exist"),
    ("filter demo -o .", "'.' cannot be used: it is a folder"),
    ("filter demo -o " + "a" * 300, "its name is too long"),
    *(("filter log.csv -o ./log.csv", "another file than SOURCE"), ("filter -", "give --config, or --q and --r")),
    *((f"filter - --q 1 --r 1 {option}", "must be left out") for option in ("-o x.csv", "--report")),
    ("filter - --q 1 --r 1 --channel a", "--channel needs --config"),
    ("filter log.csv --config t.toml --fuse a,x", "of one unit, of a, b, c (got 'x', which is not a channel)"),
    ("filter log.csv --config t.toml --fuse a,b --channel a", "--fuse must be used without --channel"),
    ("filter log.csv --config t.toml --fuse a,b --chain 'median 5, kalman'", "--chain must be used without fused"),
    ("filter log.csv --config t.toml --r a=1,b=2 --channel a", "--r must be one number without --fuse"),
    *((f"filter log.csv --config t.toml --r {r}", "--r must be a number") for r in ("a=x", "a=1,a=2")),
    *((f"filter {source} --fuse a,b", "--fuse needs --config with a fusion") for source in ("-", "log.csv")),
    ("filter log.csv --config single.toml --fuse a,b", "--fuse needs --config with a fusion: kalscope tune"),
    ("filter log.csv --config other.toml", "the tuning must hold a or b or c (got channels x, y)"),
    ("filter log.csv --chain 'median 4, kalman'", "window must be an odd number"),
    *(("filter - --chain 'median 5, kalman'", "kalscope: "), ("tune", "Missing argument 'SOURCE'")),
    *(("tune missing.csv", "missing.csv"), ("tune serial:COM3@9600", "a board that streams")),
    ("tune demo --channel zz", "channel must be one of flex (got 'zz')"),
    ("tune demo --channel flex --all", "--all must be used without --channel"),
    ("tune demo --lag-ms x", "--lag-ms must be a number above 0 (got 'x')"),
    ("tune demo --sigma nan", "--sigma must be a number above 0"),
    ("tune demo --sample-period 0", "--sample-period must be a number above 0"),
    ("tune demo --gain 1", "gain must lie between 0 and 1"),
    ("tune demo --cutoff-hz 26", "at most half the sample rate, 25 Hz"),
    ("tune demo --lag-ms 5 --gain 0.1", "can decide q/r (got --lag-ms and --gain)"),
    ("tune demo --r 1 --sigma 1", "can give r (got --sigma and --r)"),
    ("tune demo --density 1", "given together (got only --density)"),
    *((f"tune log.csv --still {span}", "--still must be FROM:TO") for span in ("1-2", "2:1", "nan:1")),
    ("tune log.csv --still 0.001:0.009", "--still must lie in the recording, 0:1.99 s (got '0.001:0.009')"),
    ("tune restarted.csv --still 10:20", "--still must be one stretch, but time steps back in it"),
    *((f"tune demo --two-speeds {wish}", "two speeds are found with q and r") for wish in ("--r 1", "--gain 0.1")),
    ("tune demo --overshoot 100 --gain 0.1", "--overshoot must be a percentage of at least 0 and"),
    ("tune demo --overshoot 5 --lag-ms 90 --momentum 9", "overshoot needs a target such as a lag"),
    ("tune demo -o no/t.toml", "'no/t.toml' cannot be used: it or its folder does not exist"),
    ("tune bare.csv --lag-ms 5", "--lag-ms needs the time between two samples: give --sample-period"),
    *((f"tune log.csv --fuse {names}", "--fuse must be two or more channels of") for names in ("a", "a,1")),
    ("tune log.csv --fuse a,b --all", "--fuse must be used without --channel and --all"),
    ("tune log.csv --reference a", "--reference needs --fuse"),
    ("tune log.csv --fuse a,b --reference c", "--reference must be a sensor of --fuse: a, b (got 'c')"),
    ("tune log.csv --fuse a,b --r c=1", "--r must be a sensor of --fuse: a, b (got 'c')"),
    ("tune log.csv --fuse a,b --r a=1 --sigma b=1", "only one of --still, --sigma, --density, --r"),
    ("tune log.csv --r a=1", "--r must be one number without --fuse (got one for a)"),
    ("tune log.csv --fuse a,b --lag-ms 1e11", "the goal must be a filter that is not slower than the record"),
    ("fleet log.csv -o out --momentum 1e9", 'momentum must be "auto" or sample periods from 0 to 1e5 (got 1000000'),
    ("fleet log.csv -o out --all --channel a", "--all must be used without --channel (got --channel 'a')"),
    ("fleet log.csv -o out --lag-ms 5 --gain 0.2", "only one of --lag-ms, "),
    ("fleet log.csv -o out --still 1:2", "--still must be auto for a fleet, whose recordings differ (got '1:2')"),
    *(("export t.toml", "Missing option"), ("export t.toml --to cobol", "target must be one of arduino, c,")),
    ("export t.toml --to json --channel unknown", "channel must be one of a, b, c"),
    ("export t.toml --to json --vectors demo", "--vectors needs -o"),
    ("export t.toml --to json --decimal comma", "--vectors"),
    ("export t.toml --to json --sample-period 0", "--sample-period must be a number above 0 (got '0')"),
    *((f"record {no_port} -o x.csv", f"{no_port} must be a serial port") for no_port in (".", "log.csv")),
    ("record /dev/none -o run.csv", "kalscope: "),
    ("record /dev/none -o run.csv --seconds -1", "--seconds must be a number above 0 (got '-1')"),
    ("record /dev/none -o run.csv --lines many", "--lines must be a number above 0 (got 'many')"),
    ("record /dev/none@fast -o run.csv", "baud rate must be a whole number"),
    ("record /dev/none -o .", "a recording must be a file"),
    *(("record /dev/none --output=", "a recording must be a file"), ("reproduce", "Missing option '-o'")),
    *(("reproduce -o FILE", "must go to a folder"), ("reproduce -o FILE/below", "FILE")),
    ("reproduce -o x --fast", "--fast"),
    *((f"demo-board --socket {port}", "--socket must be a") for port in ("80x", "70000")),
    *(("open nowhere.csv", "nowhere.csv"), ("open sample:nothing", "nothing"), ("open --config FILE", "FILE")),
    *(("open demo --port 99999", "port must"), ("open demo --host 0.0.0.0 --no-browser", "--allow-host")),
    *(("open demo --host a.invalid", "cannot be used on this machine"), ("open demo --nothing", "--nothing")),
    *(("open demo --channel w", "channel must be one of"), ("open serial:/dev/ttyACM0@fast", "baud rate must")),
    *(("open demo --q much", "q must be a number"), ("open demo --x0 3", "x0 needs p0")),
    *((f"demo-board --rate {rate}", "--rate must be") for rate in ("fast", "0", "1e9")),
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder: recordings of three channels and of one without time, tunings, and an empty file."""
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text("time,a,b,c\n" + "".join(f"{i / 100},{i % 7},{i % 5},{i % 3}\n" for i in range(200)))
    Path("bare.csv").write_text("a\n" + "".join(f"{i * i % 11}\n" for i in range(200)))
    Path("restarted.csv").write_text("time (s),v\n" + "".join(f"{i % 50},{i % 7}\n" for i in range(100)))
    Path("FILE").write_text("")
    singles = tuple(ChannelTuning(name, "", 0.002, r) for name, r in zip("abc", FUSION.r, strict=True))
    others = tuple(ChannelTuning(name, "", 1.0, 1.0) for name in "xy")
    for name, channels, fusion in (("t", singles, FUSION), ("single", singles[:1], None), ("other", others, None)):
        save_tuning(Tuning(channels, sample_period=0.01, fusion=fusion), f"{name}.toml")
    return tmp_path


@pytest.mark.parametrize(("line", "says"), MISTAKES)
def test_a_mistake_is_status_2_and_one_line_and_makes_no_file(line, says, folder, monkeypatch, capsys):
    monkeypatch.setattr(reproduction, "reproduce", lambda *_, **__: pytest.fail("must not start"))
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert run(shlex.split(line)) == 2
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert err.startswith("kalscope: ")
    assert says in err
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
