"""What q, r and momentum give: lag, noise reduction, cut-off, gain, settling time, overshoot."""

from __future__ import annotations

import math

import viser

from kalscope.common.text import decibels, frequency, lag_in_full, lag_text, number, percent, plural
from kalscope.filtering.classic.stages import OneEuro
from kalscope.filtering.steady_state import SteadyState
from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.momentum import momentum_words
from kalscope_app.views.tune.goal.answer import account_text


class NumbersView:
    """A table of derived numbers below the sliders, and below it what the current estimate found."""

    def __init__(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Resulting filter", expand_by_default=False):
            self._table = gui.add_markdown("")
            self._account = gui.add_markdown("", visible=False)

    def show(self, frame: Frame) -> None:
        """Write the table and the account."""
        self._table.content = table(frame)
        account = account_text(frame.state)
        self._account.content, self._account.visible = account, bool(account)


def table(frame: Frame) -> str:
    """One markdown row for each number, with its unit."""
    steady, params = frame.steady, frame.state.params
    lag, settle = steady.lag_samples, steady.settle_samples
    period = frame.state.recording.sample_period
    rows = [
        ("lag (delay)", _time_in_bold(lag_in_full(lag, period))),
        ("noise reduction", f"**{decibels(steady.noise_reduction_db)}**"),
    ]
    if frame.state.tuning.momentum > 0.0 and frame.state.uses_parameters:
        rows += [
            ("overshoot (step)", f"**{percent(steady.overshoot)}**"),
            ("keeps direction", _time_in_bold(lag_in_full(frame.state.tuning.momentum, period))),
        ]
    if steady.cutoff_hz is not None and (frame.state.filter.is_standard or math.isfinite(steady.cutoff_hz)):
        rows.append(("cut-off (−3 dB)", f"**{frequency(float(steady.cutoff_hz))}**"))
    if frame.state.has_gain:
        rows.append(("gain K", f"**{number(steady.gain)}**"))
    if frame.state.uses_parameters:
        rows.append(("q / r", f"**{number(params.ratio)}**"))
    chain = frame.state.tuning.chain
    if chain is None or not isinstance(chain.then, OneEuro):  # it settles faster, the larger a step is
        rows.append(("settling (to 1\u00a0%)", _time_in_bold(lag_in_full(settle, period))))
    if params.gate is not None and frame.state.uses_parameters:
        rows.append(("rejected by the gate", f"**{plural(frame.rejected, 'sample')}**"))
    return "| | |\n|---|---|\n" + "\n".join(f"| {name} | {value} |" for name, value in rows)


def _time_in_bold(text: str) -> str:
    time, bracket, samples = text.partition(" (")
    return f"**{time}**{bracket}{samples}"


def rows_of(
    momenta: tuple[float, float], settled: tuple[SteadyState, SteadyState], period: float | None
) -> list[tuple[str, str, str]]:
    """Two filters side by side: lag and noise, and where one has momentum that and the overshoot."""
    rows = [
        ("lag", *(lag_text(float(one.lag_samples), period) for one in settled)),
        ("noise", *(decibels(-float(one.noise_reduction_db)) for one in settled)),
    ]
    if any(momenta):
        rows.insert(0, ("momentum", *(momentum_words(one, period) for one in momenta)))
        rows.append(("overshoot", *(percent(float(one.overshoot)) for one in settled)))
    return [(name, before, after) for name, before, after in rows]
