"""The one-page report for the lab book, HTML or PNG, and the filtered signal as CSV."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator

import viser

from kalscope.export.filtered_csv import filtered_csv_chunks
from kalscope.export.report.content import Report, make_report
from kalscope.export.report.page import as_html
from kalscope.export.report.picture import as_png
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.share import share_line
from kalscope_app.session.state import State
from kalscope_app.views.binding import on_user

PAGE = "One page on what is on screen: chart, parameters, tests, pinned settings, and how to reopen it."


class ReportView:
    """Three buttons in the Export tab; what they send is made as a job."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
        def add(label: str, hint: str, name: str, make: Callable[[State], bytes]) -> None:
            def send(state: State, client: viser.ClientHandle) -> None:
                client.send_file_download(name, make(state), save_immediately=True)

            on_user(
                gui.add_button(label, hint=hint).on_click,
                lambda client: jobs.run_with_state(session, lambda state: send(state, client), Failed.SAVE),
            )

        with gui.add_folder("Report and data"):
            add("Download report (HTML)", f"{PAGE} Prints on one sheet.", "report.html", html_report)
            add("Download report (PNG)", PAGE, "report.png", png_report)
            add("Download filtered CSV", "Time, raw, filtered and variance of every channel.", "filtered.csv", csv)


def html_report(state: State) -> bytes:
    """The page as HTML."""
    return as_html(_report(state)).encode()


def png_report(state: State) -> bytes:
    """The page as a picture."""
    return as_png(_report(state))


def csv(state: State) -> bytes:
    """The filtered signal of every channel, or the fused one of its sensors."""
    file = io.BytesIO()  # not one text and then its bytes: of 10 million samples each is 0.6 GB
    for text in _csv_chunks(state):
        file.write(text.encode())
    return file.getvalue()


def _csv_chunks(state: State) -> Iterator[str]:
    if state.fusion is not None:
        return filtered_csv_chunks(state.recording, [state.fusion.used])
    state.require_exportable(state.recording.names)
    return filtered_csv_chunks(state.recording, state.as_tuning().channels)


def _report(state: State) -> Report:
    if state.fusion is not None:
        return make_report(state.recording, state.as_tuning(), fusion=state.fusion.used)
    state.require_exportable([state.channel])
    pins = [(variant.name, variant.tuning) for variant in state.variants]
    return make_report(state.recording, state.as_tuning(), state.channel, command=share_line(state).line, pins=pins)
