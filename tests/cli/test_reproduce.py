"""`kalscope reproduce`: the command end to end, the page, its parts and its charts."""

from __future__ import annotations

import json
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.support.hostile_names import TERMINAL
from tests.support.html_page import Page
from tests.support.program import command
from tests.support.waiting import PATIENCE

from kalscope.cli import app as cli
from kalscope.common.charts import Line, Panel, draw_svg, markup_of_table
from kalscope.common.text import CONTROL
from kalscope.papers import reproduction
from kalscope.papers.document import Block, Chapter, Check, page


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory):
    """One run of the program; returns its folder and what it printed."""
    folder = tmp_path_factory.mktemp("reproduced") / "new" / "folder"
    with command("reproduce", "-o", folder, "--json") as program:
        out, err = program.communicate(timeout=PATIENCE)
    assert (program.returncode, err) == (0, "")
    return folder, out


def test_results_hold_table_1_and_every_check(reproduced):
    folder, printed = reproduced
    assert sorted(path.name for path in folder.iterdir()) == ["index.html", "results.json"]
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert results == json.loads(printed)
    rows = results["noise_reducer"]["table_1"]
    assert [row["printed"] for row in rows] == [26.0677, 44.7392, 53.4466, 53.4541, 56.9959]
    for row in rows:
        assert row["simulated"] == pytest.approx(row["printed"], rel=0.02)
        assert row["theoretical"] == pytest.approx(row["printed"], rel=0.02)
    assert results["passed"]
    assert all(check["passed"] for check in results["checks"])
    assert {"generalized", "lis302dl", "disagreements"} <= set(results)


def test_the_page_is_whole_and_needs_nothing_else(reproduced):
    html = (reproduced[0] / "index.html").read_text(encoding="utf-8")
    reader = Page(html)
    assert reader.open == []
    assert not {"script", "link", "img", "iframe"} & set(reader.tags)
    assert not [(key, value) for key, value in reader.attributes if key in ("src", "onload", "onclick")]
    assert all(value.startswith("#") for key, value in reader.attributes if key == "href")
    assert "url(" not in html
    assert "prefers-color-scheme:dark" in html
    text = " ".join(reader.text)
    for words in ("26.0677", "Figures 3–8", "Figure 10", "The walk", "Where a paper disagrees with itself"):
        assert words in text
    assert reader.tags.count("svg") == 10
    assert html.count('class="verdict"') == reader.tags.count("h3")


def test_every_picture_is_well_formed_and_inside_its_frame(reproduced):
    html = (reproduced[0] / "index.html").read_text(encoding="utf-8")
    for text in re.findall(r"<svg.*?</svg>", html, re.DOTALL):
        root = ElementTree.fromstring(text)
        _, _, width, height = map(float, root.get("viewBox").split())
        assert root.get("aria-label")
        assert "nan" not in text.lower().replace("resonan", "")
        for path in root.iter("{http://www.w3.org/2000/svg}path"):
            points = np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", path.get("d")), dtype=float)
            assert (points >= 0).all()
            assert (points <= (width, height)).all()


@pytest.mark.slow
def test_a_number_outside_its_tolerance_is_status_1_and_one_line(tmp_path, monkeypatch, capsys):
    first, *others = reproduction.reproduce().chapters
    missed = [replace(one, tolerance=1e-6) if one.name.startswith("Table 1") else one for one in first.checks]
    chapters = replace(first, checks=tuple(missed)), *others
    pages = reproduction.maarif_2019, reproduction.khan, reproduction.interactive_matter_2009
    for module, chapter in zip(pages, chapters, strict=True):
        monkeypatch.setattr(module, "chapter", lambda *_, chapter=chapter: chapter)
    tmp_path /= "".join(TERMINAL).replace("\0", "")
    assert cli.run(["reproduce", "-o", str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert "]52;c;ZXZpbA==" in out
    assert not CONTROL.search(out)
    assert err.count("\n") == 1
    assert re.match(r"kalscope: 10 of \d+ numbers are outside their tolerance: Table 1, row 1 .*got 26\.", err)
    assert "26.0677" in out
    assert not json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["passed"]
    assert "Numbers outside their tolerance, of 36" in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_the_page_escapes_every_word():
    evil = '<script>alert(1)</script>&"'
    svg = draw_svg([Panel(evil, (Line([0, 1], [0, 1], evil, "s1"),), evil, evil)], evil)
    ElementTree.fromstring(svg)
    blocks = [Block("name", evil, body, evil, evil, ()) for body in (svg, markup_of_table((evil,), ((evil,),)))]
    chapter = Chapter("key", evil, evil, (evil,), tuple(blocks), (Check(evil, 9.0, 1.0, 0.1),))
    html = page([chapter], evil)
    assert "<script" not in html
    assert Page(html).open == []


def chart(name="µ $x^2$ 温度"):
    t = np.linspace(0.0, 1.0, 50)
    lines = (Line(t, np.sin(9 * t), "raw", "raw"), Line(t, np.cos(9 * t), name, "s2"))
    return draw_svg([Panel(name, lines, name, name)] * 2, name, columns=2)


@pytest.mark.slow
def test_threads_draw_the_same_bytes_and_leave_the_settings_alone():
    import matplotlib

    expected = chart()
    with matplotlib.rc_context(
        {"svg.fonttype": "path", "font.size": 40, "axes.grid": False, "text.parse_math": True}
    ):
        before = dict(matplotlib.rcParams)
        with ThreadPoolExecutor(4) as threads:
            assert set(threads.map(lambda _: chart(), range(4))) == {expected}
        assert dict(matplotlib.rcParams) == before
