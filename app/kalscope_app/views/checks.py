"""Does the filter fit? The verdict with its advice, and the Check tab."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import viser

from kalscope.analysis import actions
from kalscope.analysis.actions import Action
from kalscope.analysis.correction import MIN_SAMPLES
from kalscope.analysis.diagnostics import expected_nis, residual_rows
from kalscope.analysis.findings import Finding, as_sentences, times
from kalscope.analysis.judge import MAX_ADVICE
from kalscope.common.numbers import Array
from kalscope.common.text import count, number, trimmed
from kalscope.estimation.request import Noise, Request
from kalscope.filtering.steady import steady_state
from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes import FOR_LAG, change_for, is_same_signal, set_why_shown
from kalscope_app.session.opening import NOT_FITTED
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.studies.checks import Checks, Judged
from kalscope_app.views.charts import Chart, ChartLine, band, line, marks, palette_of, range_text, time_scale_for
from kalscope_app.views.widgets import add_button, capitalised, escape_markdown, table_of
from kalscope_app.views.window import VERDICT

# Advice as buttons: the label of each, and the one undoable step that it takes.


Search = Callable[[State], Request | None]
"""What to search for on the state that is present then."""

WORDS: dict[type[object], str] = {
    actions.EstimateAgain: "Fit again",
    actions.AddMomentum: "Add momentum at this lag",
    actions.AddTwoSpeeds: "Add two speeds",
    actions.AddNotch: "Add a notch",
    actions.SetSpikesAside: "Set the spikes aside and fit again",
    actions.GiveNoise: "Give the noise of the sensor",
    actions.ChooseFilter: "Choose a lag",
    actions.UnsetStart: "Start from the first sample",
}
"""Labels of what has no numbers."""


def label_of(action: actions.Action | None, state: State) -> str:
    """The label of the button; "" where there is none, as for a new recording or a goal that is chosen already."""
    match action:
        case actions.SetGate(sigma):
            return "Switch the gate off" if sigma is None else f"Switch the gate on ({trimmed(sigma)} σ)"
        case actions.UseStillStretch(first, last):
            return f"Use the still stretch {stretch_text(state, first, last)}"
        case actions.Scale(q, r):
            return _scale_words(q, r)
        case actions.ChooseFilter() if state.view.search_method == FOR_LAG:
            return ""
        case _:
            return WORDS.get(type(action), "")


def take(action: actions.Action, state: State, session: Session, search: Callable[[Search], object]) -> None:
    """Do what a piece of advice about `state` says, as one step that Undo takes back.

    Args:
        action: what to do.
        state: the state that was judged; nothing is done once another recording or channel is on screen.
        session: where the change is filed.
        search: starts a search where one is needed.
    """
    request = request_of(action, state)
    if request is None:
        session.request(change_for(action, state))
    else:
        search(lambda present: request if is_same_signal(present, state) else None)


SEARCHES: dict[type[actions.Action], Request] = {
    actions.EstimateAgain: Request(),
    actions.AddTwoSpeeds: Request(two_speeds=True),
    actions.AddNotch: Request(notch="auto"),
}
"""The searches of actions that say nothing more."""


def request_of(action: actions.Action, state: State) -> Request | None:
    """The search that an action asks for about `state`; None where it asks for none."""
    match action:
        case actions.UseStillStretch(first, last):
            return Request(noise=Noise(still=(first, last)))
        case actions.SetSpikesAside():
            outcome = state.searched
            before = Request() if outcome is None or outcome.request is None else outcome.request
            return replace(before, robust=True)  # what was known about the noise still is
        case actions.AddMomentum(tau):
            lag = float(steady_state(state.params).lag_samples)
            return Request(target={"lag_samples": lag}, momentum=tau)
        case _:
            return SEARCHES.get(type(action))


def stretch_text(state: State, first: int, last: int) -> str:
    """A stretch of samples by its times: 12 to 19 s."""
    time = state.recording.time
    clock = time_scale_for(float(time.max() - time.min()), state.recording.sample_period)
    ends = (float(time[at]) * clock.factor for at in (first, last - 1))
    return f"{range_text(*ends)} {clock.unit}"


def _scale_words(q: float, r: float) -> str:
    """The change of q and r in words: "Raise q 10 × and lower r 2 ×"."""
    verbs = (("raise" if factor > 1.0 else "lower", name, factor) for name, factor in (("q", q), ("r", r)))
    parts = [f"{verb} {name} {times(max(size, 1.0 / size))}" for verb, name, size in verbs if size != 1.0]
    return capitalised(" and ".join(parts))


# Does the filter fit? One coloured word above the tabs; a click shows or hides why, and what to do about it.


UNJUDGED = "Not judged: the tests are for one Kalman filter. A chain of filters is no model of the signal."

COLOURS = {"good": (0, 122, 90), "note": (150, 82, 0), "bad": (196, 46, 22)}
"""Of the word, by tone; the page lightens them for the dark theme."""


class VerdictView:
    """The word, and below it the headline with its advice."""

    search: Callable[[Search], object]
    """Starts the searches that advice asks for."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._shown, self._unjudged = session, False, "no verdict"
        gui.add_html(VERDICT)
        hint = "Whether the filter fits the recording. Click for the reasons."
        self._word = add_button(gui, "…", hint, lambda _client: session.request(set_why_shown(not self._shown)))

    def build_reasons(self, gui: viser.GuiApi) -> None:
        """What the word hides: built separately, so that another button can be placed beside the word."""
        with gui.add_folder(None, visible=False) as self._why:
            self._headline = gui.add_markdown("")
            self._advice = [AdviceRow(gui, self._take) for _ in range(MAX_ADVICE)]

    def _take(self, action: Action, state: State) -> None:
        take(action, state, self._session, self.search)

    def show(self, frame: Frame) -> None:
        """Show or hide the reasons."""
        self._shown = self._why.visible = frame.state.view.why_shown
        self._unjudged = "…" if frame.state.tuning.how == NOT_FITTED else "no verdict"

    def on_emptied(self) -> None:
        """Without its reasons the word, too, is that of an earlier state, and so are the buttons."""
        self._word.label, self._word.color = "…", COLOURS["note"]
        for row in self._advice:
            row.show(None, None)

    def show_checks(self, checks: Checks | Judged | None) -> None:
        """Write the word and the reasons."""
        judged = isinstance(checks, Judged)
        judgement = None if checks is None else checks.judgement if judged else checks.urgent
        self._word.label, tone = (self._unjudged, "note") if judgement is None else (judgement.word, judgement.tone)
        self._word.color = COLOURS[tone]
        headline = UNJUDGED if judgement is None else f"**{judgement.headline}**"
        self._headline.content = reasons_of(checks) if judged else headline
        advice = () if judgement is None or judged else judgement.findings
        for i, row in enumerate(self._advice):
            row.show(advice[i] if i < len(advice) else None, None if judged else checks)


