"""The buttons that make a one-page report for the lab book, HTML or PNG, from the state on screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kalscope.errors import BadSetting
from kalscope.export.report.content import make_report
from kalscope.export.report.page import as_html
from kalscope.export.report.picture import as_png

if TYPE_CHECKING:
    import viser

    from kalscope_app.engine.jobs import Jobs
    from kalscope_app.session.session import Session
    from kalscope_app.session.state import State


class ReportView:
    """Two buttons in the Export tab; the page is made as a job."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
        self._session, self._jobs = session, jobs
        hint = "One page on this channel: chart, parameters, resulting filter, tests, and how to reopen it."
        with gui.add_folder("Report"):
            self._html = gui.add_button("Download report (HTML)", hint=f"{hint} Prints on one sheet.")
            self._png = gui.add_button("Download report (PNG)", hint=hint)
        self._html.on_click(self._on_html)
        self._png.on_click(self._on_png)

    async def _on_html(self, event: viser.GuiEvent[Any]) -> None:
        self._ask(event.client, "report.html")

    async def _on_png(self, event: viser.GuiEvent[Any]) -> None:
        self._ask(event.client, "report.png")

    def _ask(self, client: viser.ClientHandle | None, name: str) -> None:
        if client is not None:
            self._jobs.run_with_state(self._session, lambda state: _send(state, client, name))


def _send(state: State, client: viser.ClientHandle, name: str) -> None:
    if state.paper_filter is not None:
        raise BadSetting("a report needs the Kalman filter with q and r (got the Khan et al. filter)")
    report = make_report(state.recording, state.as_tuning(), state.channel)
    content = as_png(report) if name.endswith(".png") else as_html(report).encode()
    client.send_file_download(name, content, save_immediately=True)
