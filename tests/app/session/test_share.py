"""The line that reopens what is on screen: printed, split as a shell does, parsed by the real program."""

from __future__ import annotations

import shlex
from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest

from kalscope import open_source
from kalscope.cli.app import app
from kalscope.sources.grammar.read_options import options_from_text
from kalscope_app.main import add_dashboard
from kalscope_app.session.changes import select_channel, set_sample_period, set_text, share_line
from kalscope_app.session.opening import opened, opened_experiment

pytestmark = pytest.mark.slow


class Stopped(Exception):
    """The program has its first state."""


@pytest.fixture
def reopen(monkeypatch):
    """Run a line with the real command line, up to the first state."""

    def run(line):
        seen = []

        def caught(state, *_, **__):
            seen.append(state)
            raise Stopped

        monkeypatch.setattr("kalscope_app.open_command.serve", caught)
        add_dashboard()
        words = shlex.split(line)
        assert words[:2] == ["kalscope", "open"]
        with pytest.raises(Stopped):
            app([*words[1:], "--port", "0", "--no-browser"], standalone_mode=False)
        return seen[0]

    return run


def essence(state):
    """What must come back: how the samples were read, the channel and its setting."""
    recording, names = state.recording, ("q", "r", "momentum", "p0", "x0", "gate")
    setting = [getattr(state.tuning, name) for name in names]
    return state.channel, setting, recording.sample_period, recording.gaps, state.options, state.filter


def files(folder):
    rows = "".join(f"{i},{i % 7},{-200 if i % 9 == 0 else i % 5}\n" for i in range(60))
    for name in ("plain.csv", 'it\'s a log $(x) `y` & "z".csv', "-dash.csv", "ü ß.csv"):
        (folder / name).write_text("t,a b's,$x\n" + rows)
        yield name


CHANGES = [
    [set_text("q", "1e-9"), set_text("r", "12345.678901234567"), set_sample_period("0.02"), set_sample_period("")],
    [set_text("q", "0.1"), set_text("p0", "0"), set_text("x0", "-3.25")],
    [set_text("p0", "1e-300"), set_text("gate", "9"), set_sample_period("0.02"), set_sample_period("5")],
    [set_text("q", "0"), set_text("r", "2")],
    [set_text("q", "2"), set_text("momentum", "12.345678901234567"), set_text("gate", "9")],
    [set_text("r", "0"), set_text("momentum", "3"), set_text("momentum", "off")],
    [lambda state: select_channel(state.recording.names[-1])(state), set_text("q", "7")],
    [set_text("p0", "1"), set_text("p0", "automatic")],
]


def test_the_line_reopens_file_channel_and_setting(reopen, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = list(files(tmp_path))
    for gestures, name in [*(([], name) for name in names), *zip(CHANGES, cycle(names), strict=False)]:
        state = opened(open_source(f"./{name}" if name.startswith("-") else name))
        for change in gestures:
            state = change(state)
        again = reopen(share_line(state).line)
        assert essence(again) == essence(state)
        assert np.array_equal(again.recording.values, state.recording.values, equal_nan=True)


def test_an_experiment_reopens_as_its_figure_and_as_it_was_changed(reopen):
    for name in ("lis302dl_r_32", "noise_reducer_figure_6", "generalized_figure_7"):
        figure = opened_experiment(f"experiment:{name}")
        tuned = set_text("p0", "automatic")(set_text("r", "3")(figure.with_standard_filter()))
        for state in figure, tuned:
            assert essence(reopen(share_line(state).line)) == essence(state)


def test_how_the_file_was_read_comes_along(reopen, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = next(files(tmp_path))
    cells = {"delimiter": "comma", "time_column": "none", "missing": ["-200", "n/x"], "gaps": "rows"}
    for given in cells, {"time_column": "t", "time_unit": "ms", "gaps": "dt"}:
        options = options_from_text(**given)
        state = replace(opened(open_source(name, options)), options=options)
        assert essence(reopen(share_line(state).line)) == essence(state)
