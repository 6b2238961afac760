"""Does the filter fit? One coloured word above the tabs; a click shows or hides why, and what to do about it."""

from __future__ import annotations

import viser

from kalscope.analysis.actions import Action
from kalscope.analysis.findings import Finding, as_sentences
from kalscope.analysis.judge import MAX_ADVICE, Judgement
from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.view import set_why_shown
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.studies.checks import Checks
from kalscope_app.studies.fusion import Judged
from kalscope_app.views.binding import on_user
from kalscope_app.views.markdown import escape_markdown
from kalscope_app.views.tune.advice import label_of, take
from kalscope_app.views.tune.goal.goal import GoalView
from kalscope_app.views.window.css import VERDICT

UNJUDGED = "These tests judge the Kalman filter of one channel; another filter is on screen."

COLOURS = {"good": (0, 122, 90), "note": (176, 98, 0), "bad": (196, 46, 22)}
"""Of the word, by tone; the page lightens them for the dark theme."""


class VerdictView:
    """The word, and below it the headline with its advice."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._shown = False
        gui.add_html(VERDICT)
        self._word = gui.add_button("…", hint="Whether the filter fits the recording. Click for the reasons.")
        on_user(self._word.on_click, lambda _client: session.request(set_why_shown(not self._shown)))

    def build_reasons(self, gui: viser.GuiApi) -> None:
        """What the word hides: built separately, so that another button can be placed beside the word."""
        with gui.add_folder(None, visible=False) as self._why:
            self._headline = gui.add_markdown("")
            self._advice = [AdviceRow(gui) for _ in range(MAX_ADVICE)]

    def connect(self, session: Session, goal: GoalView) -> None:
        """Let the buttons act: change the session, or search."""
        for row in self._advice:
            row.connect(session, goal)

    def show(self, frame: Frame) -> None:
        """Show or hide the reasons."""
        self._shown = self._why.visible = frame.state.view.why_shown

    def on_emptied(self) -> None:
        """Without its reasons the word, too, is that of an earlier state, and so are the buttons."""
        self._word.label, self._word.color = "…", COLOURS["note"]
        for row in self._advice:
            row.show(None, None)

    def _show_judged(self, judged: Judged) -> None:
        self._word.label, self._word.color = word_of(judged.judgement)
        self._headline.content = reasons_of(judged)
        for row in self._advice:
            row.show(None, None)

    def show_checks(self, checks: Checks | Judged | None) -> None:
        """Write the word and the reasons."""
        if isinstance(checks, Judged):
            self._show_judged(checks)
            return
        judgement = None if checks is None else checks.urgent
        self._word.label, self._word.color = word_of(judgement)
        self._headline.content = UNJUDGED if judgement is None else f"**{judgement.headline}**"
        advice = () if judgement is None else judgement.findings
        for i, row in enumerate(self._advice):
            row.show(advice[i] if i < len(advice) else None, checks)


def reasons_of(judged: Judged) -> str:
    """The headline and the faults of fused sensors, as markdown."""
    judgement = judged.judgement
    faults = [escape_markdown(one.text, 400) for one in judgement.findings]
    return "\n\n".join([f"**{escape_markdown(judgement.headline, 400)}**", *faults])


def word_of(judgement: Judgement | None) -> tuple[str, tuple[int, int, int]]:
    """The label of the button, and its colour."""
    if judgement is None:
        return "not judged", COLOURS["note"]
    return judgement.word, COLOURS[judgement.tone]


class AdviceRow:
    """One piece of advice: what was found, and the button that does something about it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._text = gui.add_markdown("", visible=False)
        self._button = gui.add_button("", visible=False, hint="One step; Undo reverts it.")
        self._shown: tuple[Action, State] | None = None

    def connect(self, session: Session, goal: GoalView) -> None:
        """Let the button act on the advice that is shown at the moment of the click."""

        def click() -> None:
            if self._shown is not None:
                take(*self._shown, session, goal)

        on_user(self._button.on_click, lambda _client: click())

    def show(self, advice: Finding | None, checks: Checks | None) -> None:
        """Write the advice; without one, or without anything to do about it, take the row or the button away."""
        action = None if advice is None else advice.action
        label = "" if checks is None else label_of(action, checks.state)
        self._shown = (action, checks.state) if action is not None and checks is not None else None
        if label:
            self._button.label = label
        self._text.content = "" if advice is None else as_sentences(advice.text)
        self._text.visible, self._button.visible = advice is not None, bool(label)
