"""Names from outside in whatever Kalscope writes: each file is read back, compiled or parsed by its readers."""

from __future__ import annotations

import csv
import io
import logging
import shlex
import subprocess
import tomllib

import numpy as np
import pytest
from tests.support.hostile_names import NAMES

from kalscope import ChannelTuning, Recording, Tuning, load_tuning, save_tuning
from kalscope.common.text import CONTROL
from kalscope.recording import LineIssue
from kalscope.sources.recorder import preamble, rejects_lines
from kalscope_app.program.log import Lines
from kalscope_app.session.changes import share_line
from kalscope_app.session.opening import opened

VALUES = np.cumsum(np.random.default_rng(3).normal(size=(60, 1)), axis=0)


@pytest.mark.slow
def test_a_tuning_file_gives_the_names_back_and_a_recording_of_a_board_holds_them_as_plain_text(tmp_path):
    path = tmp_path / "tuning.toml"
    for name in NAMES:
        channel = ChannelTuning(name, name, 0.01, 0.25, how=name)
        save_tuning(Tuning((channel,), source_name=name, sha256=name, tool=name, date=name), path)
        whole = name.encode("utf-8", "replace").decode()
        held = load_tuning(path).channels[0]
        assert (held.name, held.how) == (whole, whole)
        text = path.read_text("utf-8")
        assert tomllib.loads(text)["channel"][0]["name"] == whole
        issues, above = [LineIssue(7, f"must be {name}", name, name)], preamble(name, 0.0)
        rejects = rejects_lines(1.5, 7, name, issues)
        assert [len(row) for row in csv.reader(io.StringIO(rejects))] == [5]
        assert all(line.startswith("#") for line in above.splitlines())
        assert not CONTROL.search(text + rejects + above)


def test_a_line_to_be_typed_is_one_word_each_for_a_shell(tmp_path):
    """Read back by a real shell."""
    lines = []
    for name in NAMES:
        for names in ((name,), (name, "b")):
            values = np.repeat(VALUES, len(names), axis=1)
            recording = Recording(np.arange(60) / 100, names, names, values, 0.01, source=name, title=name)
            lines.append(share_line(opened(recording)).line)
            assert lines[-1].isprintable()
            assert shlex.split(lines[-1])[:2] == ["kalscope", "open"]
    script = "kalscope() { printf '%s\\n' $#; }\n" + "\n".join(lines)
    counts = subprocess.run(("sh",), input=script.encode(), capture_output=True, check=True, cwd=tmp_path).stdout
    assert counts.decode().split() == [str(len(shlex.split(line)) - 1) for line in lines]
    assert list(tmp_path.iterdir()) == []


def test_an_entry_of_the_log_is_one_line_of_plain_text():
    form = Lines("%(levelname)s %(message)s", [], with_traceback=True)
    for name in NAMES:
        record = logging.LogRecord("a", logging.WARNING, "", 0, "opened %s", (name,), None)
        first, *more = form.format(record).split("\n")
        assert first.startswith("WARNING opened ")
        assert all(line.startswith("    ") for line in more)
        assert not CONTROL.search(first + "".join(more))