def reasons_of(judged: Judged) -> str:
    """The headline and the faults of fused sensors, as markdown."""
    judgement = judged.judgement
    faults = [escape_markdown(one.text, 400) for one in judgement.findings]
    return "\n\n".join([f"**{escape_markdown(judgement.headline, 400)}**", *faults])


class AdviceRow:
    """One piece of advice: what was found, and the button that does something about it."""

    def __init__(self, gui: viser.GuiApi, act: Callable[[Action, State], None]) -> None:
        """Args: the panel; does what was advised about a state."""
        self._text = gui.add_markdown("", visible=False)
        self._shown: tuple[Action, State] | None = None
        hint = "One step; Undo reverts it."
        self._button = add_button(gui, "", hint, lambda _: self._shown and act(*self._shown), visible=False)

    def show(self, advice: Finding | None, checks: Checks | None) -> None:
        """Write the advice; without one, or without anything to do about it, take the row or the button away."""
        action = None if advice is None else advice.action
        label = "" if checks is None else label_of(action, checks.state)
        self._shown = (action, checks.state) if action is not None and checks is not None else None
        if label:
            self._button.label = label
        self._text.content = "" if advice is None else as_sentences(advice.text)
        self._text.visible, self._button.visible = advice is not None, bool(label)


# The Check tab: the tests of the residuals behind the verdict.


class ChecksView:
    """Table and chart in the Check tab."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._table = gui.add_markdown("")
        self._correlation = Chart(gui, 0.26)

    def show(self, checks: Checks | Judged | None) -> None:
        """Write and draw; the residuals of fused sensors have no such tests."""
        if not isinstance(checks, Checks):
            self._table.content = UNJUDGED
            self._correlation.hide()
            return
        self._table.content = table(checks)
        x, lines = correlation_lines(checks)
        self._correlation.draw(x, lines, "lag (samples)", "autocorrelation")


def correlation_lines(checks: Checks) -> tuple[Array, list[ChartLine]]:
    """Autocorrelation of the innovation at lags 1 … h, and the 95 % bound of white noise."""
    d, palette = checks.all_samples, palette_of(checks.state)
    bound = np.full(len(d.correlation), d.r1_bound)
    edges = band(0.0, bound, "bound", palette.innovation + palette.band, scaled=True)
    points, name = marks(palette.innovation, 7), "autocorrelation of the innovation"
    return np.arange(1.0, len(bound) + 1.0), [*edges, line(d.correlation, name, palette.innovation, points=points)]


def table(checks: Checks) -> str:
    """Each test with the measured and the expected value; markdown."""
    d = checks.all_samples
    if d.n < MIN_SAMPLES:
        return f"**{checks.judgement.headline}**"
    half = "NIS of the second half" + (", fitted on the first" if checks.fitted_on_first_half else "")
    size, *others = residual_rows(d)
    rows = [size, (half, number(checks.held_out.nis), expected_nis(checks.held_out)), *others]
    cells = [
        {"test": name, "measured": f"**{seen}**", "expected (95\u00a0%)": wanted} for name, seen, wanted in rows
    ]
    return (
        f"**{checks.judgement.headline}**\n\n"
        "If q and r fit, the innovation is white noise of the expected size. "
        f"Tested on {count(d.n)} samples.\n\n{table_of(cells)}"
    )
