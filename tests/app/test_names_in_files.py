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
from hostile_names import NAMES

from kalscope import ChannelTuning, Recording, Tuning, load_tuning, read_recording, save_tuning
from kalscope.common.text import CONTROL
from kalscope.export.csv import csv_header
from kalscope.recording import LineIssue
from kalscope.sources.grammar.line_format import LineFormat
from kalscope.sources.reading.columns import Column
from kalscope.sources.reading.sniffer import Layout
from kalscope.sources.recorder import header_line, preamble, rejects_lines
from kalscope_app.program.log import Lines
from kalscope_app.session.changes import share_line
from kalscope_app.session.opening import opened

FORMULA = ("=", "+", "-", "@", "\t", "\r")
VALUES = np.cumsum(np.random.default_rng(3).normal(size=(60, 1)), axis=0)


@pytest.mark.slow
def test_a_tuning_file_gives_the_names_back(tmp_path):
    path = tmp_path / "tuning.toml"
    for name in NAMES:
        channel = ChannelTuning(name, name, 0.01, 0.25, how=name)
        save_tuning(Tuning((channel,), source_name=name, sha256=name, tool=name, date=name), path)
        whole = name.encode("utf-8", "replace").decode()
        held = load_tuning(path).channels[0]
        assert (held.name, held.how) == (whole, whole)
        text = path.read_text("utf-8")
        assert tomllib.loads(text)["channel"][0]["name"] == whole
        assert not CONTROL.search(text)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_filtered_csv_has_its_columns_and_no_formula(tmp_path, name):
    header = csv_header([name, "b", name])
    (cells,) = csv.reader(io.StringIO(header))
    assert len(cells) == len(set(cells)) == 10
    assert not any(cell.startswith(FORMULA) for cell in cells)
    assert header.count("\n") == 1
    assert not CONTROL.search(header)
    path = tmp_path / "out.csv"
    rows = "".join(",".join([f"{i / 100}", *(f"{(3 * i + k) % 7}.5" for k in range(9))]) + "\n" for i in range(30))
    path.write_text(header + rows, "utf-8", errors="replace")
    assert read_recording(path).values.shape == (30, 9)


@pytest.mark.parametrize("name", NAMES)
def test_a_recording_of_a_board_has_its_columns_and_no_formula(name):
    columns = (Column(name, name), Column(name))
    header = header_line(Layout(LineFormat(), columns, None, 1, frozenset(), (), ()))
    (cells,) = csv.reader(io.StringIO(header))
    assert len(cells) == len(set(cells)) == 3
    rejects = rejects_lines(1.5, 7, name, [LineIssue(7, f"must be {name}", name, name)])
    (said,) = csv.reader(io.StringIO(rejects))
    assert len(said) == 5
    above = preamble(name, 0.0)
    assert all(line.startswith("#") for line in above.splitlines())
    for text in (header, rejects, above):
        assert not CONTROL.search(text)
    assert not any(cell.startswith(FORMULA) for cell in cells)


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
