"""Find q and r from the recording, from a goal for the filter, or from what is known about the sensor."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace

import viser

from kalscope.common.text import lag_text, number, typed_number
from kalscope.errors import BadSetting
from kalscope.estimation.agreement.comparison import compare_methods
from kalscope.estimation.agreement.words import comparison
from kalscope.estimation.finding import METHOD_NAMES, Noise, Request, find_parameters
from kalscope.filtering.steady_state import steady_state
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes.parameters import apply_found, set_method_comparison
from kalscope_app.session.changes.view import set_search_method
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.views.binding import bind, on_user
from kalscope_app.views.scales import Scale, time_scale_for
from kalscope_app.views.slow_job import SlowJobProgress
from kalscope_app.views.tune.numbers import rows_of

OVERSHOOT = "overshoot (%)"
"""Label of the box for the overshoot that a target may cost."""


@dataclass(frozen=True)
class SearchMethod:
    """One way to find q and r."""

    request: Callable[[State, list[str]], Request]
    """What to look for, from the state and the typed texts."""
    boxes: tuple[tuple[str, str], ...] = ()
    """Label and first content of each text box it needs."""


def _method(name: str) -> SearchMethod:
    return SearchMethod(lambda _state, _texts: Request(name))


def _target(
    name: str, label: str, content: str, factor: float = 1.0, *, with_overshoot: bool = False
) -> SearchMethod:
    def request(state: State, texts: list[str]) -> Request:
        allowed = texts[1].strip() if with_overshoot and len(texts) > 1 else ""
        asked = Request(target={name: factor * typed_number(label, texts[0])}, present_r=state.tuning.r)
        if allowed:
            return replace(asked, overshoot=typed_number("overshoot", allowed) / 100.0)
        return replace(asked, momentum=state.tuning.momentum)

    return SearchMethod(request, ((label, content), *(((OVERSHOOT, ""),) if with_overshoot else ())))


def _noise(*names: tuple[str, str, str]) -> SearchMethod:
    def request(_state: State, texts: list[str]) -> Request:
        values = {name: typed_number(label, text) for (name, label, _), text in zip(names, texts, strict=False)}
        sigma, density, bandwidth = (values.get(name) for name in ("sigma", "density", "bandwidth_hz"))
        return Request(noise=Noise(sigma=sigma, density=density, bandwidth_hz=bandwidth))

    return SearchMethod(request, tuple((label, content) for _, label, content in names))


def _still(state: State, texts: list[str]) -> Request:
    """The stretch that is typed, in the unit of the time axis, or else the part on screen."""
    if state.view.window is None and not all(text.strip() for text in texts):
        raise BadSetting(
            "the still stretch must be given: type from and to, or narrow the view to it (got neither)"
        )
    time, factor = state.recording.time, clock_of(state).factor
    shown = state.view.window or (float(time.min()), float(time.max()))
    first, last = (
        typed_number(label, text) / factor if text.strip() else default
        for label, text, default in zip(("from", "to"), texts, shown, strict=False)
    )
    low, high = min(first, last), max(first, last)
    slack = 1e-9 * max(abs(low), abs(high))  # 0.1 h typed is 360 s only nearly
    at = ((time >= low - slack) & (time <= high + slack)).nonzero()[0]
    if len(at) == 0:
        raise BadSetting(
            "the still stretch must lie inside the recording "
            f"(got {number(low * factor, 4)} to {number(high * factor, 4)})"
        )
    return Request(noise=Noise(still=(int(at[0]), int(at[-1]) + 1)))


def clock_of(state: State) -> Scale:
    """Unit of the time axis on screen."""
    time = state.recording.time
    first, last = state.view.window or (float(time.min()), float(time.max()))
    return time_scale_for(last - first, state.recording.sample_period)


STILL = "a still stretch, fit q"

BOX_HINTS = {
    "": "A number that this method needs.",
    "lag (ms)": "The largest lag that you accept: the setting within it that leaves the least noise is used.",
    "cut-off (Hz)": "Higher frequencies are attenuated, lower ones pass.",
    "reduction (dB)": "How much less noise: 20 dB is a tenth of its size, 6 dB half of it.",
    OVERSHOOT: "How far a step may overshoot: more of it gives less noise or lag. Empty: the present momentum.",
    "gain K": "The weight of each new sample in the estimate, between 0 and 1.",
    "lag (samples)": "Delay of the filtered signal behind a steady slope, samples.",
    "from": "Where the stretch begins, as on the time axis. Empty: where the part on screen begins.",
    "to": "Where the stretch ends, as on the time axis. Empty: where the part on screen ends.",
    "σ, one std": "The noise of one reading, one standard deviation, in the unit of the signal.",
    "per √Hz": "The noise density, in the unit of the signal per √Hz.",
    "bandwidth (Hz)": "The bandwidth that goes with the density.",
}
"""Hint of each box by its label."""

SEARCH_METHODS: dict[str, SearchMethod] = {
    "maximum likelihood": _method("ml"),
    "maximum lag": _target("lag_s", "lag (ms)", "50", 1e-3, with_overshoot=True),
    "cut-off frequency": _target("cutoff_hz", "cut-off (Hz)", "1"),
    "noise reduction": _target("noise_reduction_db", "reduction (dB)", "12", with_overshoot=True),
    "gain K": _target("gain", "gain K", "0.1"),
    "lag in samples": _target("lag_samples", "lag (samples)", "10", with_overshoot=True),
    STILL: SearchMethod(_still, (("from", ""), ("to", ""))),
    "data sheet σ, fit q": _noise(("sigma", "σ, one std", "")),
    "data sheet density, fit q": _noise(("density", "per √Hz", ""), ("bandwidth_hz", "bandwidth (Hz)", "")),
    "keep r, fit q": SearchMethod(lambda state, _texts: Request(noise=Noise(r=state.tuning.r))),
    "r/q = 100, fit r": SearchMethod(lambda _state, _texts: Request(ratio=0.01)),
    **{METHOD_NAMES[name]: _method(name) for name in ("em", "moments", "als", "allan")},
}
"""Ways by the words on screen, the most useful first."""

HINT = "From the recording, from a goal (lag, cut-off, noise reduction), or from what you know about the sensor."


FIVE_METHODS = (
    "Five methods estimate q and r from the recording, without momentum; *Find and apply* by maximum likelihood "
    "tries momentum too."
)
"""Why the table may find no noise where the search finds some: stands above it too."""


class FindView:
    """The folder "Find q and r". A search runs as a job; its answer is filed as one undoable change."""

    def __init__(
        self, gui: viser.GuiApi, check_tab: AbstractContextManager[object], session: Session, jobs: Jobs
    ) -> None:
        self._session, self._jobs = session, jobs
        self._shown_method = ""
        self._stop = threading.Event()
        with gui.add_folder("Find q and r"):
            self._method = gui.add_dropdown("tune for", tuple(SEARCH_METHODS), hint=HINT)
            self._boxes = [gui.add_text("", "", visible=False, hint=BOX_HINTS[""]) for _ in range(2)]
            self._find = gui.add_button("Find and apply", hint="One step; Undo reverts it.")
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._cancel = gui.add_button("Cancel", visible=False, hint="Stop the search and change nothing.")
            self._answer = gui.add_markdown("", visible=False)
        bind(self._method, session, lambda method: set_search_method(method, SEARCH_METHODS))
        on_user(self._find.on_click, lambda _client: self._find_and_apply())
        on_user(self._cancel.on_click, lambda _client: self._stop.set())
        with check_tab:
            gui.add_markdown("### Compare estimators")
            compare = gui.add_button("Run five methods", hint="They agree if the model fits the signal.")
            self._comparison = gui.add_markdown("")
        on_user(compare.on_click, lambda _client: self._start(self._compare))

    def _find_and_apply(self) -> None:
        texts = [box.value for box in self._boxes]
        self._start(lambda state, stop: self._search(state, SEARCH_METHODS[state.view.search_method], texts, stop))

    def _start(self, work: Callable[[State, threading.Event], None]) -> None:
        """Queue a job on the state that every earlier request has led to; each job has a stop sign of its own."""
        stop = self._stop = threading.Event()
        self._jobs.run_with_state(self._session, lambda state: work(state, stop))

    def _search(self, state: State, method: SearchMethod, texts: list[str], stop: threading.Event) -> None:
        z, period = state.recording.channel(state.channel), state.recording.sample_period
        with SlowJobProgress(self._progress, self._cancel) as shown:
            found = find_parameters(
                z,
                method.request(state, texts),
                dt=state.dt,
                sample_period=period,
                progress=shown.report,
                cancelled=stop.is_set,
            )
        self._session.request(apply_found(state.recording, state.channel, found))

    def _compare(self, state: State, stop: threading.Event) -> None:
        z = state.recording.channel(state.channel)
        with SlowJobProgress(self._progress, self._cancel) as shown:
            opinions = compare_methods(z, state.dt, progress=shown.report, cancelled=stop.is_set)
        self._session.request(set_method_comparison(state.recording, state.channel, opinions))

    def show(self, frame: Frame) -> None:
        """Show the boxes of the chosen method, and the last answers."""
        self._show_method(frame.state)
        answer = answer_text(frame.state)
        self._answer.content, self._answer.visible = answer, bool(answer)
        self._comparison.content = comparison_text(frame.state)

    def _show_method(self, state: State) -> None:
        self._method.value = state.view.search_method
        wanted = SEARCH_METHODS[state.view.search_method].boxes
        for i, box in enumerate(self._boxes):
            box.visible = i < len(wanted)
            if i < len(wanted):
                label, content = wanted[i]
                box.label = f"{label} ({clock_of(state).unit})" if label in ("from", "to") else label
                if state.view.search_method != self._shown_method:
                    box.value = content
                box.hint = BOX_HINTS.get(label, BOX_HINTS[""])
        self._shown_method = state.view.search_method


def answer_text(state: State) -> str:
    """The last answer with before and after, as markdown; made of our own words and numbers."""
    outcome = state.answers.outcome
    if outcome is None:
        return ""
    if outcome.after is None:
        return f"**{outcome.how}: nothing was changed.** {outcome.message}"
    period = state.recording.sample_period
    before, after = outcome.before, outcome.after

    settled = steady_state(before.params), steady_state(after.params)
    rows = [
        ("q", number(before.q, 4), number(after.q, 4)),
        ("r", number(before.r, 4), number(after.r, 4)),
        *rows_of((before.momentum, after.momentum), settled, period),
    ]
    table = "| | before | now |\n|---|---|---|\n" + "\n".join(f"| {n} | {b} | **{a}** |" for n, b, a in rows)
    return f"{table}\n\n{outcome.message}"


def comparison_text(state: State) -> str:
    """The five methods side by side and their disagreement named, as markdown."""
    if not state.answers.method_comparison:
        return f"{FIVE_METHODS} They agree if the model describes the signal."
    period = state.recording.sample_period
    rows: list[str] = []
    for one in state.answers.method_comparison:
        steady = steady_state(one.params) if one.params is not None else None
        lag = "–" if steady is None else lag_text(float(steady.lag_samples), period)
        gain = "–" if steady is None else number(float(steady.gain))
        q, r, verdict = number(float(one.q)), number(float(one.r)), str(one.verdict).replace("_", " ")
        rows.append(f"| {METHOD_NAMES[one.method]} | {q} | {r} | {gain} | {lag} | {verdict} |")
    said = comparison(state.answers.method_comparison) or "No two of them can be compared."
    head = "| method | q | r | gain K | lag | verdict |\n|---|---|---|---|---|---|\n"
    message = state.answers.method_comparison[0].message
    return f"{FIVE_METHODS}\n\n{head}{chr(10).join(rows)}\n\n**{said}**\n\n{message}"
