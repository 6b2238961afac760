"""How a recording was read, in one line, in warnings and in full; each refusal says where and what to try."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from kalscope.cli.tune_answer import finite
from kalscope.common.text import THIN_SPACE
from kalscope.errors import BadFile
from kalscope.recording import LineIssue, ReadReport, Recording
from kalscope.sources.reading.account import account, as_plain, summary, warnings

ROWS = [f"{i / 50:.2f},{20 + i % 3},{i % 5}" for i in range(200)]


def table(lines):
    return "\n".join(["t,temp,dist", *lines, ""])


def test_a_clean_file_is_summed_up_in_one_line_with_its_many_comments(read):
    assert summary(read(table(["# a remark", *ROWS]))) == "200 rows, 2 channels, 50.0 Hz"
    assert summary(read(table([*["# a remark"] * 9, *ROWS]))).endswith("50.0 Hz; 9 comment and text lines")
    assert warnings(read(table(ROWS))) == ()


def test_more_than_two_percent_of_rejected_lines_are_a_warning(read):
    assert warnings(read(table([*ROWS, *["status ok,1"] * 4]))) == ()
    many = read(table([*ROWS[:100], *["status ok,1"] * 5, *ROWS[100:]]))
    (said,) = warnings(many)
    assert said.startswith("2.4 % of the lines were rejected, the first is line 102: must have 3 fields (got 2)")
    assert "(got 'status ok,1')" in said
    assert "  warning: 2.4 % of the lines" in account(many)


def test_many_cells_without_a_number_are_a_warning(read):
    spoilt = [row if i % 10 else row[: row.rindex(",")] + f",E{i}x" for i, row in enumerate(ROWS)]
    recording = read(table(spoilt))
    assert "; 20 cells without a number" in summary(recording)
    (said,) = warnings(recording)
    assert said.startswith('5.0 % of the cells are not numbers, the first is line 2, "dist": must be a number')
    assert said.endswith("(got 'E0x')")


def test_the_account_goes_into_json_whole(read):
    recording = read(table([*ROWS[:9], "x", *ROWS[9:]]), delimiter=",", missing=(-200.0,))
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


LFS = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a214614ab2935c943f9e0ff69d22e\n"
WORDS = ["boot ok", "sensor found", "reading", "wait 3 s", "again", "no answer", "", "still nothing"]

REFUSED = {
    "empty": ("", ["empty file"]),
    "blank": ("\n\n# nothing yet\n\n", ["must hold lines of numbers", "4 blank or comment lines"]),
    "only a header": ("\nt,temp,dist\n", ["below its header", "only line 2: 't,temp,dist'"]),
    "a pointer": (f"{LFS}size 48211\n", ["Git LFS pointer", "git lfs pull"]),
    "a web page": ("\n<!DOCTYPE html>\n<html><body>404</body></html>\n", ["a web page", "line 2", "download the"]),
    "a page without its type": ("<html>\n<p>1,2,3\n</html>\n", ["a web page"]),
    "a track": ('<?xml version="1.0"?>\n<gpx>\n<ele>1.5</ele>\n</gpx>\n', ["an XML document", "line 1"]),
    "words": ("\n".join(WORDS * 9), ["must be a table of numbers", "text such as line 72: 'still", "try --"]),
    "no width in common": ("".join(f"{','.join(['1.5'] * (2 + i % 7))}\n" for i in range(50)),
        ["all of one width", "2 fields in line 1, 3 fields in line 2", "lines of one width"]),
    "too wide": (",".join(f"c{i}" for i in range(300)) + "\n" + (",".join(map(str, range(300))) + "\n") * 50,
        ["at most 256 columns", "300 fields in line 2", "write the columns"]),
    "only times": ("time,state\n" + "".join(f"{i},ok\n" for i in range(30)), ["besides the time", "'29,ok'"]),
    "binary": ("ab\n\x00\x01\x02\x00\x05", ["binary data", "0x00, on line 2"]),
}  # fmt: skip


@pytest.mark.parametrize(("text", "said"), REFUSED.values(), ids=REFUSED)
def test_a_refusal_says_where_and_what_to_try(read, text, said):
    with pytest.raises(BadFile) as refused:
        read(text)
    assert re.fullmatch(r"log\.csv must .*\(got.{1,380}", str(refused.value))
    assert [words for words in said if words not in str(refused.value)] == []


def test_options_that_leave_no_table_are_named(read):
    with pytest.raises(BadFile, match=r"leave out --delimiter bar"):
        read("".join(f"{i};{i % 3}.5;x\n" for i in range(50)), delimiter="|")


def test_a_head_that_promised_more_than_the_lines_hold_names_the_first(read):
    with pytest.raises(BadFile, match=r"60 rejected lines, line 1: must end with the checksum .* '1,2\*00'"):
        read("1,2*00\n3,4*00\n5,6*00\n" * 20)
