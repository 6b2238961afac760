"""Formulas of the site: $…$ in a sentence and $$…$$ on lines of their own are drawn while the site is built.

matplotlib draws them as outlines in an <svg>, in the colour of the text: a page needs no script and no font.
"""

from __future__ import annotations

import html
import re

from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser
from matplotlib.path import Path
from matplotlib.textpath import TextPath

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
"""What the extension pymdownx.arithmatex makes of a formula: a span in a sentence, a div on lines of its own."""
FONT = FontProperties(math_fontfamily="stix", size=100)
EM = 90.0
"""Units of a drawing for one em of the text around it: letters of this font are smaller than those of the theme."""
MARGIN = 4.0
"""Units around a drawing: a stroke may go beyond its box."""
COMMANDS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C", Path.CLOSEPOLY: "Z"}


def on_page_content(page_html: str, **_: object) -> str:
    """Called by mkdocs."""
    return FORMULA.sub(drawn, page_html)


def drawn(found: re.Match[str]) -> str:
    """A formula as an <svg> on the baseline of its sentence.

    Raises:
        ValueError: matplotlib's mathtext cannot draw the formula.
    """
    kind, formula = found[1], " ".join(html.unescape(found[2]).split())
    text = f"${formula}$"
    width, height, depth, *_ = MathTextParser("path").parse(text, dpi=72, prop=FONT)
    box = (-MARGIN, -height + depth - MARGIN, width + 2 * MARGIN, height + 2 * MARGIN)
    size = f"width:{box[2] / EM:.3f}em;height:{box[3] / EM:.3f}em;vertical-align:{-(depth + MARGIN) / EM:.3f}em"
    view = " ".join(f"{edge:.1f}" for edge in box)
    path = f'<path fill="currentColor" d="{outline(text)}"/>'
    svg = f'<svg role="img" aria-label="{html.escape(formula)}" style="{size}" viewBox="{view}">{path}</svg>'
    return f'<{kind} class="formula">{svg}</{kind}>'


def outline(text: str) -> str:
    """The letters of a formula as the outline of an SVG path."""
    parts: list[str] = []
    for points, command in TextPath((0, 0), text, prop=FONT).iter_segments(simplify=False):
        numbers = () if command == Path.CLOSEPOLY else points.reshape(-1, 2) * (1, -1)
        parts.append(COMMANDS[command] + " ".join(f"{x:.1f} {y:.1f}" for x, y in numbers))
    return "".join(parts)
