"""What viser itself costs when a slider redraws a chart, one small case each.

A stock viser server runs in this process, a Chromium beside it; nothing of the dashboard is involved. Each case
prints its own table.

    python benchmarks/viser_cases.py [CASE …] [--updates 20]
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from functools import partial

import viser
from budget_page import Mark, watch_browser
from budget_server import MARKS, watch_viser
from dashboard_page import SIGNAL_CHART, chromium, dashboard_page
from machine import Load, children_cpu
from playwright.sync_api import Browser
from press_clock import Times
from viser_update import POINTS, RNG, Chart, add_chart, lines, ms, timed, viser_server


def between(taken: list[Times], marks: list[Mark], begin: str, end: str) -> float:
    """Median ms from the first mark of a name after an update began to the first of another name after it."""
    spans: list[float] = []
    for one in taken:
        at = [t for t, kind, size in marks if kind.split()[0] == begin and t >= one["began"] and size != 0][:1]
        ends = [t for t, kind, size in marks if at and kind.split()[0] == end and t >= at[0] and size != 0][:1]
        spans += [1e3 * (ends[0] - at[0])] if ends else []
    return statistics.median(spans)


IN_PAGE = f"""() => {{ const chart = {SIGNAL_CHART}, [x, raw, y] = chart.data, times = [], passes = [];
    const next = Float64Array.from(y, value => -value);
    for (let i = 0; i < 20; i++) {{
        let began = performance.now(), least = Infinity, most = -Infinity;
        for (const value of x) {{ if (value < least) least = value; if (value > most) most = value; }}
        passes.push(performance.now() - began);
    }}
    const median = (all) => all.sort((a, b) => a - b)[all.length >> 1];
    return new Promise(done => {{
        const one = (i) => {{
            if (i === 20) return done([median(passes), median(times)]);
            const began = performance.now();
            const drawn = () => {{ chart.hooks.draw.splice(chart.hooks.draw.indexOf(drawn), 1);
                times.push(performance.now() - began); setTimeout(one, 50, i + 1); }};
            (chart.hooks.draw = chart.hooks.draw ?? []).push(drawn);
            chart.setData([x, raw, i % 2 ? y : next], false);
            chart.redraw();
        }};
        one(0);
    }}); }}"""
"""JavaScript: median ms of the pass over x that viser makes, and of setting and drawing a new y in the page."""


def points(browser: Browser, updates: int) -> None:
    """One line changes; time, raw and filtered are sent again."""
    print("points    sent, bytes   y alone  |  ms: assigned → drawn   queue   parse   React    draw", end="")
    print("  |  in the page: pass over x   y alone")
    for count in (1000, 4000, 20_000, 100_000):
        with viser_server() as server:
            chart = add_chart(server, count)
            marks: list[Mark] = []
            with dashboard_page(browser, f"http://127.0.0.1:{server.get_port()}") as page:
                done = watch_browser(page, marks, {})

                def act(_: int, chart: Chart = chart, count: int = count) -> None:
                    chart.data = (*chart.data[:2], RNG.normal(size=count))

                taken = timed(page, act, updates)
                done()
                passes, alone = page.evaluate(IN_PAGE)
        every = sorted([*MARKS, *marks])
        sent = statistics.median(size for t, kind, size in MARKS if kind == "sending" and t >= taken[0]["began"])
        parse, draw = between(taken, every, "received", "handed"), ms(taken, "drawn", "set")
        handed = [
            next(t for t, kind, _ in every if kind.startswith("handed") and t >= one["began"]) for one in taken
        ]
        to_set = 1e3 * statistics.median(one["set"] - t for one, t in zip(taken, handed, strict=True))
        print(
            f"{count:>7,} {sent:>13,.0f} {8 * count:>9,}  | {ms(taken, 'drawn'):>22.1f}"
            f" {between(taken, every, 'pushed', 'sending'):>7.1f} {parse:>7.1f} {to_set:>7.1f} {draw:>7.1f}"
            f"  | {passes:>25.2f} {alone:>9.1f}"
        )


def window(browser: Browser, updates: int) -> None:
    """The sender waits up to 1/60 s; what `flush()` and `atomic()` change."""
    print("a chart of 4,000 points, assigned → drawn         median ms")
    with viser_server() as server:
        chart = add_chart(server)

        def assign(_: int) -> None:
            chart.data = lines(POINTS)

        def assign_and_flush(_: int) -> None:
            chart.data = lines(POINTS)
            server.flush()

        def after_another(_: int) -> None:
            text.content = f"{RNG.random()}"  # what the same move writes before its line
            time.sleep(0.002)
            chart.data = lines(POINTS)

        def after_another_and_flush(i: int) -> None:
            after_another(i)
            server.flush()

        def all_atomic(i: int) -> None:
            with server.atomic():
                after_another(i)
            server.flush()

        text = server.gui.add_markdown("")
        with dashboard_page(browser, f"http://127.0.0.1:{server.get_port()}") as page:
            for act in (assign, assign_and_flush, after_another, after_another_and_flush, all_atomic):
                print(f"{act.__name__.replace('_', ' '):<50}{ms(timed(page, act, updates), 'drawn'):>9.1f}")


def charts(browser: Browser, updates: int) -> None:
    """Several charts change: when the first is drawn and painted, in one batch or in a batch of its own."""
    print("charts that change   batch                    first drawn, ms   first painted, ms")
    for others in (0, 1, 3):
        with viser_server() as server:
            every = [add_chart(server), *(add_chart(server, label=f"line {i}") for i in range(others))]

            def together(_: int, server: viser.ViserServer = server, every: list[Chart] = every) -> None:
                with server.atomic():
                    for chart in every:
                        chart.data = lines(POINTS)
                server.flush()

            def first_alone(_: int, server: viser.ViserServer = server, every: list[Chart] = every) -> None:
                every[0].data = lines(POINTS)
                server.flush()
                time.sleep(0.1)
                for chart in every[1:]:
                    chart.data = lines(POINTS)

            with dashboard_page(browser, f"http://127.0.0.1:{server.get_port()}") as page:
                for act in (together, first_alone):
                    taken = timed(page, act, updates)
                    cells = f"{ms(taken, 'drawn'):>15.1f} {ms(taken, 'painted'):>19.1f}"
                    print(f"{1 + others:>18}   {act.__name__.replace('_', ' '):<25}{cells}")


def scene(browser: Browser, updates: int) -> None:
    """A chart alone, and in one batch with a message of the scene, which waits for the scene's next frame."""
    print("a chart of 4,000 points changes             drawn, ms   painted, ms   processor ms an update")
    with viser_server() as server:
        chart = add_chart(server)
        marker = server.scene.add_icosphere("/marker", radius=0.1)

        def alone(_: int) -> None:
            chart.data = lines(POINTS)
            server.flush()

        def with_marker(_: int) -> None:
            with server.atomic():
                chart.data = lines(POINTS)
                marker.position = tuple(RNG.normal(size=3))
            server.flush()

        def marker_after(i: int) -> None:
            alone(i)
            time.sleep(0.1)
            marker.position = tuple(RNG.normal(size=3))

        with dashboard_page(browser, f"http://127.0.0.1:{server.get_port()}") as page:
            for act in (alone, with_marker, marker_after):
                load = Load()
                with load.stretch():
                    taken = timed(page, act, updates)
                spent = sum(value for kind, value in load.own.items() if kind.startswith("chromium"))
                cells = (
                    f"{ms(taken, 'drawn'):>9.1f} {ms(taken, 'painted'):>13.1f} {1e3 * spent / (updates + 3):>12.0f}"
                )
                print(f"{act.__name__.replace('_', ' '):<44}{cells}")


