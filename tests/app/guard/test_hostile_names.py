"""Names of files, columns, serial labels and uploads are text wherever they appear.

One real program for all tests of this file, as a browser gets it.
"""

from __future__ import annotations

import re
from itertools import cycle
from pathlib import Path

import pytest
from tests.app.wire import Guest
from tests.support.line_sender import line_sender
from tests.support.program import end, labels, port_of, running, token_of

from kalscope.common.text import count
from kalscope_app.views import window
from kalscope_app.views.window import FIGURE, HEADING

MARKUP = ["<img src=x onerror=alert(1)>", "<script>alert(1)</script>", "[x](javascript:alert(1))"]
MARKUP += ["<iframe srcdoc='<script>alert(1)</script>'>", "![x](http://evil.example/x.png)", "a|b"]
MARKUP += ["=cmd|' /C calc'!A0", "$(touch pwned) `touch pwned`; touch pwned #", "../../etc/passwd"]
MARKUP += ["`code` **bold** # head", "*/ #define PWN 1", "a\u202eb\u2028c"]
ALIVE = re.compile(r"(?<!\\)(<[a-zA-Z/!]|\]\(|`code`|\*\*bold|!\[)")
"""Markup from outside that no backslash disarms."""
PIN = '<span style="color:#[0-9a-fA-F]{6}">■</span>'
"""The colour of a pinned setting, in tables."""


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """The program, and the folder in which it was started; at its end nothing outside has appeared."""
    folder = tmp_path_factory.mktemp("outer") / "work"
    folder.mkdir()
    with running(folder) as (program, url):
        yield folder, url
        assert end(program)[0] == 0
    assert [path for path in folder.parent.rglob("*") if path.name == "pwned"] == []
    assert [path.name for path in folder.parent.iterdir()] == ["work"]


@pytest.fixture
def guest(shared):
    _, url = shared
    with Guest(port_of(url), token_of(url)) as guest:
        guest.read_until(lambda: "Upload a file …" in labels(guest))
        yield guest
        for text in guest.texts:  # the dashboard's own has no image, link or tag
            foreign = re.sub(rf"{PIN}|{FIGURE}[^<]*</span>", "", text.replace(HEADING, ""))
            assert [found.group() for found in ALIVE.finditer(foreign)] == [], text
        # no text from outside is in them
        html = [made["props"]["content"] for made in guest.widgets.values() if made["type"] == "GuiHtmlMessage"]
        assert set(html) <= {text for text in vars(window).values() if isinstance(text, str)}


def wait_for_rows(guest, *numbers):
    """Until the recording on screen has one of these lengths."""
    shown = "|".join(map(str, numbers)).replace("\u202f", r"\s")
    wanted = re.compile(rf"\b({shown}) rows, ")
    guest.read_until(lambda: any(map(wanted.search, guest.markdown.values())))


def options_of(guest, uuid):
    return guest.widgets[uuid].get("props", {}).get("options") or ()


def open_file(guest, name, *rows):
    guest.set(guest.find("path"), name)
    guest.set(guest.find("Open this path"), True)
    wait_for_rows(guest, *rows)


def test_files_that_are_named_like_markup_are_shown_as_text(shared, guest):
    folder, _ = shared
    for rows, name in zip(range(50, 900, 10), MARKUP, strict=False):
        file = folder / f"{name.replace('/', '_')[:60]}.csv"
        head = f'time,"{name.replace(chr(34), "")}",plain\n'
        bad = f"bad {name},1\n"
        file.write_text(head + "".join(f"{i},{i % 7},{i % 3}\n" for i in range(rows)) + bad, "utf-8")
        open_file(guest, file.name, rows, rows + 1)  # the bad line counts where it splits well


def test_columns_and_units_that_are_markup_are_text_in_every_tab(shared, guest):
    folder, _ = shared
    names = [name.replace('"', "").replace("\u2028", "") for name in MARKUP]
    head = ",".join(f'"{name} [{name[:20].strip("[]()")}]"' for name in names)
    cells = "\n".join(",".join(str((i * k) % 11) for k in range(1, len(names) + 1)) for i in range(77))
    (folder / "columns.csv").write_text(f"{head}\n{cells}\n", "utf-8")
    open_file(guest, "columns.csv", 77)
    guest.set(next(uuid for uuid in guest.widgets if "Pin" in options_of(guest, uuid)), "Pin")
    for name in guest.widgets[guest.find("channel")]["props"]["options"][:2]:
        guest.set(guest.find("channel"), name)
        while guest.read(timeout=1.0):  # until the studies are drawn too: they begin 0.2 s after the last change
            pass
    guest.read_until(lambda: any("onerror" in text for text in guest.texts))


LABELS = [re.sub("[,;:\u2028]", " ", name) for name in MARKUP]
"""Without the marks that end a label or a value: a line with them would be text."""


def test_labels_that_a_board_sends_are_shown_as_text(guest):
    lines = [b"<script>alert(2)</script> **bold** starting\n"]
    lines += [
        ",".join(f"{name}:{(i * k) % 9}" for k, name in enumerate(LABELS, 1)).encode() + b"\n" for i in range(99)
    ]
    lines += [b"# <img src=x onerror=alert(3)>\n", b"<iframe srcdoc='x'>:1,2\n"]
    with line_sender(500.0, lambda: cycle(lines)) as address:
        guest.set(guest.find("port"), "Other address …")
        guest.set(guest.find("address"), address)
        guest.set(guest.find("Connect"), True)
        board = guest.find("board's filtered channel")
        guest.read_until(lambda: any("onerror" in option for option in options_of(guest, board)))
        guest.read_until(lambda: any("onerror" in text for text in guest.texts))
        guest.set(guest.find("Disconnect"), True)
        guest.read_until(lambda: any("**closed**" in text for text in guest.markdown.values()))


UPLOADS = "../../x.csv", "..\\..\\x.csv", "C:\\windows\\x.csv", "/etc/x.csv", "nul\0.csv", "-rf.csv", "con.csv"
UPLOADS += "a" * 300 + ".csv", "", ".", "..", *MARKUP[:4]


def test_an_upload_may_have_any_name_and_stays_in_its_own_folder(shared, guest):
    folder, _ = shared
    before = files_around(folder.parent)
    for i, name in enumerate(UPLOADS):
        rows = 1060 + i
        guest.upload(name, b"t,z\n" + b"".join(b"%d,%d\n" % (n, n % 5) for n in range(rows)))
        wait_for_rows(guest, count(rows))
    assert files_around(folder.parent) == before


def files_around(folder: Path):
    """Every file that is there, but for the program's own state."""
    return {path for path in folder.rglob("*") if "state" not in path.parts and "numba" not in str(path)}


OUT = "../out.csv", "/tmp/kalscope-out.csv", "..\\..\\out", "a\0b.csv", "link/out.csv", ".bashrc", "x.sh", " "
OUT += "nul.csv", "com1.a.csv"
"""Paths that no recording may have. Those that only the system refuses need a board that sends."""


def test_nothing_is_recorded_outside_the_folder_or_under_an_odd_name(shared, guest):
    folder, _ = shared
    (folder / "link").symlink_to(folder.parent)
    before = files_around(folder.parent)
    for path in OUT:
        guest.notices.clear()
        guest.set(guest.find("record to"), path)
        guest.set(guest.find("Record"), True)
        guest.read_until(lambda: re.search("Cannot record|Something went wrong", "".join(guest.notices)))
        assert "Cannot record" in (told := "".join(guest.notices)), path
        assert "is not connected" not in told, path
    assert files_around(folder.parent) == before
