"""The charts in tabs: simpler filters, all channels, spectra and Allan deviation."""

from __future__ import annotations

import math

import numpy as np
import viser

from kalscope.analysis.alternatives import Alternative
from kalscope.analysis.filter_errors import Difference
from kalscope.analysis.spectrum import AllanDeviation, Spectrum
from kalscope.common.numbers import Array
from kalscope.common.text import count, frequency, lag_text, noise_left, number, percent, squared
from kalscope.filtering.classic import Chain
from kalscope.filtering.steady import steady_state
from kalscope_app.engine.frame import Frame
from kalscope_app.session import changes
from kalscope_app.session.session import Session
from kalscope_app.session.state import LINKS, State
from kalscope_app.studies.checks import Spectra
from kalscope_app.studies.comparisons import HALF_LANE, Compared, Lane, Overview
from kalscope_app.views import charts
from kalscope_app.views.charts import Chart, ChartLine, Scale, palette_of, short, time_axis
from kalscope_app.views.export import show_files
from kalscope_app.views.widgets import add_button, bind, capitalised, escape_markdown, offer, put, table_of
from kalscope_app.views.window import EXPORT_BUTTON

# Is there a simpler filter? A chart with the current filter and a simpler one, the verdict, and a table of all.


NAMES: tuple[str, ...] = (
    "Moving average",
    "Exponential",
    "Median",
    "2nd-order Butterworth",
    "One-euro",
    "Fixed lag",
    "Smoother (offline bound)",
)
"""Simpler filters as the comparison names them; a fixed lag is only there where it gains."""

ALL = "all of them"

MATCHES: dict[str, str] = {"the same lag": "lag", "the same noise reduction": "noise"}
"""Labels, and the values of the state."""

EXPORT_HINT = "Uses the drawn filter instead of yours, and opens the Export tab. Undo reverts it."

NOTHING = "Only the Kalman filter of one channel can be compared at its lag."

MIN_OVERSHOOT = 5e-4
"""Smaller ones are none."""


