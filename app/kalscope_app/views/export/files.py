"""Dialogs in one browser: files to read and copy, what would be overwritten, and why an export failed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import viser

from kalscope_app.views.binding import on_user
from kalscope_app.views.markdown import escape_markdown
from kalscope_app.views.window.css import PRIMARY

WIDE = """<style>
.mantine-Modal-content:has(.kalscope-files) { flex: 0 0 min(72rem, 94vw); max-width: 94vw; }
.mantine-Modal-content:has(.kalscope-files) textarea {
  min-height: calc(100vh - 21rem) !important; font: 0.8rem/1.35 ui-monospace, monospace; white-space: pre;
  overflow: auto;
}
.mantine-Modal-content:has(.kalscope-files) .mantine-Flex-root > div:first-child { display: none; }
</style><span class="kalscope-files"></span>"""
"""viser's windows are 400 px wide and its text boxes 6 lines high, too small for code. A constant: it must never
contain text from outside."""


def show_files(client: viser.ClientHandle, files: dict[str, str]) -> None:
    """A window with a tab for each file, in a text box: plain text, so nothing in it can act."""
    with client.gui.add_modal("Preview code") as window:
        client.gui.add_html(WIDE)
        client.gui.add_markdown("Click into the text, then press Ctrl+A and Ctrl+C.")
        tabs = client.gui.add_tab_group()
        for name, text in files.items():
            with tabs.add_tab(name):
                client.gui.add_text(name, text, multiline=True)
        _add_close(client, window)


def show_refusal(client: viser.ClientHandle, message: str) -> None:
    """A dialog that stays until it is closed: such a message is too long for a notification."""
    with client.gui.add_modal("Cannot export") as window:
        client.gui.add_markdown(escape_markdown(f"{message[:1].upper()}{message[1:]}.", 2000))
        _add_close(client, window)


def ask_to_overwrite(
    client: viser.ClientHandle,
    folder: str,
    names: Iterable[str],
    overwrite: Callable[[], object],
    other: str = "folder",
) -> None:
    """Ask in one browser whether existing files may be overwritten, or another folder or name is chosen."""
    with client.gui.add_modal("Overwrite files?") as window:
        there = ", ".join(escape_markdown(name, 80) for name in names)
        client.gui.add_markdown(f"These files exist in **{escape_markdown(folder, 200)}**: {there}. Overwrite?")
        yes = client.gui.add_button("Overwrite", color=PRIMARY)
        no = client.gui.add_button(f"Choose another {other}", hint="Saves nothing.")

    def accept() -> None:
        window.close()
        overwrite()

    on_user(yes.on_click, lambda _client: accept())
    on_user(no.on_click, lambda _client: window.close())


def _add_close(client: viser.ClientHandle, window: Any) -> None:
    on_user(client.gui.add_button("Close").on_click, lambda _client: window.close())
