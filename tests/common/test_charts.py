"""Charts: the same bytes from every thread, whatever the user's matplotlib settings are."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from xml.etree import ElementTree

import numpy as np
import pytest

from kalscope.common.charts import Line, Panel, draw_svg


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


def test_a_chart_is_text_and_paths_without_references_or_identifiers():
    root = ElementTree.fromstring(chart())
    used = {element.tag.rpartition("}")[2] for element in root.iter()}
    assert used == {"svg", "defs", "style", "g", "path", "text"}
    assert not any(element.get("id") or "url(" in str(element.attrib) for element in root.iter())
    assert "µ $x^2$ 温度" in {element.text for element in root.iter()}