class AlternativesView:
    """The lower part of the Compare tab."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._chain: Chain | None = None
        self._texts: dict[str, str] = {}
        gui.add_markdown("### Is there a simpler filter?")
        hint = "Filters of equal lag, or of equal noise reduction."
        match = gui.add_dropdown("matched by", tuple(MATCHES), hint=hint)
        self._match = bind(match, session, lambda words: changes.set_match_by(MATCHES.get(words, "lag")))
        draw = gui.add_dropdown("draw", list[str]((*NAMES, ALL)), hint="Which filter is plotted beside yours.")
        self._alternative = bind(draw, session, changes.set_drawn_alternative)
        self._export = add_button(gui, EXPORT_BUTTON, EXPORT_HINT, self._use, visible=False)
        hint = "The drawn filter in ESPHome, Home Assistant and others: texts to copy."
        self._settings = add_button(gui, "Settings of this one", hint, self._show_settings, visible=False)
        self._verdict = gui.add_markdown("")
        self._chart = Chart(gui, 0.4, sync="kalscope-time")
        self._table = gui.add_markdown("")

    def _use(self, _client: viser.ClientHandle) -> None:
        """The drawn filter becomes that of the channel; the page opens the Export tab."""
        if self._chain is not None:
            self._session.request(changes.use_chain(self._chain))

    def _show_settings(self, client: viser.ClientHandle) -> None:
        show_files(client, self._texts, "Settings of other programs")

    def on_emptied(self) -> None:
        """The filter that could be exported belongs to an earlier state."""
        self._chain, self._texts = None, dict[str, str]()
        put(self._export, visible=False)
        put(self._settings, visible=False)

    def show(self, compared: Compared | None) -> None:
        """Draw and write."""
        self._chain = None if compared is None else compared.to_export
        self._texts = {} if compared is None else compared.settings
        put(self._export, visible=self._chain is not None)
        put(self._settings, visible=bool(self._texts))
        for control in (self._match, self._alternative):
            put(control, visible=compared is not None)
        if compared is None:
            self._verdict.content, self._table.content = NOTHING, ""
            self._chart.hide()
            return
        state = compared.state
        names = [one.name for one in compared.found.others]
        drawn = state.view.drawn_alternative if state.view.drawn_alternative in names else ALL
        put(self._match, value=next(words for words, inner in MATCHES.items() if inner == state.view.match_by))
        offer(self._alternative, (*names, ALL), drawn)
        self._verdict.content = verdict_of(compared)
        self._table.content = text_of(compared)
        self._draw(compared)

    def _draw(self, compared: Compared) -> None:
        state, inside, palette = compared.state, compared.inside, palette_of(compared.state)
        axis, raw = time_axis(compared.drawn.time[inside], state), compared.drawn.raw[inside]
        scale = charts.scale_for(raw, state.tuning.unit)
        lines = [*charts.gappy("raw", raw, palette.raw)]
        if compared.drawn.truth is not None:
            lines.append(charts.line(compared.drawn.truth[inside], "truth", palette.truth, 1.5, dash=(6, 4)))
        present = compared.curve(compared.found.present)
        lines.append(charts.line(present, "yours", palette.filtered, 2.5, scaled=False))
        colours = dict(zip(NAMES, palette.alternatives, strict=True))
        for one in compared.alternatives:
            colour = colours.get(one.name, palette.truth)
            lines.append(charts.line(compared.curve(one), one.name, colour, 1.5, scaled=False))
        label, view = scale.label(short(state.channel, 14)), state.view.resets
        self._chart.draw(axis.x, lines, axis.label, label, factor=scale.factor, view=view)


def verdict_of(compared: Compared) -> str:
    """The verdict, and what it is about where another filter runs; markdown."""
    first, dot, rest = compared.found.verdict.partition(". ")
    chain = compared.state.tuning.chain
    verdict = f"**{first}{dot.strip()}** {rest}"
    if chain is None:
        return verdict
    runs = f"{capitalised(chain.words)} runs now. The comparison is with the Kalman filter of q and r."
    return f"{runs} It is called yours here.\n\n{verdict}"


def text_of(compared: Compared) -> str:
    """The table and the text below it; markdown."""
    found = compared.found
    if not found.others:
        return found.note
    table = table_of([cells(one, compared) for one in (found.present, *found.others)])
    lines = "\n".join(f"- **{one.name}.** {one.sentence}" for one in (*compared.alternatives, found.present))
    text = (
        f"{table}\n\n{found.identity}\n\n{lines}\n\n{found.note} "
        "The intervals in brackets hold jointly in 95 % of cases. Cut-offs are in cycles per sample."
    )
    return text if compared.state.tuning.chain is None else text.replace(" (present)", "")


def cells(one: Alternative, compared: Compared) -> dict[str, str]:
    """One row of the table."""
    state, present, error = compared.state, compared.found.present, one.prediction if one.rmse is None else one.rmse
    drawn = one.name == state.view.drawn_alternative or one is present
    unit = escape_markdown(state.tuning.unit, 12) or "unit"
    return {
        "filter": f"**{one.name}**" if drawn else one.name,
        "setting": one.parameters,
        "lag": lag_text(one.lag_samples, state.recording.sample_period) if one.causal else "looks ahead",
        "noise left": "" if np.isnan(one.noise_reduction_db) else noise_left(one.noise_reduction_db),
        "overshoot": _overshoot(one.overshoot) if state.tuning.momentum else "",
        f"{'error' if present.rmse is None else 'RMSE'}, {unit}": "" if error is None else number(error, 4),
        "compared with yours": against(one.against)
        if one.matched or one is present
        else "not at this " + state.view.match_by,
    }


def _overshoot(share: float) -> str:
    """The overshoot of the step response; the smoother's is not known."""
    return "" if np.isnan(share) else "none" if share < MIN_OVERSHOOT else percent(share)


def against(d: Difference | None) -> str:
    """A difference in words: "4.2 % worse (3.3 to 5.3)"."""
    if d is None or np.isnan(d.ratio):
        return ""
    if np.isinf(d.high):
        return "too short to tell"
    if not d.real:
        return "no significant difference"
    word = "better" if d.ratio < 1.0 else "worse"
    near, far = sorted(100.0 * abs(end - 1.0) for end in (d.low, d.high))
    return f"{percent(abs(d.ratio - 1.0))} {word} ({number(near, 2)} to {number(far, 2)})"


# The Channels tab: every channel on its own lane, their settings side by side, and copying between them.


ONE = "This recording has one channel. A recording with several shows them here side by side."

LANE_HEIGHT = 46
"""Least height of a lane, px, so that eight need no scrolling at 720 px."""

MIN_HEIGHT = 390
"""Height of the chart at least, px."""


