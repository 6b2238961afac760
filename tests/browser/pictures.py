"""The pictures of the documentation: how each screen is reached.

Run as a script (`make pictures`) it makes them, or those that are named. With each picture_stamps.json
keeps the words that stood on the screen, and their colours. `test_pictures.py` takes the same steps and compares: a
picture of a former screen fails there.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from PIL import Image
from tests.browser.chromium import CHROMIUM, FLAGS
from tests.browser.screen import FIND, Screen, SharedPage, dashboard, shared_page
from tests.support.fleet_folder import run_steps
from tests.support.program import command, next_line
from tests.support.waiting import PATIENCE

from kalscope.estimation.request import Request
from kalscope.fleet.read import FleetOptions

DOCS = Path(__file__).parents[2] / "docs"
FOLDER = DOCS / "pictures"
STAMPS = Path(__file__).with_name("picture_stamps.json")
WIDTH, HEIGHT = 1440, 900
SETTLED_MS = 3000
"""How long a screen stays the same before its picture is taken."""

SAID = """() => { const said = new Set(), shown = (node) => { const box = node.getBoundingClientRect();
        return node.checkVisibility() && box.width > 1 && box.bottom > 0 && box.top < innerHeight; };
    for (const node of document.querySelectorAll('body *:not(script, style)')) {
        const own = [...node.childNodes].filter(one => one.nodeType === Node.TEXT_NODE);
        const text = (node.matches('input') ? node.value : own.map(one => one.textContent).join(' ')).trim();
        if (text && shown(node)) said.add(`${text} ${getComputedStyle(node).color}`); }
    for (const {chart} of Object.values(window.__viserTestpoints?.uplots ?? {}))
        if (shown(chart.root)) for (const line of chart.series.slice(1)) said.add(`${line.label} ${line.stroke()}`);
    return [...said].sort(); }"""
"""Each text on the screen with its colour, and each line of a chart."""


@dataclass(frozen=True)
class Picture:
    """A screen of the dashboard."""

    source: str
    """What is open; a board where it is `BOARD`."""
    steps: Callable[[Screen], None]
    """From what `kalscope open SOURCE` shows to what is to be seen."""
    size: tuple[int, int] = (WIDTH, HEIGHT)
    """Of the window."""


BOARD = "board"
"""The board of `kalscope demo-board`. Its numbers differ each time, so they are no part of what the screen said."""


def goal(lag_ms: str) -> Callable[[Screen], None]:
    """The goal *maximum lag* is applied."""

    def steps(screen: Screen) -> None:
        screen.type("lag (ms)", lag_ms)
        screen.page.get_by_text(re.compile("leaves")).first.wait_for()

    return steps


def in_the_dark(screen: Screen) -> None:
    """The goal *maximum lag* is applied, in the dark theme."""
    goal("50")(screen)
    screen.darken()
    screen.tab("Tune")


def on_a_phone(screen: Screen) -> None:
    """The goal *maximum lag* is applied, in the window of a phone."""
    goal("50")(screen)
    screen.page.locator(".kalscope-phone").wait_for()


def best_fit(screen: Screen) -> None:
    """The goal *best fit* is applied."""
    screen.choose("goal", "best fit")
    screen.press("Apply")
    screen.wait_for_text("Before: ")


def momentum(screen: Screen) -> None:
    """The filter with 50 ms of lag and 10 % of overshoot is typed in."""
    screen.type("process noise q", "7.395")
    screen.open_more()
    screen.type("momentum", "390 ms")
    screen.page.get_by_text("keeps direction", exact=True).wait_for()


def fused(screen: Screen) -> None:
    """Sonar and float are fused."""
    screen.open_more()
    screen.page.get_by_text("Fuse sensors", exact=True).click()
    for name in ("sonar", "float"):
        screen.tick(name)
    screen.press("Fuse")
    screen.wait(f"() => ({FIND})('fused')")


def fleet(screen: Screen) -> None:
    """A fleet is open, and the device that is most unlike the others."""
    screen.tab("Source")
    screen.type("path", "result")
    screen.page.get_by_text("Live board", exact=True).click()  # this machine's ports are no part of the picture
    screen.page.locator(".kalscope-map > div").wait_for()
    screen.choose("open device", "1. dev20.csv")
    screen.wait_for_text("dev20.csv")


def fleet_of_the_guide(folder: Path) -> None:
    """The logs that the program of the guide makes, tuned as its command does, but without Dask."""
    program = re.search(r"```python run\n(.*?)```", (DOCS / "fleet.md").read_text("utf-8"), re.DOTALL)
    assert program is not None
    with contextlib.chdir(folder):
        exec(compile(program[1], "fleet.md", "exec"), {})
    run_steps(folder / "logs", folder / "result", FleetOptions(Request(momentum=0.0)))


def live(screen: Screen) -> None:
    """Ten seconds of a board have arrived, and the chart stands still."""
    screen.wait(f"() => ({FIND})('raw')?.data[0].length > 450")
    goal("50")(screen)
    screen.press("Pause")
    screen.wait_for_text("live, paused")


def tuning_map(screen: Screen) -> None:
    """The map is open."""
    best_fit(screen)
    screen.press("Map")
    screen.page.locator(".kalscope-map > div").wait_for()


SPIKY = "synthetic:sine?n=1000&sample_period=0.02&amplitude=20&period=8&sigma=2&outliers=0.02&outlier_size=50"
PICTURES = {
    "screenshot": Picture("demo", goal("50")),
    "dark": Picture("demo", in_the_dark),
    "phone": Picture("demo", on_a_phone, (390, 844)),
    "goal": Picture("demo", goal("100")),
    "momentum": Picture("sample:flex_sensor", momentum),
    "spikes": Picture(SPIKY, best_fit),
    "map": Picture("demo", tuning_map),
    "fusion": Picture("sample:tank_level", fused),
    "fleet": Picture("demo", fleet),
    "live": Picture(BOARD, live),
}


def said(screen: Screen, picture: Picture) -> list[str]:
    """What stands on the screen once its loops are compiled, each text with its colour."""
    from playwright.sync_api import expect  # absent where these tests are skipped

    expect(screen.page.get_by_text("Compiling for this computer")).to_have_count(0, timeout=1000 * PATIENCE)
    screen.page.mouse.move(2, 2)
    texts = screen.page.evaluate(SAID)
    return sorted({re.sub(r"[\d.]+(?=.* rgb)", "0", text) for text in texts} if picture.source == BOARD else texts)


@contextmanager
def on_screen(picture: Picture, browser, page: SharedPage, folder: Path) -> Iterator[Screen]:
    """The screen of a picture, on the page that serves all, or on one of its own for a board and for a phone.

    A page that was a phone's has a narrower panel in a wide window.
    """
    if picture.source != BOARD and picture.size == (WIDTH, HEIGHT):
        if picture.steps is fleet:
            fleet_of_the_guide(folder)
        page.open(picture.source, width=WIDTH, height=HEIGHT)
        picture.steps(page)
        yield page
        return
    with ExitStack() as until:
        source = picture.source
        if source == BOARD:
            board = until.enter_context(command("demo-board", "--socket", "0"))
            until.callback(board.kill)
            source = next_line(board).split()[-1]
        url = until.enter_context(dashboard(source, cwd=folder))
        screen = until.enter_context(Screen(browser, url, *picture.size))
        picture.steps(screen)
        yield screen


def wait_until_settled(screen: Screen, picture: Picture) -> list[str]:
    """What the screen says once it has said the same for `SETTLED_MS`."""
    before: list[str] = []
    while (now := said(screen, picture)) != before:
        before = now
        screen.page.wait_for_timeout(SETTLED_MS)
    return now


def main() -> None:
    """Make the pictures and their stamps."""
    from playwright.sync_api import sync_playwright  # absent where the tests are skipped

    names = sys.argv[1:] or list(PICTURES)
    stamps = json.loads(STAMPS.read_text(encoding="utf-8")) if STAMPS.exists() else {}
    with (
        tempfile.TemporaryDirectory() as folder,
        tempfile.TemporaryDirectory() as own,
        contextlib.chdir(folder),
        sync_playwright() as playwright,
        contextlib.closing(playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))) as browser,
        shared_page(browser, Path(folder), Path(own)) as page,
    ):
        for name in names:
            picture = PICTURES[name]
            with on_screen(picture, browser, page, Path(folder)) as screen:
                stamps[name] = wait_until_settled(screen, picture)
                png = Image.open(io.BytesIO(screen.page.screenshot())).convert("RGB")
            png.quantize(256, dither=Image.Dither.NONE).save(FOLDER / f"{name}.png", optimize=True)
            STAMPS.write_text(json.dumps(stamps, indent=0, ensure_ascii=False) + "\n", encoding="utf-8")
            print(name, flush=True)


if __name__ == "__main__":
    main()
