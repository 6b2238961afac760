"""A page that draws more slowly than a board sends, in Chromium: it shows the newest, and loses nothing else."""

from __future__ import annotations

from contextlib import closing
from importlib.resources import files

import pytest
from tests.support.waiting import PATIENCE

pytestmark = pytest.mark.browser

SCRIPT = files("kalscope_app.views").joinpath("page", "keep_up.js").read_text("utf-8")
SERVER = """
window.Worker = class {
  set onmessage(handler) { window.send = (data) => handler({ data }); }
  postMessage() {}
};
"""
VIEWER = """
window.seen = [];
new Worker("viser").onmessage = ({ data }) => seen.push(data.messages ?? data.type);
window.batch = (...messages) => send({ type: "message_batch", messages });
window.set = (uuid, updates) => ({ type: "GuiUpdateMessage", uuid, updates });
"""


def test_what_comes_while_the_page_draws_is_shown_in_its_newest_state_at_once(browser):
    with closing(browser.new_context()) as context:
        page = context.new_page()
        page.add_script_tag(content=SERVER + SCRIPT + VIEWER)

        def seen(batches, script):
            """What viser gets of messages that come in one turn of the page."""
            page.evaluate(f"() => {{ seen.length = 0; {script} }}")
            page.wait_for_function("(batches) => seen.length >= batches", arg=batches, timeout=1000 * PATIENCE)
            return page.evaluate("seen")

        assert seen(
            2,
            """const picture = (data) => ({ type: "BackgroundImageMessage", data });
            batch(set("chart", { data: 1 }));
            for (let i = 2; i < 100; i++) {
              batch(set("chart", { data: i }), set("chart", { title: `of ${i}` }));
              if (i === 50) batch({ type: "GuiModalMessage", uuid: "a" }, { type: "GuiRemoveMessage", uuid: "b" });
            }
            batch(set("text", { data: 7 }), picture(1), picture(2));""",
        ) == [
            [{"type": "GuiUpdateMessage", "uuid": "chart", "updates": {"data": 1}}],
            [
                {"type": "GuiModalMessage", "uuid": "a"},
                {"type": "GuiRemoveMessage", "uuid": "b"},
                {"type": "GuiUpdateMessage", "uuid": "chart", "updates": {"data": 99}},
                {"type": "GuiUpdateMessage", "uuid": "chart", "updates": {"title": "of 99"}},
                {"type": "GuiUpdateMessage", "uuid": "text", "updates": {"data": 7}},
                {"type": "BackgroundImageMessage", "data": 2},
            ],
        ]
        found = seen(
            5,
            """batch(set("chart", { data: 1 })); batch(set("chart", { data: 2 }));
            send({ type: "closed" }); send({ type: "connected" }); batch(set("chart", { data: 3 }));""",
        )
        data = [part if isinstance(part, str) else part[0]["updates"]["data"] for part in found]
        assert data == [1, 2, "closed", "connected", 3]