class ChannelsView:
    """Chart, table, and how the channels are linked."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._said = gui.add_markdown(ONE)
        self._chart = Chart(gui, 0.0, sync="kalscope-time")
        self._chart.handle.legend = {"show": False}
        self._chart.handle.height = MIN_HEIGHT
        self._table = gui.add_markdown("")
        with gui.add_folder("Set several channels", visible=False) as self._folder:
            hint = "All together: each change under Tune sets every channel. Undo reverts it."
            together = gui.add_dropdown("apply to", LINKS, hint=hint)
        self._together = bind(together, session, changes.set_link)

    def show(self, frame: Frame) -> None:
        """Offer the other channels."""
        names = frame.state.recording.names
        self._folder.visible = self._chart.handle.visible = len(names) > 1
        self._together.value = frame.state.link

    def show_overview(self, overview: Overview) -> None:
        """Draw the lanes and write the table."""
        self._said.content = lead_of(overview)
        self._table.content = settings_of(overview)
        if overview.lanes:
            height = max(60 + LANE_HEIGHT * len(overview.lanes), MIN_HEIGHT)
            self._chart.handle.height = height
            view, ends = overview.state.view.resets, (0.5, len(overview.lanes) + 0.5)
            axis = time_axis(overview.time, overview.state)
            self._chart.draw(axis.x, lanes_of(overview), axis.label, "channel", view=view, y_range=ends, lanes=True)


def lanes_of(overview: Overview) -> list[ChartLine]:
    """The chart: lane 1 on top; raw and filtered in the colours of the Signal tab, the channel on screen bolder."""
    state, palette, lines = overview.state, palette_of(overview.state), list[ChartLine]()
    for i, lane in enumerate(overview.lanes, 1):
        width = 3 if state.measured == (lane.name,) else 2
        lines += charts.gappy(f"{i} raw", i - HALF_LANE * lane.raw, palette.raw)[:1]
        lines.append(charts.line(i - HALF_LANE * lane.filtered, f"{i}", palette.filtered, width))
    return lines


def lead_of(overview: Overview) -> str:
    """What is seen here; one line of markdown."""
    if not overview.lanes:
        return ONE
    names = overview.state.recording.names
    current = "" if overview.state.fusion is not None else ", the current channel bolder"
    said = f"Each channel fills its own lane: **raw** grey, **filtered** orange{current}."
    drawn = len(overview.lanes)
    return f"{said} The first {drawn} of {count(len(names))} are drawn." if drawn < len(names) else said


def settings_of(overview: Overview) -> str:
    """The channels with their settings; markdown, names escaped."""
    rows = [_row(overview.state, i, lane) for i, lane in enumerate(overview.lanes)]
    return table_of(rows) if rows else ""


def _row(state: State, i: int, lane: Lane) -> dict[str, str]:
    """The cells of a channel, by the heads of the table."""
    tuning, period = state.tunings[i], state.recording.sample_period
    bold, unit = "**" if state.measured == (lane.name,) else "", escape_markdown(tuning.unit, 12)
    row = {"": f"{bold}{i + 1}{bold}", "channel": f"{bold}{escape_markdown(lane.name, 24)}{bold}"}
    row |= dict.fromkeys(("q", "r", "τ", "lag", "noise left"), "")
    if tuning.filter.is_standard:
        steady = steady_state(tuning.params)
        row |= {"q": number(tuning.q), "r": number(tuning.r)}
        row["τ"] = changes.momentum_words(tuning.momentum, period) if tuning.momentum else ""
        row["lag"] = lag_text(steady.lag_samples, period)
        row["noise left"] = noise_left(steady.noise_reduction_db)
    row["from … to"] = f"{number(lane.low)} … {number(lane.high)} {unit}".strip() if np.isfinite(lane.low) else ""
    row["missing"] = count(lane.missing) if lane.missing else ""
    return row


# The Noise tab: densities with the filter's response, and the Allan deviation beside the model's.


SPECTRA_NOTHING = "Only the Kalman filter of one channel has a frequency response here."

NO_ALLAN = "Only the Kalman filter of one channel has an Allan deviation here."

DECADES = 9
"""Decades of a logarithmic chart at most, counted from the top: what is lower is rounding error."""


class SpectrumView:
    """Two charts that share the frequency axis."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._text = gui.add_markdown("")
        self._density = Chart(gui, 0.37, sync="kalscope-frequency")
        self._response = Chart(gui, 0.22, sync="kalscope-frequency")
        self._note = gui.add_markdown("")

    def show(self, spectra: Spectra | None) -> None:
        """Draw and write."""
        if spectra is None or not spectra.found.samples:
            self._text.content = SPECTRA_NOTHING if spectra is None else spectra.found.note
            self._note.content = ""
            self._density.hide()
            self._response.hide()
            return
        found, state, palette = spectra.found, spectra.state, palette_of(spectra.state)
        unit, per = ("Hz", "/Hz") if found.in_hertz else ("cycles/sample", " per cycle/sample")
        self._text.content, self._note.content = f"**{cutoff_words(found)}**", found.note
        label, fine, view = f"frequency ({unit})", spectra.fine, state.view.resets

        names = (("raw", palette.raw), ("filtered", palette.filtered), ("removed", palette.innovation))
        low, high, ys = floored(spectra.densities)
        lines = [charts.line(y, name, colour, 2) for y, (name, colour) in zip(ys, names, strict=True)]
        density = f"density ({squared(state.tuning.unit)}{per})"
        reach = float(fine[0]), float(fine[-1])  # as the response, which a low cut-off makes longer
        x, ends = spectra.frequency, (low, high)
        self._density.draw(x, lines, label, density, view=view, reach=reach, y_range=ends, log="xy")

        cut = np.where(fine == found.cutoff, spectra.response_db, np.nan)
        response = charts.line(spectra.response_db, "response (dB)", palette.filtered, 2)
        lowest, highest = float(spectra.response_db.min()), float(spectra.response_db.max())
        ends = min(-6.0, 5.0 * math.floor(lowest / 5.0)), max(2.0, math.ceil(highest + 0.5))
        lines = [response, charts.dots(cut, "−3 dB", palette.truth, 11)]
        self._response.draw(fine, lines, label, "response (dB)", view=view, y_range=ends, log="x")


