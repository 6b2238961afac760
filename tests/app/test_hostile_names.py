"""Names of files, columns and uploads are text wherever they appear: the real program, as a browser gets it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from test_running import end, labels, port_of, running, token_of
from wire import PATIENCE, Guest, messages_in

MARKUP = [
    "<img src=x onerror=alert(1)>",
    "<script>alert(1)</script>",
    "<iframe srcdoc='<script>alert(1)</script>'>",
    "![x](http://evil.example/x.png)",
    "[x](javascript:alert(1))",
    "`code` **bold** # head",
    "=cmd|' /C calc'!A0",
    "a|b",
    "$(touch pwned) `touch pwned`; touch pwned #",
    "../../etc/passwd",
    "*/ #define PWN 1",
    "a\u202eb\u2028c",
]
ALIVE = re.compile(r"(?<!\\)(<[a-zA-Z/!]|\]\(|`code`|\*\*bold|!\[)")
"""Markup from outside that no backslash disarms."""


def markdown_of(guest, done):
    """All markdown that a browser is sent, until `done` says that enough has come."""
    texts = {}
    while not done("\n".join(texts.values())):
        frame = guest.connection.recv(timeout=PATIENCE)
        for message in messages_in(frame):
            guest._take(message)
            props = message.get("props") or {}
            content = (
                props.get("_markdown")
                or message.get("updates", {}).get("_markdown")
                or props.get("content")
                or message.get("updates", {}).get("content")
            )
            if isinstance(content, str):
                texts[message["uuid"]] = content
    return "\n".join(texts.values())


def assert_disarmed(markdown):
    """Nothing of ours in the markdown is an image, a link or a tag, so whatever is came from outside."""
    assert [found.group() for found in ALIVE.finditer(without_code(markdown))] == []


def without_code(markdown):
    """Inside a code span of ours nothing acts; the view puts no name with a backtick there."""
    return re.sub(r"`kalscope [^`]*`", "", markdown)


def test_files_and_columns_that_are_named_like_markup_are_shown_as_text(tmp_path):
    with running(tmp_path) as (program, url), Guest(port_of(url), token_of(url)) as guest:
        guest.read_until(lambda: "Open this path" in labels(guest))
        for rows, name in zip(range(50, 900, 10), MARKUP, strict=False):
            file = tmp_path / f"{name.replace('/', '_')[:60]}.csv"
            head = f'time,"{name.replace(chr(34), "")}",plain\n'
            bad = f"bad {name},1\n"
            file.write_text(head + "".join(f"{i},{i % 7},{i % 3}\n" for i in range(rows)) + bad, "utf-8")
            guest.set(guest.find("path"), file.name)
            guest.set(guest.find("Open this path"), True)
            either = re.compile(rf"\b({rows}|{rows + 1}) samples")  # the bad line counts where it splits well
            assert_disarmed(markdown_of(guest, either.search))
        assert end(program)[0] == 0
    assert not (tmp_path / "pwned").exists()


UPLOADS = [
    "../../x.csv",
    "..\\..\\x.csv",
    "C:\\windows\\x.csv",
    "/etc/x.csv",
    "nul\0.csv",
    "a" * 300 + ".csv",
    "",
    ".",
    "..",
    "-rf.csv",
    "con.csv",
    *MARKUP[:4],
]


def test_an_upload_may_have_any_name_and_stays_in_its_own_folder(tmp_path):
    (tmp_path / "tmp").mkdir()
    before = files_around(tmp_path)
    with running(tmp_path) as (program, url), Guest(port_of(url), token_of(url)) as guest:
        guest.read_until(lambda: "Upload a file …" in labels(guest))
        button = guest.find("Upload a file …")
        for i, name in enumerate(UPLOADS):
            rows = 60 + i
            content = b"t,z\n" + b"".join(b"%d,%d\n" % (n, n % 5) for n in range(rows))
            guest.send(
                "FileTransferStartUpload",
                source_component_uuid=button,
                transfer_uuid=f"t{i}",
                filename=name,
                mime_type="text/csv",
                part_count=1,
                size_bytes=len(content),
            )
            guest.send(
                "FileTransferPart",
                source_component_uuid=button,
                transfer_uuid=f"t{i}",
                part_index=0,
                content=content,
            )
            shown = markdown_of(guest, lambda text, rows=rows: f"{rows} samples" in text)
            assert_disarmed(shown)
        assert end(program)[0] == 0
    assert files_around(tmp_path) == before


def files_around(folder: Path):
    """Every file that is there, but for the program's own state."""
    return {path for path in folder.rglob("*") if "state" not in path.parts and "numba" not in str(path)}


@pytest.mark.parametrize("path", ["../out.toml", "/tmp/out.toml", "..\\..\\out", "a\0b.toml", ".bashrc", "x.sh"])
def test_the_tuning_file_stays_in_the_folder(tmp_path, path):
    work = tmp_path / "work"
    work.mkdir()
    with running(work) as (program, url), Guest(port_of(url), token_of(url)) as guest:
        guest.read_until(lambda: "Save tuning file" in labels(guest))
        guest.set(guest.find("tuning file"), path)
        guest.set(guest.find("Save tuning file"), True)
        guest.read_until(lambda: "must" in "".join(guest.notices))
        assert end(program)[0] == 0
    assert [each for each in tmp_path.rglob("*") if each.suffix in (".toml", ".sh") or "out" in each.name] == []
