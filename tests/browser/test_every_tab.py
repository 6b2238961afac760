"""Every tab of both panels, in a small light and a large dark window: nothing cut, empty or without a name."""

from __future__ import annotations

import pytest
from tests.browser.screen import FIND

pytestmark = pytest.mark.browser

RECORDING = "synthetic:random_walk?channels=3&n=3000&sample_period=0.01"
WINDOWS = {"light": {"width": 1280, "height": 720}, "dark": {"width": 1920, "height": 1080}}
"""Theme and size; most other tests open 1440 by 900."""
RULES = {"light": (), "dark": ("color-contrast",)}
"""What axe-core judges in each theme, () = everything: only the colours are others."""
LEFT_TABS = ("Tune", "Source", "Export", "View", "Help")
RIGHT_TABS = ("Signal", "Check", "Compare", "Channels", "Noise")
CLOSED_FOLDERS = {"Tune": "More settings and numbers", "Source": "Advanced", "Export": "Command line"}
CHARTS = {"Signal": 2, "Check": 1, "Compare": 1, "Channels": 1, "Noise": 3}
SAID = {
    "Check": "Ljung-Box over several lags",
    "Compare": "Moving average",
    "Channels": "Each channel fills its own lane",
    "Noise": "how much neighbouring averages differ",
}
"""Words that a study writes once it has its answer."""

PANEL = """(side) => [...document.querySelectorAll('.mantine-ScrollArea-viewport')]
    .filter(view => view.checkVisibility() && view.clientWidth > 200)
    .sort((a, b) => a.getBoundingClientRect().left - b.getBoundingClientRect().left)
    .at(side === 'left' ? 1 : -1)"""
"""The box that scrolls: on the left the first is the panel with its header, the second the tab."""

CUT = f"""(side) => {{
    const panel = ({PANEL})(side), frame = panel.getBoundingClientRect(), cut = [];
    if (panel.scrollWidth > panel.clientWidth + 1) cut.push(`panel: ${{panel.scrollWidth}}`);
    for (const part of panel.querySelectorAll('label, p, button, input, textarea, td, th, li, h3, .uplot')) {{
        if (!part.checkVisibility()) continue;
        const box = part.getBoundingClientRect();
        const outside = box.width > 0 && (box.left < frame.left - 1 || box.right > frame.right + 1);
        const hidden = part.scrollWidth > part.clientWidth + 1 && part.clientWidth > 0;
        if (outside || hidden) cut.push(`${{part.tagName}} “${{part.value ?? part.textContent.slice(0, 40)}}”`);
    }}
    return cut; }}"""
"""What does not fit into a panel's width: text that is cut, boxes whose content is longer than they are."""

GOOD = f"""(count) => {{
    const panel = ({PANEL})('right');
    const good = Object.values(window.__viserTestpoints.uplots).map(entry => entry.chart)
        .filter(chart => panel.contains(chart.root) && chart.root.checkVisibility())
        .map(chart => chart.over.clientHeight > 30 && chart.over.clientWidth > 200 && chart.data[0].length > 1
            && chart.data.slice(1).every(y => y.length === chart.data[0].length)
            && [chart.scales.x, chart.scales.y].every(s => Number.isFinite(s.min) && s.max > s.min));
    return good.length === count && good.every(Boolean); }}"""
"""Whether the right panel has so many charts, each with room, data and ranges."""


def test_every_tab_fits_its_panel_and_has_something_to_show(start):
    screen = start(RECORDING, **WINDOWS["light"])
    screen.wait_for_fit()
    screen.press("Pin")
    screen.wait(f"() => !!({FIND})('A')")
    screen.type("process noise q", "0.00001")
    for tab, folder in CLOSED_FOLDERS.items():
        screen.tab(tab)
        screen.page.get_by_text(folder, exact=True).click()
    wrong = look_at_all(screen, "light")
    screen.darken()
    screen.tab("Signal")  # as `wait_for_fit` wants it
    screen.page.set_viewport_size(WINDOWS["dark"])
    screen.wait_for_fit()
    assert wrong + look_at_all(screen, "dark") == []


def look_at_all(screen, theme):
    """What is wrong in the tabs as the window is now: one of each panel at a time."""
    wrong = []
    for tabs in zip(LEFT_TABS, RIGHT_TABS, strict=True):
        screen.tab(tabs[0])
        screen.tab(tabs[1])
        if tabs[1] in SAID:
            screen.wait_for_text(SAID[tabs[1]])
        screen.wait(GOOD, CHARTS[tabs[1]])
        for side, tab in zip(("left", "right"), tabs, strict=True):
            wrong += [f"{theme}, {tab}: {words}" for words in screen.page.evaluate(CUT, side)]
        wrong += [f"{theme}, {' and '.join(tabs)}: {words}" for words in screen.axe_findings(RULES[theme])]
    assert screen.page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    return wrong
