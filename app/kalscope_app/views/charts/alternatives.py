"""Is there a simpler filter? A chart with the current filter and a simpler one, the verdict, and a table of all."""

from __future__ import annotations

import numpy as np
import viser

from kalscope.analysis.alternatives import Alternative
from kalscope.analysis.filter_errors import MIN_OVERSHOOT, Difference
from kalscope.common.text import count, decibels, lag_text, number, percent
from kalscope_app.session.changes.chain import use_chain
from kalscope_app.session.changes.view import set_drawn_alternative, set_match_by
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.studies.alternatives import Compared
from kalscope_app.views.binding import bind, offer, on_user, put
from kalscope_app.views.charts.chart import Chart, ChartLayout
from kalscope_app.views.charts.style import DARK, LIGHT, ChartLine, axes, gappy, line, short
from kalscope_app.views.charts.time_axis import time_label
from kalscope_app.views.markdown import capitalised, escape_markdown
from kalscope_app.views.scales import scale_for, time_scale_for
from kalscope_app.views.window.page.page_script import EXPORT_BUTTON

NAMES: tuple[str, ...] = (
    "Moving average",
    "Exponential",
    "Power-of-two gain",
    "Median",
    "2nd-order Butterworth",
    "Delayed Savitzky-Golay",
    "Centred Savitzky-Golay",
    "One-euro",
    "Smoother (offline bound)",
)
"""Simpler filters as the comparison names them; where a median before one helps, there are rows for that too."""

ALL = "all of them"

MATCHES: dict[str, str] = {"the same lag": "lag", "the same noise reduction": "noise"}
"""Labels, and the values of the state."""

COLOURS = {
    False: ("#009E73", "#0072B2", "#B8860B", "#CC79A7", "#3a9bdc", "#8c6d31", "#6c7a99", "#7b4fc8", "#1b9e8a"),
    True: ("#2fc99b", "#56B4E9", "#F0E442", "#e39ac6", "#8fd0ff", "#c9a15a", "#a9b7d6", "#b79bff", "#3fd6bd"),
}
"""Of the simpler filters in the order of NAMES, light and dark."""

EXPORT_HINT = "Uses the drawn filter instead of yours, and opens the Export tab. Undo reverts it."

NOTHING = "Only the Kalman filter of one channel can be compared at its lag."

HEADS = ("filter", "setting", "lag", "noise", "{error}", "compared with yours")

MAX_UNBROKEN = 13
"""Characters from which a cell of the table may break, so that its seven columns fit at 1280 px."""

AT_OVERSHOOT = 4
"""Index of the overshoot column while the user's filter has momentum: after the noise."""


class AlternativesView:
    """The lower part of the Compare tab."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._to_export: Alternative | None = None
        gui.add_markdown("### Is there a simpler filter?")
        self._match = gui.add_dropdown(
            "matched by", tuple(MATCHES), hint="Filters of equal lag, or of equal noise reduction."
        )
        self._alternative = gui.add_dropdown(
            "draw", list[str]((*NAMES, ALL)), hint="Which filter is plotted beside yours."
        )
        self._export = gui.add_button(EXPORT_BUTTON, visible=False, hint=EXPORT_HINT)
        self._verdict = gui.add_markdown("")
        self._chart = Chart(gui, 0.4, sync="kalscope-time")
        self._table = gui.add_markdown("")
        bind(self._match, session, lambda words: set_match_by(MATCHES.get(words, "lag")))
        bind(self._alternative, session, set_drawn_alternative)
        on_user(self._export.on_click, lambda _client: self._use())

    def _use(self) -> None:
        """The drawn filter becomes that of the channel; the page opens the Export tab."""
        one = self._to_export
        if one is not None and one.chain is not None:
            self._session.request(use_chain(one.chain))

    def on_emptied(self) -> None:
        """The filter that could be exported belongs to an earlier state."""
        self._to_export = None
        put(self._export, visible=False)

    def show(self, compared: Compared | None) -> None:
        """Draw and write."""
        self._to_export = None if compared is None else compared.to_export
        put(self._export, visible=self._to_export is not None)
        for control in (self._match, self._alternative):
            put(control, visible=compared is not None)
        if compared is None:
            self._verdict.content, self._table.content = NOTHING, ""
            self._chart.hide()
            return
        state = compared.state
        match = next(words for words, inner in MATCHES.items() if inner == state.view.match_by)
        names = [one.name for one in compared.found.others]
        drawn = state.view.drawn_alternative if state.view.drawn_alternative in names else ALL
        put(self._match, value=match)
        offer(self._alternative, (*names, ALL), drawn)
        self._verdict.content = verdict_of(compared)
        text = text_of(compared)
        self._table.content = text if compared.state.tuning.chain is None else about_kalman(text)
        self._draw(compared)

    def _draw(self, compared: Compared) -> None:
        state, inside = compared.state, compared.inside
        palette = DARK if state.view.dark else LIGHT
        time, raw = compared.drawn.time[inside], compared.drawn.raw[inside]
        span = float(time[-1] - time[0]) if len(time) > 1 else 1.0
        clock = time_scale_for(span, state.recording.sample_period)
        scale = scale_for(raw, state.tuning.unit)
        yours = "yours" if state.tuning.chain is None else "Kalman"
        lines = [*gappy("raw", raw, palette.raw)]
        if compared.drawn.truth is not None:
            truth = {**line("truth", palette.truth, 1.5), "dash": (6, 4)}
            lines.append(ChartLine(compared.drawn.truth[inside], truth))
        lines.append(
            ChartLine(compared.curve(compared.found.present), line(yours, palette.filtered, 2.5, scaled=False))
        )
        colours = dict(zip(NAMES, COLOURS[state.view.dark], strict=True))
        for one in compared.alternatives:
            lines.append(
                ChartLine(
                    compared.curve(one), line(one.name, colours.get(one.name, palette.truth), 1.5, scaled=False)
                )
            )
        series = ({"label": time_label(clock)}, *(one.style for one in lines))
        gaps = frozenset(i for i, one in enumerate(lines) if one.gaps)
        layout = ChartLayout(series, axes(scale.label(short(state.channel, 14))), gaps=gaps)
        self._chart.show(time * clock.factor, [one.y * scale.factor for one in lines], layout, state.view.resets)


def verdict_of(compared: Compared) -> str:
    """The verdict, and what it is about where another filter runs; markdown."""
    first, dot, rest = compared.found.verdict.partition(". ")
    verdict = f"**{first}{dot.strip()}** {rest}"
    if (chain := compared.state.tuning.chain) is None:
        return verdict
    runs = f"{capitalised(chain.words)} runs now. The comparison is with the Kalman filter of q and r."
    return f"{runs}\n\n{about_kalman(verdict)}"


def about_kalman(text: str) -> str:
    """A text about the user's filter, reworded for a channel that runs another filter."""
    return (
        text.replace("your filter", "the Kalman filter")
        .replace("Your filter", "The Kalman filter")
        .replace("Your outlier gate", "Its outlier gate")
        .replace("with yours", "with Kalman")
        .replace(" (present)", "")
    )


