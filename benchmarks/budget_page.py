"""What `slider_budget.py` notes inside the browser: in viser's websocket worker and on the page.

Marks like those of `budget_server.py`, [seconds since 1970, name, size]; the size of a message is its bytes, that
of work its microseconds.
"""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page

Mark = tuple[float, str, int]

SEEN_DATA = """const marks = self.__marks = [], epoch = (time) => (performance.timeOrigin + time) / 1000;
    const mark = (name, size) => marks.push([epoch(performance.now()), name, size]);
    const data = Object.getOwnPropertyDescriptor(MessageEvent.prototype, 'data'), seen = new WeakSet();
    const onData = (look) => Object.defineProperty(MessageEvent.prototype, 'data', {...data, get() {
        const value = data.get.call(this);
        if (!seen.has(this)) { seen.add(this); look(value); }
        return value; }});"""

WORKER = f"""() => {{ {SEEN_DATA}
    onData((value) => {{ if (value instanceof ArrayBuffer) mark('received', value.byteLength) }});
    const send = WebSocket.prototype.send;
    WebSocket.prototype.send = function(bytes) {{ mark('left', bytes.byteLength); return send.call(this, bytes) }};
}}"""

PAGE = f"""() => {{ {SEEN_DATA}
    onData((value) => {{ for (const message of value?.type === 'message_batch' ? value.messages : []) {{
        const lines = message.updates?.data;
        if (lines?.[0]?.byteLength) mark('handed ' + message.uuid, lines.reduce((n, one) => n + one.byteLength, 0));
    }} }});
    for (const [uuid, {{chart}}] of Object.entries(window.__viserTestpoints.uplots)) {{
        let began = 0;
        (chart.hooks.drawClear = chart.hooks.drawClear ?? []).push(() => {{ began = performance.now() }});
        (chart.hooks.draw = chart.hooks.draw ?? []).push(() => {{
            mark('drew ' + uuid, Math.round(1000 * (performance.now() - began)));
        }});
    }}
    let drawing = false;  // three.js clears the canvas once or more a frame of the scene
    const clear = WebGL2RenderingContext.prototype.clear;
    WebGL2RenderingContext.prototype.clear = function(bits) {{
        if (!drawing) {{
            const began = performance.now();
            drawing = true;
            queueMicrotask(() => {{
                drawing = false;
                mark('scene', Math.round(1000 * (performance.now() - began)));
            }});
        }}
        return clear.call(this, bits);
    }};
}}"""

CHARTS = """() => Object.fromEntries(Object.entries(window.__viserTestpoints.uplots).map(([uuid, {chart}]) =>
    [uuid, chart.series.slice(1).map(series => series.label).join(', ')]))"""


def watch_browser(page: Page, marks: list[Mark], charts: dict[str, str]) -> Callable[[], None]:
    """Begin to note; what it returns adds the marks and the labels of the charts, by their names in messages."""
    page.evaluate(PAGE)
    for worker in page.workers:
        worker.evaluate(WORKER)

    def take() -> None:
        charts.update(page.evaluate(CHARTS))
        for place in (page, *page.workers):
            marks.extend((t, name, size) for t, name, size in place.evaluate("() => self.__marks"))

    return take
