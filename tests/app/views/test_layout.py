"""The layout without the page script, and what the script is given. Browser tests show that it fills windows."""

from __future__ import annotations

import json
import re

from kalscope_app.views.signal import SHARES
from kalscope_app.views.window import (
    CHROME_HEIGHT,
    FRAME_HEIGHT,
    LEFT_WIDTH,
    PHONE_CHECKBOX,
    RIGHT_WIDTH,
    RIGHT_WIDTH_WITHOUT_MAP,
    SIZES,
    WINDOW_HEIGHT,
    height_of,
    page_script,
)


def test_the_charts_of_the_signal_tab_fill_its_height():
    for charts, shares in SHARES.items():
        heights = [height_of(share, charts) for share in shares]
        assert sum(heights) == WINDOW_HEIGHT - CHROME_HEIGHT - charts * FRAME_HEIGHT
        assert heights[0] > sum(heights[1:])
    assert LEFT_WIDTH + RIGHT_WIDTH + SIZES["minMap"] < 1440
    assert LEFT_WIDTH + RIGHT_WIDTH_WITHOUT_MAP + SIZES["noMap"] <= 1440


def test_the_script_knows_the_sizes_and_ends_no_script_element():
    script = page_script()
    assert json.loads(re.search(r"const sizes = (\{.*?\});", script)[1]) == SIZES
    assert SIZES["phone"] == PHONE_CHECKBOX
    assert "</script" not in script.lower()
    for used in re.findall(r"sizes\.(\w+)", script):
        assert used in SIZES
