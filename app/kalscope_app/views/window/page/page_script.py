"""The script that fits the layout to each browser's window, in the page itself: no measuring, no round trip.

viser has fixed sizes only, the same for every browser. The script runs before viser's own code and changes the
sizes in the server's messages as they arrive, so the first picture already fills the window. When the window is
resized it repeats those messages with new sizes. Without the script the layout fits a window of 1440 × 900 px.

It also lets the charts write the numbers under the mouse to six digits, and their ticks as the texts write numbers;
uPlot itself writes three decimals, so 0 for any value below 0.0005, and marks a sample that is missing in the
corner of the chart.

`keep_up.js` keeps a slow browser from falling behind a board, `text_boxes.js` decides when a typed text is sent and
when it may be overwritten, `keyboard.js` makes the page work without a mouse, `scene.js` without WebGL,
`stopped.js` says that the program has ended, and `map.js` beside `views/map/view.py` shows the tuning map.
"""

from __future__ import annotations

import json
from importlib.resources import files

from kalscope_app.views.window.css import RULES
from kalscope_app.views.window.layout import (
    CHROME_HEIGHT,
    LEFT_WIDTH,
    RIGHT_WIDTH,
    RIGHT_WIDTH_WITHOUT_MAP,
    WINDOW_HEIGHT,
)

APPLY_RULES = f"""{{ const style = new CSSStyleSheet();
style.replaceSync({json.dumps(RULES)});
document.adoptedStyleSheets.push(style); }}
"""
"""Adopted rules take precedence over those of viser's own style, wherever it puts them."""

PHONE_CHECKBOX = "phone"
"""Label of the hidden checkbox with which a page reports whether it is on a phone."""

ZOOM_SLIDER = "zoom"
"""Label of the hidden slider with which a page asks for the part of the window that was dragged over."""

MAP_PICTURE, MAP_MARK = "map picture", "map mark"
"""Labels of the hidden images that the page shows as the tuning map."""

MAP_PRESENT = "map present"
"""Label of the hidden vector with the position of the mark, in shares of the picture; below 0: there is none."""

MAP_POINTED = "map pointed"
"""Label of the hidden vector with which a page reports where the user points, in shares of the picture, and in
which gesture: a number for each, negative for a click, positive for a drag."""

EXPORT_BUTTON, EXPORT_TAB = "Export this one", "Export"
"""Label of the button that leads to another tab, and of that tab: viser cannot open a tab itself."""

TYPED, OTHER_RATE = "Other address …", "another"
"""The options of the menus of ports and of baud rates that stand for what is in the text box below."""

TEXT_BOXES = {"port": [TYPED, "address"], "baud rate": [OTHER_RATE, "rate"]}
"""Menus into which a user may type what is no option: the option for that, and the label of its text box."""

SIZES = {
    "scene": 'canvas[width="0"] + div:not([class])',  # the box of viser's 3-D scene
    "phone": PHONE_CHECKBOX,
    "zoom": ZOOM_SLIDER,
    "phoneWidth": "(max-width: 36em)",  # viser then shows one sheet instead of panels
    "left": LEFT_WIDTH + 10,  # px, with the edges that viser adds to both panels
    "withMap": RIGHT_WIDTH,
    "withoutMap": RIGHT_WIDTH_WITHOUT_MAP,
    "mapFrom": 1100,  # px; a narrower window has no map
    "minMap": 300,  # px
    "mapShare": 0.38,  # of the width beside the control panel, at most
    "mapShape": 0.5,  # width : height at most
    "noMap": 120,  # px of canvas that viser keeps in any case
    "height": WINDOW_HEIGHT,
    "minHeight": CHROME_HEIGHT + 480,  # px; lower windows scroll
    "mapPicture": MAP_PICTURE,
    "mapMark": MAP_MARK,
    "mapPresent": MAP_PRESENT,
    "mapPointed": MAP_POINTED,
    "mapGrip": 0.04,  # of the picture's width: nearer to the mark a drag grabs it; from farther away the mark jumps
    "exportButton": EXPORT_BUTTON,
    "exportTab": EXPORT_TAB,
    "textBoxes": TEXT_BOXES,
    "typingPause": 900,  # ms without a key after which a complete number counts without Enter
}


NAMES = "keep_up", "stopped", "scene", "page_script", "text_boxes", "keyboard"
"""The scripts beside this module, in the order in which they get each message."""


def page_script() -> str:
    """The script for the head of the page."""
    views, sizes = files("kalscope_app.views"), json.dumps(SIZES)
    scripts = *(f"window/page/{name}.js" for name in NAMES), "map/map.js"
    parts = (views.joinpath(script).read_text("utf-8") for script in scripts)
    return APPLY_RULES + "".join(f"{{ const sizes = {sizes};\n{part}}}\n" for part in parts)
