"""What charts and pictures draw can be told from its background, in both themes: WCAG 2.2, 1.4.3 and 1.4.11.

Texts of the page itself are judged in the browser: `test_accessibility.py`.
"""

from __future__ import annotations

import dataclasses

import pytest

from kalscope_app.session import state
from kalscope_app.views.chart_tabs import COLOURS
from kalscope_app.views.charts import DARK, LIGHT, SENSORS
from kalscope_app.views.map import DARK_MAP, LIGHT_MAP
from kalscope_app.views.phone import ink_on, luminance

PAPER = {False: "#ffffff", True: "#242424"}
"""Behind the charts, light and dark: Mantine's white and dark 7."""
TEXT, GRAPHICS = 4.5, 3.0


def contrast(one, other):
    """Of two colours, #rrggbb: 1 to 21."""
    low, high = sorted(map(luminance, (one, other)))
    return (high + 0.05) / (low + 0.05)


def test_the_contrast_is_that_of_wcag():
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.005)  # the greys around its limit
    assert contrast("#767676", "#ffffff") == pytest.approx(4.54, abs=0.005)


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_every_line_of_a_chart_stands_out(dark):
    palette = dataclasses.asdict(DARK if dark else LIGHT)
    lines = [colour for colour in palette.values() if colour.startswith("#")]
    lines += [*SENSORS[dark], *COLOURS[dark], *(state.DARK if dark else state.LIGHT)]
    assert len(lines) > 25
    assert [colour for colour in lines if contrast(colour, PAPER[dark]) < GRAPHICS] == []


@pytest.mark.parametrize("palette", [LIGHT_MAP, DARK_MAP], ids=["light", "dark"])
def test_words_and_marks_of_the_map_can_be_read(palette):
    assert min(contrast(ink, palette.background) for ink in (palette.ink, palette.quiet)) >= TEXT
    assert contrast(palette.point, palette.background) >= GRAPHICS


def test_the_letter_on_a_badge_can_be_read_on_any_colour():
    for red in range(0, 256, 15):
        for green in range(0, 256, 15):
            for blue in range(0, 256, 15):
                colour = f"#{red:02x}{green:02x}{blue:02x}"
                assert contrast(ink_on(colour), colour) >= TEXT
