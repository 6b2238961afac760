"""Counts the words and the controls that a newcomer meets in each tab: in the window, and in the whole tab.

    python benchmarks/words_on_screen.py [--source SOURCE] [--size 1440x900]

A word is a run of letters in text that can be seen, in a button, or in a box; a control is a button, box or slider.
What lies behind a closed folder counts in neither column. Names of tabs count as words, not as controls.
"""

from __future__ import annotations

import argparse

from dashboard_page import Program, chromium, dashboard_page
from playwright.sync_api import Page

COUNT = """() => {
    const windowBox = {left: 0, top: 0, right: innerWidth, bottom: innerHeight};
    const meet = (a, b) => ({left: Math.max(a.left, b.left), top: Math.max(a.top, b.top),
        right: Math.min(a.right, b.right), bottom: Math.min(a.bottom, b.bottom)});
    const shown = (element, box, scrolled) => {
        if (!element.checkVisibility({opacityProperty: true, visibilityProperty: true})) return false;
        for (let one = element; one; one = one.parentElement) {
            if (scrolled && one.matches('.mantine-ScrollArea-viewport')) break;
            if (getComputedStyle(one).overflow !== 'visible') box = meet(box, one.getBoundingClientRect());
        }
        if (!scrolled) box = meet(box, windowBox);
        return box.right - box.left > 3 && box.bottom - box.top > 3;
    };
    const words = (text) => (text.match(/\\p{L}+/gu) ?? []).length;
    const found = {words: [0, 0], controls: [0, 0]};
    const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = texts.nextNode(); node; node = texts.nextNode()) {
        if (!words(node.data) || node.parentElement.closest('style, script, .u-legend')) continue;
        const range = document.createRange();
        range.selectNode(node);
        [false, true].forEach((scrolled, i) => {
            const box = range.getBoundingClientRect();
            if (shown(node.parentElement, box, scrolled)) found.words[i] += words(node.data);
        });
    }
    for (const one of document.querySelectorAll('button:not([role=tab]), input, textarea, [role=slider]')) {
        [false, true].forEach((scrolled, i) => { if (shown(one, one.getBoundingClientRect(), scrolled)) {
            found.controls[i] += 1;
            found.words[i] += words(one.value ?? '') + words(one.placeholder ?? '');
        }});
    }
    return found; }"""
"""JavaScript: words and controls, each in the window and in the whole of what the page has open."""


def count(page: Page, quiet_s: int = 4) -> tuple[int, int, int, int]:
    """Words and controls in the window, then of all that is open, once they have stayed the same.

    Args:
        page: The dashboard.
        quiet_s: How long they have to stay: checks and maps come after the first picture.
    """
    found, since = page.evaluate(COUNT), 0
    while since < quiet_s:
        page.wait_for_timeout(1000)
        before, found = found, page.evaluate(COUNT)
        since = since + 1 if found == before else 0
    return found["words"][0], found["controls"][0], found["words"][1], found["controls"][1]


def counts_by_tab(page: Page) -> dict[str, tuple[int, int, int, int]]:
    """The counts of each tab, the others of its row as they were at first."""
    names = page.get_by_role("tab").all_inner_texts()
    selected = [tab.inner_text() for tab in page.get_by_role("tab", selected=True).all()]
    counts: dict[str, tuple[int, int, int, int]] = {}
    for name in names:
        page.get_by_role("tab", name=name, exact=True).click()
        counts[name] = count(page)
        for first in selected:
            page.get_by_role("tab", name=first, exact=True).click()
    return counts


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--source", default="demo")
    parser.add_argument("--size", default="1440x900")
    options = parser.parse_args()
    width, _, height = options.size.partition("x")
    with Program(options.source) as program, chromium() as browser, dashboard_page(browser, program.url) as page:
        page.set_viewport_size({"width": int(width), "height": int(height)})
        count(page, 8)
        print("| tab | words in the window | controls in the window | words in all | controls in all |")
        print("|---|---|---|---|---|")
        for name, numbers in counts_by_tab(page).items():
            print(f"| {name} | {' | '.join(map(str, numbers))} |")


if __name__ == "__main__":
    main()
