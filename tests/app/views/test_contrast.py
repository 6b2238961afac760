"""What charts and pictures draw can be told from its background, in both themes: WCAG 2.2, 1.4.3 and 1.4.11.

Texts of the page itself are judged in the browser: `test_accessibility.py`.
"""

from __future__ import annotations

import numpy as np
import pytest

from kalscope_app.session import state
from kalscope_app.views.charts import DARK, LIGHT

PAPER = {False: "#ffffff", True: "#242424"}
"""Behind the charts, light and dark: Mantine's white and dark 7."""
TEXT, GRAPHICS = 4.5, 3.0


def linear(colour):
    """Linear red, green and blue of #rrggbb, 0 … 1."""
    parts = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return np.array([part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts])


def luminance(colour):
    """0 = black, 1 = white."""
    return linear(colour) @ [0.2126, 0.7152, 0.0722]


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
    palette = DARK if dark else LIGHT
    pictures = ("paper", "ink", "quiet", "best")
    lines = [one for name, one in vars(palette).items() if name not in pictures and str(one).startswith("#")]
    lines += [*palette.sensors, *palette.alternatives, *(state.DARK if dark else state.LIGHT)]
    assert len(lines) > 25
    assert [colour for colour in lines if contrast(colour, PAPER[dark]) < GRAPHICS] == []


@pytest.mark.parametrize("palette", [LIGHT, DARK], ids=["light", "dark"])
def test_words_and_marks_of_the_map_can_be_read(palette):
    assert min(contrast(ink, palette.paper) for ink in (palette.ink, palette.quiet)) >= TEXT
    assert contrast(palette.filtered, palette.paper) >= GRAPHICS


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_deuteranope_can_tell_the_first_sensors_and_the_fused_line(dark):
    # Machado, Oliveira and Fernandes (2009): what a deuteranope sees, in linear RGB; then distances in CIELAB.
    sees = np.array([[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]])
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    palette = DARK if dark else LIGHT
    colours = [palette.filtered, *palette.sensors[:3]]
    x, y, z = np.cbrt(to_xyz @ (sees @ np.array([linear(one) for one in colours]).T).clip(1e-3, 1.0))
    lab = np.stack([116 * y, 500 * (x / 0.983 - y), 200 * (y - z / 1.029)], axis=1)
    distances = np.linalg.norm(lab[:, None] - lab, axis=2)
    assert distances[np.triu_indices(4, 1)].min() > 25
