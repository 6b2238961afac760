"""Each refusal names the line, what must hold, what came, and what to try."""

import pytest

from kalscope.errors import BadFile
from kalscope.sources.grammar.read_options import options_from_text
from kalscope.sources.reading.recording_file import read_recording

LFS = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a214614ab2935c943f9e0ff69d22e\n"
WORDS = ["boot ok", "sensor found", "reading", "wait 3 s", "again", "no answer", "", "still nothing"]

REFUSED = {
    "empty": ("", ["empty file"]),
    "blank": ("\n\n# nothing yet\n\n", ["must hold lines of numbers", "4 blank or comment lines"]),
    "only a header": ("\nt,temp,dist\n", ["below its header", "only line 2: 't,temp,dist'"]),
    "a pointer": (f"{LFS}size 48211\n", ["Git LFS pointer", "git lfs pull"]),
    "a web page": (
        "\n<!DOCTYPE html>\n<html><body>404</body></html>\n",
        ["a web page", "line 2", "download the file itself"],
    ),
    "a page without its type": ("<html>\n<p>1,2,3\n</html>\n", ["a web page"]),
    "a track": ('<?xml version="1.0"?>\n<gpx>\n<ele>1.5</ele>\n</gpx>\n', ["an XML document", "line 1"]),
    "words": (
        "\n".join(WORDS * 9),
        ["must be a table of numbers", "text such as line 72: 'still nothing'", "try --"],
    ),
    "no width in common": (
        "".join(f"{','.join(['1.5'] * (2 + i % 7))}\n" for i in range(50)),
        ["all of one width", "2 fields in line 1, 3 fields in line 2", "lines of one width"],
    ),
    "too wide": (
        ",".join(f"c{i}" for i in range(300)) + "\n" + (",".join(map(str, range(300))) + "\n") * 50,
        ["at most 256 columns", "300 fields in line 2", "write the columns"],
    ),
    "only times": ("time,state\n" + "".join(f"{i},ok\n" for i in range(30)), ["besides the time", "'29,ok'"]),
    "binary": ("ab\n\x00\x01\x02\x00\x05", ["binary data", "0x00, on line 2"]),
}


@pytest.mark.parametrize(("text", "said"), REFUSED.values(), ids=REFUSED)
def test_a_refusal_says_where_and_what_to_try(tmp_path, text, said):
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8", newline="")
    with pytest.raises(BadFile) as refused:
        read_recording(path)
    message = str(refused.value)
    assert message.startswith("log.csv must ")
    assert "(got" in message
    assert [words for words in said if words not in message] == []
    assert "\n" not in message
    assert len(message) < 400


def test_options_that_leave_no_table_are_named(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("".join(f"{i};{i % 3}.5;x\n" for i in range(50)))
    read_recording(path)
    with pytest.raises(BadFile, match=r"leave out --delimiter bar"):
        read_recording(path, options_from_text(delimiter="bar"))


def test_a_head_that_promised_more_than_the_lines_hold_names_the_first(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("1,2*00\n3,4*00\n5,6*00\n" * 20)
    with pytest.raises(BadFile, match=r"60 rejected lines, line 1: must end with the checksum .* '1,2\*00'"):
        read_recording(path)
