"""Does the filter fit? The verdict and its buttons below the sliders; the Check tab has the tests behind it."""

from __future__ import annotations

from contextlib import AbstractContextManager

import numpy as np
import viser

from kalscope.analysis.actions import Action, Advice, as_sentences
from kalscope.analysis.diagnostics import Diagnostics
from kalscope.analysis.fit.correction import MIN_SAMPLES
from kalscope.common.array import Array
from kalscope.common.text import correlation, count, number, p_value, percent
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.studies.checks import Checks
from kalscope_app.views.binding import on_user
from kalscope_app.views.charts.chart import Chart, ChartLayout
from kalscope_app.views.charts.style import DARK, LIGHT, axes, line
from kalscope_app.views.tune.advice import label_of, take
from kalscope_app.views.tune.find import FindView

UNJUDGED = "This filter has no q and r, so these tests do not apply."


MAX_ADVICE = 2
"""Pieces of advice that the control panel shows at most."""


class ChecksView:
    """The verdict in one sentence and what to do, each with its button; table and chart in the Check tab."""

    def __init__(self, gui: viser.GuiApi, check_tab: AbstractContextManager[object]) -> None:
        with gui.add_folder("Does it fit?"):
            self._headline = gui.add_markdown("")
            self._advice = [AdviceRow(gui) for _ in range(MAX_ADVICE)]
        with check_tab:
            self._table = gui.add_markdown("")
            self._correlation = Chart(gui, 0.26)

    def connect(self, session: Session, find: FindView) -> None:
        """Let the buttons act: change the session, or search."""
        for row in self._advice:
            row.connect(session, find)

    def show(self, checks: Checks | None) -> None:
        """Write both."""
        advice = () if checks is None else checks.urgent.advice
        for i, row in enumerate(self._advice):
            row.show(advice[i] if i < len(advice) else None, checks)
        if checks is None:
            self._headline.content = self._table.content = UNJUDGED
            self._correlation.hide()
            return
        self._headline.content = f"**{checks.urgent.headline}**"
        self._table.content = table(checks)
        self._correlation.show(*correlation_lines(checks))


class AdviceRow:
    """One piece of advice: what was found, and the button that does something about it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._text = gui.add_markdown("", visible=False)
        self._button = gui.add_button("", visible=False, hint="One step; Undo reverts it.")
        self._shown: tuple[Action, State] | None = None

    def connect(self, session: Session, find: FindView) -> None:
        """Let the button act on what it stands for at the moment of the click."""

        def click() -> None:
            if self._shown is not None:
                take(*self._shown, session, find)

        on_user(self._button.on_click, lambda _client: click())

    def show(self, advice: Advice | None, checks: Checks | None) -> None:
        """Write the advice; without one, or without anything to do about it, take the row or the button away."""
        action = None if advice is None else advice.action
        label = "" if checks is None else label_of(action, checks.state)
        self._shown = (action, checks.state) if action is not None and checks is not None else None
        if label:
            self._button.label = label
        self._text.content = "" if advice is None else as_sentences(advice.text)
        self._text.visible, self._button.visible = advice is not None, bool(label)


def correlation_lines(checks: Checks) -> tuple[Array, list[Array], ChartLayout]:
    """Autocorrelation of the innovation at lags 1 … h, and the 95 % bound of white noise."""
    d, palette = checks.all_samples, DARK if checks.state.view.dark else LIGHT
    lags = np.arange(1.0, len(d.correlation) + 1.0)
    bound = np.full(len(lags), d.r1_bound)
    marks = {"show": True, "size": 7, "space": 0, "fill": palette.innovation}
    layout = ChartLayout(
        (
            {"label": "lag (samples)"},
            line("−bound"),
            line("+bound"),
            {**line("autocorrelation of the innovation", palette.innovation), "points": marks},
        ),
        axes("autocorrelation"),
        ({"series": (2, 1), "fill": palette.innovation_band},),
    )
    return lags, [-bound, bound, d.correlation], layout


def table(checks: Checks) -> str:
    """Each test with the measured and the expected value; markdown."""
    d = checks.all_samples
    if d.n < MIN_SAMPLES:
        return f"**{checks.judgement.headline}**"
    half = "NIS of the second half" + (", fitted on the first" if checks.fitted_on_first_half else "")
    rows = [
        ("Size: mean of v²/s (NIS)", number(d.nis), _band(d)),
        (half, number(checks.held_out.nis), _band(checks.held_out)),
        ("Lag‑1 autocorrelation", correlation(d.r1), f"within ±{correlation(d.r1_bound)}"),
        ("Ljung-Box over several lags", p_value(d.ljung_box_p), "p above 0.05"),
        ("Spikes beyond 4 σ", count(d.spikes), f"about {number(d.spikes_expected, 2)}"),
        ("Low-frequency share of residual power", f"{percent(d.slow_share)}, {p_value(d.slow_p)}", "p above 0.05"),
        (
            "Last third compared with first",
            f"variance × {number(d.variance_ratio)}, {p_value(d.variance_ratio_p)}",
            "p above 0.05",
        ),
        ("Normality (skewness, excess kurtosis)", f"{number(d.skewness)}, {number(d.excess_kurtosis)}", "0, 0"),
    ]
    head = (
        f"**{checks.judgement.headline}**\n\n"
        f"If q and r fit, the innovation is white noise of the expected size. Tested on {count(d.n)} samples.\n\n"
        "| test | measured | expected (95\u00a0%) |\n|---|---|---|\n"
    )
    return head + "\n".join(f"| {name} | **{seen}** | {wanted} |" for name, seen, wanted in rows)


def _band(d: Diagnostics) -> str:
    return f"{number(d.nis_low)} to {number(d.nis_high)}"
