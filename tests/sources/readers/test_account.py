"""How a recording was read, in one line, in warnings and in full."""

import json
from dataclasses import replace

import numpy as np
import pytest

from kalscope.cli.tune_answer import finite
from kalscope.common.text import THIN_SPACE
from kalscope.recording import LineIssue, ReadReport, Recording
from kalscope.sources.grammar.read_options import options_from_text
from kalscope.sources.reading.account import account, as_plain, summary, warnings
from kalscope.sources.reading.recording_file import read_recording

ROWS = [f"{i / 50:.2f},{20 + i % 3},{i % 5}" for i in range(200)]


@pytest.fixture
def read(tmp_path):
    def read_lines(lines, **options):
        path = tmp_path / "log.csv"
        path.write_text("\n".join(["t,temp,dist", *lines, ""]))
        return read_recording(path, options_from_text(**options))

    return read_lines


def test_a_clean_file_is_summed_up_in_one_line_with_its_many_comments(read):
    assert summary(read(["# a remark", *ROWS])) == "200 rows, 2 channels, 50.0 Hz"
    assert summary(read([*["# a remark"] * 9, *ROWS])).endswith("50.0 Hz; 9 comment and text lines")
    assert warnings(read(ROWS)) == ()


SPOILT = {"12.3,4": "must have 3 fields", "1.0,2.0,\x013.0": "must be printable text"}


@pytest.mark.parametrize(("line", "why"), SPOILT.items())
def test_rejected_lines_are_counted_with_their_reason(read, line, why):
    recording = read([*ROWS[:100], line, *ROWS[100:]])
    assert f"; 1 line rejected: {why}" in summary(recording)
    assert warnings(recording) == ()


def test_more_than_two_percent_of_rejected_lines_are_a_warning(read):
    few = read([*ROWS, *["status ok,1"] * 4])
    many = read([*ROWS[:100], *["status ok,1"] * 5, *ROWS[100:]])
    assert warnings(few) == ()
    (said,) = warnings(many)
    assert said.startswith("2.4 % of the lines were rejected, the first is line 102: must have 3 fields (got 2)")
    assert "(got 'status ok,1')" in said
    assert "  warning: 2.4 % of the lines" in account(many)


def test_many_cells_without_a_number_are_a_warning(read):
    spoilt = [row if i % 10 else row[: row.rindex(",")] + f",E{i}x" for i, row in enumerate(ROWS)]
    recording = read(spoilt)
    assert "; 20 cells without a number" in summary(recording)
    (said,) = warnings(recording)
    assert said.startswith('5.0 % of the cells are not numbers, the first is line 2, "dist": must be a number')
    assert said.endswith("(got 'E0x')")


def test_the_account_goes_into_json_whole(read):
    recording = read([*ROWS[:9], "x", *ROWS[9:]], delimiter="comma", missing=["-200"])
    plain = json.loads(json.dumps(finite(as_plain(recording)), allow_nan=False))
    assert plain["summary"] == summary(recording)
    assert (plain["lines"], plain["rows"], plain["rejected"], plain["headers"]) == (202, 200, 1, 1)
    assert plain["issues"][0]["line"] == 11
    assert plain["options"] == ["--delimiter", "comma", "--missing=-200"]
    assert {"--time-column", "--rate"} <= set(plain["overrule_with"])
    assert plain["notes"] == list(recording.report.notes)


def test_nothing_unprintable_of_a_file_is_said():
    issue = LineIssue(7, "must be a number", "\x1b[2J\u202e", "te\x07mp")
    report = ReadReport(lines=10, rows=9, rejected=1, bad_cells=9, issues=(issue, replace(issue, column=None)))
    recording = Recording(np.arange(9.0), ("a",), ("",), np.zeros((9, 1)), None, report)
    said = [summary(recording), *warnings(recording), *account(recording).splitlines()]
    assert all(c.isprintable() or c == THIN_SPACE for line in said for c in line)
