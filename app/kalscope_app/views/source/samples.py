"""Recordings that come with Kalscope, the figures of the source documents, and their page with Table 1."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import viser

from kalscope.papers.experiments import list_experiments
from kalscope.sources.samples import list_samples
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.opening import opened_experiment
from kalscope_app.session.session import Failed, Session
from kalscope_app.views.binding import on_user
from kalscope_app.views.slow_job import SlowJobProgress
from kalscope_app.views.window.css import PRIMARY

if TYPE_CHECKING:
    from kalscope.papers.parts import Experiment
    from kalscope.papers.reproduction import Reproduction

NONE = "–"

PAGE_NAME = "kalscope-papers.html"

AUTHORS = {"noise_reducer": "Ma'arif 2019", "generalized": "Khan", "lis302dl": "interactive matter 2009"}
"""Source documents, by what their experiments' names begin with."""


class SamplesView:
    """The folder "Samples and papers" of the Source tab."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, open_spec: Callable[[str, Failed], None]
    ) -> None:
        """Args: the usual; opens the source of this name."""
        self._jobs, self._stop = jobs, threading.Event()
        self._page: Reproduction | None = None
        self._samples = {sample_label(sample.title, sample.made): sample.name for sample in list_samples()}
        self._figures = {experiment_label(one): one.name for one in list_experiments()}
        with gui.add_folder("Samples and papers"):
            self._sample = gui.add_dropdown(
                "sample", (NONE, *self._samples), hint="Recordings that come with Kalscope."
            )
            self._figure = gui.add_dropdown(
                "re-created figure",
                (NONE, *self._figures),
                hint="Figures of the three source documents, which publish pictures and no data.",
            )
            page = gui.add_button(
                "Open the paper page", hint="Recomputes Table 1 and every figure, in about 10 s, as one page."
            )
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._cancel = gui.add_button("Cancel", visible=False, hint="Stop computing the page.")

        def open_sample() -> None:
            if (name := self._samples.get(self._sample.value)) is not None:
                open_spec(f"sample:{name}", Failed.OPEN)

        def open_figure() -> None:
            if (name := self._figures.get(self._figure.value)) is not None:
                session.request(lambda state: opened_experiment(name, state), failed=Failed.OPEN)

        on_user(self._sample.on_update, lambda _client: open_sample())
        on_user(self._figure.on_update, lambda _client: open_figure())
        on_user(page.on_click, self._open_page)
        on_user(self._cancel.on_click, lambda _client: self._stop.set())

    def _open_page(self, client: viser.ClientHandle) -> None:
        stop = self._stop = threading.Event()

        def work() -> None:
            from kalscope.papers.reproduction import reproduce  # with matplotlib, which starts slowly

            if self._page is None:  # the same at every run
                with SlowJobProgress(self._progress, self._cancel) as shown:
                    self._page = reproduce(progress=shown.report, cancelled=stop.is_set)
            show_page(client, self._page)

        self._jobs.run(work, Failed.REPRODUCE)

    def show(self, frame: Frame) -> None:
        """Show which sample or figure is open."""
        source = frame.state.recording.source
        for menu, names, kind in (
            (self._sample, self._samples, "sample:"),
            (self._figure, self._figures, "experiment:"),
        ):
            menu.value = next((label for label, name in names.items() if source == f"{kind}{name}"), NONE)


def sample_label(title: str, made: str) -> str:
    """A sample in the menu, and how it was made where it was not measured."""
    return f"{title} ({made})" if made else title


def experiment_label(experiment: Experiment) -> str:
    """Author and figure, short enough for a menu."""
    author = next(words for start, words in AUTHORS.items() if experiment.name.startswith(start))
    return f"{author}: {experiment.title.removeprefix('LIS302DL: ')}"


def show_page(client: viser.ClientHandle, page: Reproduction) -> None:
    """A window with Table 1, and the whole page as a download."""
    with client.gui.add_modal("Ma'arif 2019, Table 1") as window:
        client.gui.add_markdown(table_1(page))
        download = client.gui.add_button(
            "Download the whole page (HTML)", color=PRIMARY, hint="All figures and tables; one file."
        )
        close = client.gui.add_button("Close")

    def send(client: viser.ClientHandle) -> None:
        client.send_file_download(PAGE_NAME, page.html.encode(), save_immediately=True)

    on_user(download.on_click, send)
    on_user(close.on_click, lambda _client: window.close())


def table_1(page: Reproduction) -> str:
    """Table 1 as markdown, and how many reproduced numbers hold."""
    rows = [
        f"| {row['r']:g} | {row['q']:g} | "
        + " | ".join(f"{row[key]:.4f}" for key in ("printed", "simulated", "theoretical"))
        + " |"
        for row in page.results["noise_reducer"]["table_1"]
    ]
    head = "| R | Q | printed | simulated | theory |\n|---|---|---|---|---|\n"
    within = len(page.checks) - len(page.failed)
    said = f"{within} of {len(page.checks)} reproduced numbers of all three documents are within their tolerance."
    return f"Mean error of the filtered signal.\n\n{head}{chr(10).join(rows)}\n\n{said}"
