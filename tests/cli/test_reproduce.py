"""`kalscope reproduce`: its numbers, its page and its pictures."""

from __future__ import annotations

import json
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
from tests.support.hostile_names import TERMINAL
from tests.support.html_page import Page

from kalscope.cli.app import run
from kalscope.common.charts import Line, Panel, draw_svg
from kalscope.common.text import CONTROL
from kalscope.papers import reproduction


@pytest.fixture(scope="module")
def chapters():
    return reproduction.reproduce().chapters


def reproduce(chapters, folder, *options):
    """The status of the command for these chapters, which take seconds to make."""
    modules = reproduction.maarif_2019, reproduction.khan, reproduction.interactive_matter_2009
    with pytest.MonkeyPatch.context() as patch:
        for module, chapter in zip(modules, chapters, strict=True):
            patch.setattr(module, "chapter", lambda *_, chapter=chapter: chapter)
        return run(["reproduce", "-o", str(folder), *options])


@pytest.mark.slow
def test_results_hold_table_1_and_every_check_and_the_page_needs_nothing_else(chapters, tmp_path, capsys):
    folder = tmp_path / "new" / "folder"
    assert reproduce(chapters, folder, "--json") == 0
    assert sorted(path.name for path in folder.iterdir()) == ["index.html", "results.json"]
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert results == json.loads(capsys.readouterr().out)
    rows = results["noise_reducer"]["table_1"]
    assert [row["printed"] for row in rows] == [26.0677, 44.7392, 53.4466, 53.4541, 56.9959]
    for row in rows:
        assert row["simulated"] == pytest.approx(row["printed"], rel=0.02)
        assert row["theoretical"] == pytest.approx(row["printed"], rel=0.02)
    assert results["passed"]
    assert all(check["passed"] for check in results["checks"])
    assert {"generalized", "lis302dl", "disagreements"} <= set(results)

    html = (folder / "index.html").read_text(encoding="utf-8")
    reader = Page(html)
    assert reader.open == []
    assert not {"script", "link", "img", "iframe"} & set(reader.tags)
    assert not [(key, value) for key, value in reader.attributes if key in ("src", "onload", "onclick")]
    assert all(value.startswith("#") for key, value in reader.attributes if key == "href")
    assert "url(" not in html
    text = " ".join(reader.text)
    for words in ("26.0677", "Figures 3–8", "Figure 10", "The walk", "Where a paper disagrees with itself"):
        assert words in text
    assert html.count('class="verdict"') == reader.tags.count("h3")
    pictures = re.findall(r"<svg.*?</svg>", html, re.DOTALL)
    assert len(pictures) == 10
    for picture in pictures:
        root = ElementTree.fromstring(picture)
        _, _, width, height = map(float, root.get("viewBox").split())
        assert root.get("aria-label")
        assert "nan" not in picture.lower().replace("resonan", "")
        for path in root.iter("{http://www.w3.org/2000/svg}path"):
            points = np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", path.get("d")), dtype=float)
            assert (points >= 0).all()
            assert (points <= (width, height)).all()


@pytest.mark.slow
def test_a_number_outside_its_tolerance_is_status_1_and_one_line(chapters, tmp_path, capsys):
    first, *others = chapters
    missed = [replace(one, tolerance=1e-6) if one.name.startswith("Table 1") else one for one in first.checks]
    folder = tmp_path / "".join(TERMINAL).replace("\0", "")
    assert reproduce((replace(first, checks=tuple(missed)), *others), folder) == 1
    out, err = capsys.readouterr()
    assert "]52;c;ZXZpbA==" in out
    assert not CONTROL.search(out)
    assert err.count("\n") == 1
    assert re.match(r"kalscope: 10 of \d+ numbers are outside their tolerance: Table 1, row 1 .*got 26\.", err)
    assert "26.0677" in out
    assert not json.loads((folder / "results.json").read_text(encoding="utf-8"))["passed"]
    assert "Numbers outside their tolerance, of 36" in (folder / "index.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_threads_draw_the_same_bytes_and_leave_the_settings_alone():
    def chart(_=None):
        t, name = np.linspace(0.0, 1.0, 50), "µ $x^2$ 温度"
        lines = (Line(t, np.sin(9 * t), "raw", "raw"), Line(t, np.cos(9 * t), name, "s2"))
        return draw_svg([Panel(name, lines, name, name)] * 2, name, columns=2)

    expected = chart()
    others = {"svg.fonttype": "path", "font.size": 40, "axes.grid": False, "text.parse_math": True}
    with matplotlib.rc_context(others):
        before = dict(matplotlib.rcParams)
        with ThreadPoolExecutor(4) as threads:
            assert set(threads.map(chart, range(4))) == {expected}
        assert dict(matplotlib.rcParams) == before