class AllanView:
    """One chart: the recording's Allan deviation with its spread, the model's, and the model's minimum."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._text = gui.add_markdown("")
        self._chart = Chart(gui, 0.35)
        self._note = gui.add_markdown("")

    def show(self, answer: tuple[State, AllanDeviation | None]) -> None:
        """Draw and write."""
        state, found = answer
        if found is None or len(found.size) < 2:
            self._text.content = NO_ALLAN if found is None else found.message
            self._note.content = ""
            self._chart.hide()
            return
        palette = palette_of(state)
        self._text.content, self._note.content = f"**{found.message}**", ABOUT_ALLAN
        clock = Scale(1.0, "s" if found.in_seconds else "samples")
        low, high, (deviation, model) = floored((found.deviation, found.model))
        inside = found.size[0] <= found.best_size <= found.size[-1]  # beyond, the model is still falling
        best = np.argmin(found.model) if inside else -1
        lowest = np.where(np.arange(len(found.size)) == best, found.model, np.nan)
        below, above = (np.clip(found.deviation + sign * 2.0 * found.spread, low, high) for sign in (-1.0, 1.0))
        lines = [
            charts.line(below, "−2 σ"),
            charts.line(above, "+2 σ", fill=palette.truth + palette.band),
            charts.line(deviation, "recording", palette.truth, 2, points=charts.marks(palette.truth, 6)),
            charts.line(model, "model", palette.filtered, 2),
            charts.dots(lowest, "minimum of the model", palette.filtered, 13),
        ]
        label = Scale(1.0, state.tuning.unit[:16]).label("Allan deviation")
        ends, view = (low, high), state.view.resets
        x_label = clock.label("averaging time")
        self._chart.draw(found.tau, lines, x_label, label, view=view, y_range=ends, log="xy")


ABOUT_ALLAN = (
    "Allan deviation: how much neighbouring averages differ. It falls while averaging reduces the noise "
    "(√r at one sample) and rises once the signal moves. Where the model deviates from the recording, "
    "q or r does not fit."
)


def cutoff_words(found: Spectrum) -> str:
    """The cut-off frequency in a sentence."""
    if math.isnan(found.cutoff):
        return "This filter has no cut-off: it passes more than half of the power at every frequency."
    at = frequency(found.cutoff) if found.in_hertz else f"{number(found.cutoff)} cycles/sample"
    return f"Cut-off (−3 dB): {at}. Lower frequencies pass, higher ones are attenuated."


def floored(ys: tuple[Array, ...]) -> tuple[float, float, list[Array]]:
    """Ends of a logarithmic axis, and the lines lifted to its lower end; at most DECADES between the two."""
    everything = np.concatenate(ys)
    good = everything[np.isfinite(everything) & (everything > 0.0)]
    high = 1.5 * float(good.max()) if len(good) else 1.0
    low = max(float(good.min()) / 1.5, high * 10.0**-DECADES) if len(good) else 0.1
    return low, high, [np.clip(np.nan_to_num(y, nan=low), low, high) for y in ys]
