"""Whether the screen is what it was: screenshots of an earlier checkout and of this one, compared pixel by pixel.

Both programs open the same sources one after the other, in a folder of the same name, and are photographed once
nothing moves any more. Listed are the boxes of the window in which pixels differ; with --pictures both screenshots
and their difference are kept. Exit status 1 where anything differs.

    python benchmarks/same_pictures.py BEFORE_CHECKOUT [--only NAME …] [--pictures FOLDER]

The earlier checkout needs an environment of its own in .venv.
"""

from __future__ import annotations

import argparse
import io
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
from dashboard_page import PROGRAM, Program, chromium, dashboard_page
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page

Picture = NDArray[np.uint8]
"""A screenshot, (height, width, 3)."""
Step = Callable[[Page], None]

SAMPLES = sorted(path.stem for path in (Path(__file__).parents[1] / "sample_data").glob("*.csv"))
QUIET_S, MAX_WAIT_S = 3.0, 90.0
"""Seconds that a picture must stay the same, and seconds after which it counts as it is."""
UNFINISHED = ('text="…"', ".mantine-Notification-root:has-text('Compiling')")
"""What is on the screen until the verdict is there, and while loops are compiled at a first start."""
CELL = 20
"""Differing pixels less than so many apart are listed as one box."""
MAX_LEVELS = 2
"""Of 255 by which a colour may differ: Chromium blends the shadow of a panel in one of two ways."""


def tab(name: str) -> Step:
    """Open a tab."""
    return lambda page: page.get_by_role("tab", name=name, exact=True).click()


def tick(label: str) -> Step:
    """Set a checkbox of the View tab."""

    def step(page: Page) -> None:
        tab("View")(page)
        page.get_by_label(label).check()

    return step


def add_momentum(page: Page) -> None:
    """By its button."""
    page.get_by_text("Start and outliers", exact=True).click()
    page.get_by_role("button", name="Add momentum").click()


def press_q(page: Page) -> None:
    """Move the q slider by some steps, and wait until all is drawn in full."""
    page.get_by_role("slider").first.focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
        page.wait_for_timeout(150)


def open_map(page: Page) -> None:
    """By its button."""
    page.get_by_role("button", name="Map", exact=True).click()


NOISE = "synthetic:random_walk?n=100000&sigma=0.5&seed=1"
TABS = ("Source", "Export", "View", "Help", "Tune", "Compare", "Channels", "Noise", "Check")
CASES: dict[str, tuple[str, dict[str, Step]]] = {
    "100,000 samples, q moved": (NOISE, {"": press_q}),
    "q moved": ("demo", {"": press_q}),
    "velocity": ("demo", {"momentum": add_momentum, "shown": tick("show velocity")}),
    "choices": ("demo", {"smoother": tick("show smoother"), "dark": tick("dark theme")}),
    "tabs": ("demo", {name: tab(name) for name in TABS}),
    "map": ("demo", {"": open_map}),
    **{f"sample {name}": (f"sample:{name}", {"": lambda _: None}) for name in SAMPLES},
}
"""Name to source and steps, by the names of the pictures after them; each begins with a program of its own."""


def photograph(page: Page, name: str) -> Picture:
    """The page once nothing moves."""
    page.mouse.move(2, 2)
    began = since = time.monotonic()
    last = b""
    while time.monotonic() - began < MAX_WAIT_S:
        now = page.screenshot(animations="disabled", caret="hide")
        if now != last or any(page.locator(one).count() for one in UNFINISHED):
            last, since = now, time.monotonic()
        elif time.monotonic() - since > QUIET_S:
            break
        page.wait_for_timeout(500)
    else:
        print(f"{name}: still moving after {MAX_WAIT_S:.0f} s", file=sys.stderr)
    return np.asarray(Image.open(io.BytesIO(last)).convert("RGB"))


@contextmanager
def one_folder() -> Iterator[Path]:
    """A new folder of the same name each time, because the name is on the screen."""
    folder = Path(tempfile.gettempdir()) / "kalscope-pictures"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


def pictures_of(browser: Browser, checkout: Path | None, name: str) -> list[Picture]:
    """One case in one checkout; None = this one."""
    source, steps = CASES[name]
    program = PROGRAM if checkout is None else checkout / ".venv" / "bin" / "kalscope"
    paths = {} if checkout is None else {"PYTHONPATH": f"{checkout / 'src'}{os.pathsep}{checkout / 'app'}"}
    pictures: list[Picture] = []
    with (
        one_folder() as folder,
        Program(source, (program, "open"), folder=folder, environment=paths) as running,
        dashboard_page(browser, running.url) as page,
    ):
        for step in steps.values():
            step(page)
            pictures.append(photograph(page, name))
    return pictures


def differing(before: Picture, after: Picture) -> NDArray[np.bool_]:
    """The pixels that differ, (height, width)."""
    return np.asarray(np.abs(before.astype(int) - after).max(axis=2) > MAX_LEVELS)


def boxes(before: Picture, after: Picture) -> Iterator[tuple[int, int, int, int, int]]:
    """Left, top, width, height of each region that differs, and how many of its pixels do."""
    from scipy.ndimage import binary_dilation, find_objects, label

    if before.shape != after.shape:
        yield 0, 0, after.shape[1], after.shape[0], after.shape[0] * after.shape[1]
        return
    differs = differing(before, after)
    regions, _ = label(binary_dilation(differs, iterations=CELL // 2))
    for number, place in enumerate(find_objects(regions), 1):
        ys, xs = np.nonzero(differs[place] & (regions[place] == number))
        top, left = int(place[0].start + ys.min()), int(place[1].start + xs.min())
        yield left, top, int(np.ptp(xs)) + 1, int(np.ptp(ys)) + 1, len(xs)


def keep(folder: Path, name: str, before: Picture, after: Picture) -> None:
    """Both pictures and where they differ, side by side in one file each."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = name.replace(", ", "-").replace(",", "").replace(" ", "_")
    for kind, picture in (("before", before), ("after", after)):
        Image.fromarray(picture).save(folder / f"{stem}-{kind}.png")
    if before.shape == after.shape:
        marked = after // 2 + 127
        marked[differing(before, after)] = (255, 0, 0)
        Image.fromarray(marked).save(folder / f"{stem}-difference.png")


def compared(name: str, before: Picture, after: Picture, folder: Path | None) -> bool:
    """Print the boxes that differ, and keep the pictures if asked to; whether there is one."""
    found = sorted(boxes(before, after), key=lambda box: -box[-1])
    print(f"{name}: {'the same' if not found else f'{len(found)} boxes differ'}", flush=True)
    for left, top, width, height, pixels in found[:12]:
        print(f"  {width:>4} × {height:<4} px at ({left}, {top}): {pixels:,} pixels", flush=True)
    if found and folder:
        keep(folder, name, before, after)
    return bool(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("before", type=Path, help="a checkout with its own .venv")
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES), metavar="NAME")
    parser.add_argument("--pictures", type=Path, help="a folder for pictures of what differs")
    options = parser.parse_args()
    count = 0
    for name in options.only:
        with chromium() as browser:
            before, after = map(partial(pictures_of, browser, name=name), (options.before.resolve(), None))
        for label, old, new in zip(CASES[name][1], before, after, strict=True):
            count += compared(f"{name} {label}".strip(), old, new, options.pictures)
    sys.exit(1 if count else 0)


if __name__ == "__main__":
    main()