def text_of(compared: Compared) -> str:
    """The table and the text below it; markdown."""
    found, state = compared.found, compared.state
    if not found.others:
        return found.note
    unit = escape_markdown(state.tuning.unit, 12) or "unit"
    head = [text.format(error=f"{'error' if found.present.rmse is None else 'RMSE'}, {unit}") for text in HEADS]
    head[AT_OVERSHOOT:AT_OVERSHOOT] = ["overshoot"] if state.tuning.momentum else []
    rows = [cells(one, state) for one in (found.present, *found.others)]
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    said = "\n".join(f"- {described(one)}" for one in (*compared.alternatives, found.present))
    return (
        f"| {' | '.join(head)} |\n|{'---|' * len(head)}\n{table}\n\n{found.identity}\n\n{said}\n\n{found.note} "
        "The intervals in brackets hold jointly in 95 % of cases. Cut-offs are in cycles per sample."
    )


def described(one: Alternative) -> str:
    """Its advantages and disadvantages, and what it costs."""
    start = (
        "starts at once" if one.start_samples <= 1 else f"forgets its start in {count(one.start_samples)} samples"
    )
    memory = "needs the whole recording" if one.memory == 0 else f"remembers {count(one.memory)} numbers"
    if one.memory == 1:
        memory = "remembers one number"
    return (
        f"**{one.name}.** {one.sentence} It {start}, {memory}, and its steps are {number(one.roughness)} of "
        f"the raw ones. Where samples are missing it {one.gaps}."
    )


def cells(one: Alternative, state: State) -> list[str]:
    """One row of the table."""
    error = one.prediction if one.rmse is None else one.rmse
    row = [
        f"**{one.name}**"
        if one.name == state.view.drawn_alternative or (one.against is None and one.causal)
        else one.name,
        one.parameters,
        lag_text(one.lag_samples, state.recording.sample_period) if one.causal else "looks ahead",
        "–" if np.isnan(one.noise_reduction_db) else decibels(-one.noise_reduction_db),
        *((_overshoot(one.overshoot),) if state.tuning.momentum else ()),
        "–" if error is None else number(error, 4),
        against(one.against) if one.matched or one.against is None else "not at this " + state.view.match_by,
    ]
    return [text.replace(" ", "\u00a0") if len(text) < MAX_UNBROKEN else text for text in row]


def _overshoot(share: float) -> str:
    """The overshoot of the step response; the smoother's is not known."""
    return "–" if np.isnan(share) else "none" if share < MIN_OVERSHOOT else percent(share)


def against(d: Difference | None) -> str:
    """A difference in words: "4.2 % worse (3.3 to 5.3)"."""
    if d is None or np.isnan(d.ratio):
        return "–"
    if np.isinf(d.high):
        return "too short to tell"
    if not d.real:
        return "no significant difference"
    word = "better" if d.ratio < 1.0 else "worse"
    near, far = sorted(100.0 * abs(end - 1.0) for end in (d.low, d.high))
    return f"{percent(abs(d.ratio - 1.0))} {word} ({number(near, 2)} to {number(far, 2)})"
