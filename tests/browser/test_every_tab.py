"""Every tab of both panels, in a small light and a large dark window: nothing cut, empty or without a name."""

from __future__ import annotations

import pytest
from tests.browser.axe import findings
from tests.browser.screen import FIND, PICTURES

pytestmark = pytest.mark.browser

RECORDING = "synthetic:random_walk?channels=3&n=3000&sample_period=0.01"
WINDOWS = {
    "light": {"width": 1280, "height": 720},
    "dark": {"width": 1920, "height": 1080},
}
"""Theme and size; most other tests open 1600 by 900."""
RULES = {"light": (), "dark": ("color-contrast",)}
"""What axe-core judges in each theme, () = everything: only the colours are others."""
LEFT_TABS = ("Tune", "Source", "Export", "View", "Help")
RIGHT_TABS = ("Signal", "Check", "Compare", "Channels", "Noise")
CLOSED_FOLDERS = {
    "Tune": ("More settings and numbers",),
    "Source": ("Advanced",),
    "Export": ("Command line",),
}
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

GOOD = f"""(side) => {{
    const panel = ({PANEL})(side);
    return Object.values(window.__viserTestpoints.uplots).map(entry => entry.chart)
        .filter(chart => panel.contains(chart.root) && chart.root.checkVisibility())
        .map(chart => chart.over.clientHeight > 30 && chart.over.clientWidth > 200 && chart.data[0].length > 1
            && chart.data.slice(1).every(y => y.length === chart.data[0].length)
            && [chart.scales.x, chart.scales.y].every(s => Number.isFinite(s.min) && s.max > s.min)); }}"""
"""For every chart of a panel whether it has room, data and ranges."""


def look(screen, side, name):
    """Pictures of one tab, a new one for each screenful of it, and what is wrong: only Signal must not scroll."""
    room, whole = screen.page.evaluate(
        f"(side) => {{ const p = ({PANEL})(side); return [p.clientHeight, p.scrollHeight]; }}", side
    )
    for part in range(-(-(whole - 8) // room) if PICTURES else 0):
        screen.page.evaluate(f"([side, y]) => ({PANEL})(side).scrollTo(0, y)", [side, part * room])
        screen.shot(name if part == 0 else f"{name}-{part + 1}")
    screen.page.evaluate(f"(side) => ({PANEL})(side).scrollTo(0, 0)", side)
    too_long = [f"{whole} of {room} px"] if name.endswith("signal") and whole > room + 1 else []
    return [f"{name}: {words}" for words in (*screen.page.evaluate(CUT, side), *too_long)]


def show_right(screen, name):
    """Open a tab of the chart panel, and wait until its charts stand there with data."""
    screen.tab(name)
    if name in SAID:
        screen.page.get_by_text(SAID[name]).first.wait_for()
    screen.wait(
        f"(count) => {{ const good = ({GOOD})('right'); return good.length === count && good.every(one => one); }}",
        CHARTS[name],
    )


def test_every_tab_fits_its_panel_and_has_something_to_show(start):
    screen = start(RECORDING, **WINDOWS["light"])
    screen.wait_for_fit()
    screen.page.get_by_role("button", name="Pin", exact=True).click()
    screen.wait(f"() => !!({FIND})('A')")
    screen.type("process noise q", "0.00001")
    for tab, folders in CLOSED_FOLDERS.items():
        screen.tab(tab)
        for folder in folders:
            screen.page.get_by_text(folder, exact=True).click()
    wrong = look_at_all(screen, "light")
    screen.tab("View")
    screen.page.get_by_text("dark theme").click()
    screen.wait("() => document.documentElement.dataset.mantineColorScheme === 'dark'")
    screen.tab("Signal")  # as `wait_for_fit` wants it
    screen.page.set_viewport_size(WINDOWS["dark"])
    screen.wait_for_fit()
    assert wrong + look_at_all(screen, "dark") == []


def look_at_all(screen, theme):
    """Pictures of every tab as the window is now, and what is wrong on them: one of each panel at a time."""
    wrong = []
    for tabs in zip(LEFT_TABS, RIGHT_TABS, strict=True):
        screen.tab(tabs[0])
        show_right(screen, tabs[1])
        for side, tab in zip(("left", "right"), tabs, strict=True):
            wrong += look(screen, side, f"tab-{theme}-{tab.lower()}")
        wrong += [f"{theme}, {' and '.join(tabs)}: {words}" for words in findings(screen.page, RULES[theme])]
    assert screen.page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    return wrong