def arrow_keys(browser: Browser, updates: int) -> None:
    """The arrow keys of a slider that has the focus also turn the camera of the scene."""
    print("an arrow key on a slider         frames of the scene a press   processor ms of the browser a press")
    with viser_server() as server:
        server.gui.add_slider("q", -9.0, 3.0, 0.01, 0.0)
        add_chart(server)
        for stopped in (False, True):
            marks: list[Mark] = []
            with dashboard_page(browser, f"http://127.0.0.1:{server.get_port()}") as page:
                if stopped:
                    page.evaluate(
                        "() => document.body.addEventListener('keydown', event => event.stopPropagation())"
                    )
                done = watch_browser(page, marks, {})
                page.get_by_role("slider").first.focus()
                page.wait_for_timeout(1000)
                before = children_cpu(os.getpid())
                for _ in range(updates):
                    page.keyboard.press("ArrowRight", delay=30)
                    page.wait_for_timeout(300)
                after = children_cpu(os.getpid())
                done()
            spent = sum(
                value - before.get(kind, 0.0) for kind, value in after.items() if kind.startswith("chromium")
            )
            frames = sum(kind == "scene" for _, kind, _ in marks) / updates
            name = "stopped at the body of the page" if stopped else "left to viser"
            print(f"{name:<32}{frames:>28.1f} {1e3 * spent / updates:>37.0f}")


