"""The buttons that make a one-page report for the lab book, HTML or PNG, from the state on screen."""

from __future__ import annotations

import viser

from kalscope.errors import BadSetting
from kalscope.export.report.content import make_report
from kalscope.export.report.page import as_html
from kalscope.export.report.picture import as_png
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.views.binding import on_user


class ReportView:
    """Two buttons in the Export tab; the page is made as a job."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
        hint = "One page on this channel: chart, parameters, resulting filter, tests, and how to reopen it."
        with gui.add_folder("Report"):
            html = gui.add_button("Download report (HTML)", hint=f"{hint} Prints on one sheet.")
            png = gui.add_button("Download report (PNG)", hint=hint)
        for button, name in ((html, "report.html"), (png, "report.png")):
            on_user(
                button.on_click,
                lambda client, name=name: jobs.run_with_state(
                    session, lambda state: _send(state, client, name), Failed.SAVE
                ),
            )


def _send(state: State, client: viser.ClientHandle, name: str) -> None:
    if not state.filter.is_standard:
        raise BadSetting("a report needs the Kalman filter with q and r (got the Khan et al. filter)")
    report = make_report(state.recording, state.as_tuning(), state.channel)
    content = as_png(report) if name.endswith(".png") else as_html(report).encode()
    client.send_file_download(name, content, save_immediately=True)