def note(heard: list[float], _: object) -> None:
    """When the server got a value of the slider."""
    heard.append(time.time())


def throttle(browser: Browser, updates: int) -> None:
    """50 ms between two messages of a container: changes of a slider a second, and values that are lost."""
    key = "(row, key) => row.dispatchEvent(new KeyboardEvent('keydown', {key, bubbles: true}))"
    for where in ("two sliders of one container", "each in a tab group of its own"):
        with viser_server() as server:
            heard: list[float] = []
            add_chart(server)
            sliders: list[viser.GuiSliderHandle[float]] = []
            for name in "ab":
                if where.startswith("two"):
                    sliders.append(server.gui.add_slider(name, 0.0, 1000.0, 1.0, 500.0))
                else:
                    with server.gui.add_tab_group().add_tab(name):
                        sliders.append(server.gui.add_slider(name, 0.0, 1000.0, 1.0, 500.0))
            sliders[0].on_update(partial(note, heard))
            with dashboard_page(browser, f"http://127.0.0.1:{server.get_port()}") as page:
                first, second = (one.element_handle() for one in page.get_by_role("slider").all())
                lost = 0
                for _ in range(updates):
                    page.evaluate(
                        f"""async ([a, b]) => {{ const press = {key};
                        for (const one of [a, a, b]) {{
                            press(one, 'ArrowRight');
                            await new Promise(done => setTimeout(done, 8));
                        }} }}""",
                        [first, second],
                    )
                    page.wait_for_timeout(400)
                    lost += float(first.get_attribute("aria-valuenow") or "nan") != sliders[0].value
                heard.clear()
                page.evaluate(
                    f"""(a) => new Promise(done => {{ const press = {key}; let i = 0;
                    const timer = setInterval(() => {{ press(a, 'ArrowRight');
                        if (++i === 90) {{ clearInterval(timer); setTimeout(done, 500) }} }}, 1000 / 30); }})""",
                    first,
                )
        rate = (len(heard) - 1) / (heard[-1] - heard[0])
        print(f"{where}: value lost in {lost} of {updates} trials; 30 steps a second arrive as {rate:.1f}")


def flood(browser: Browser, updates: int) -> None:
    """More updates than the browser can draw: the last comes late."""
    print("points   updates a second   drawn of those sent   last drawn after the last was sent, ms")
    for count, rate in ((4000, 60), (100_000, 30)):
        with viser_server() as server:
            chart = add_chart(server, count)
            marks: list[Mark] = []
            with dashboard_page(browser, f"http://127.0.0.1:{server.get_port()}") as page:
                done = watch_browser(page, marks, {})
                for _ in range(5 * updates):
                    chart.data = lines(count)
                    time.sleep(1.0 / rate)
                sent = time.time() - 1.0 / rate
                page.wait_for_timeout(3000)
                done()
        drawn = [t for t, kind, _ in marks if kind.startswith("drew")]
        print(f"{count:>6,} {rate:>18} {len(drawn):>11} of {5 * updates:<5} {1e3 * (drawn[-1] - sent):>30.0f}")


CASES = {case.__name__: case for case in (points, window, charts, scene, arrow_keys, throttle, flood)}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--updates", type=int, default=20)
    options = parser.parse_args()
    watch_viser()
    with chromium() as browser:
        for name in options.cases or CASES:
            print(f"{name}: {CASES[name].__doc__}", flush=True)
            CASES[name](browser, options.updates)
            print(flush=True)


if __name__ == "__main__":
    main()
