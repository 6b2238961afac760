"""The Noise tab: densities with the filter's response, and the Allan deviation beside the model's."""

from __future__ import annotations

import math

import numpy as np
import viser

from kalscope.common.array import Array
from kalscope.common.text import frequency, number, squared
from kalscope_app.studies.spectra import Allan, Spectra
from kalscope_app.views.charts.chart import Chart, ChartLayout
from kalscope_app.views.charts.style import DARK, LIGHT, Palette, axes, dots, line
from kalscope_app.views.scales import Scale, log_scale_for, log_ticks, log_time_scale

NOTHING = "Only the Kalman filter of one channel has a frequency response here."

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
            self._text.content = NOTHING if spectra is None else spectra.found.note
            self._note.content = ""
            self._density.hide()
            self._response.hide()
            return
        palette = DARK if spectra.state.view.dark else LIGHT
        hertz = log_scale_for(spectra.frequency, "Hz" if spectra.found.in_hertz else "cycles/sample")
        self._text.content = f"**{cutoff_words(spectra, hertz)}**"
        self._note.content = spectra.found.note
        self._draw_density(spectra, palette, hertz)
        self._draw_response(spectra, palette, hertz)

    def _draw_density(self, spectra: Spectra, palette: Palette, hertz: Scale) -> None:
        unit = squared(spectra.state.tuning.unit)
        unit = f"{unit}/Hz" if spectra.found.in_hertz else f"{unit} per cycle/sample"
        low, high, ys = floored(spectra.densities)
        scale = log_scale_for(np.array([low, high]), unit)
        colours = (("raw", palette.raw), ("filtered", palette.filtered), ("removed", palette.innovation))
        x, across = (values * hertz.factor for values in (spectra.frequency, spectra.fine))
        reach = (low * scale.factor, high * scale.factor)
        layout = ChartLayout(
            ({"label": f"frequency ({hertz.unit})"}, *(line(name, colour, 2) for name, colour in colours)),
            log_axes(across, reach, scale.label("density")),
            y_range=reach,
            log_x=True,
            log_y=True,
        )
        ends = (float(across[0]), float(across[-1]))  # as the response, which a low cut-off makes longer
        self._density.show(x, [y * scale.factor for y in ys], layout, spectra.state.view.resets, ends)

    def _draw_response(self, spectra: Spectra, palette: Palette, hertz: Scale) -> None:
        x = spectra.fine * hertz.factor
        cut = np.where(spectra.fine == spectra.found.cutoff, spectra.response_db, np.nan)
        lowest, highest = float(spectra.response_db.min()), float(spectra.response_db.max())
        layout = ChartLayout(
            (
                {"label": f"frequency ({hertz.unit})"},
                line("response (dB)", palette.filtered, 2),
                dots("−3 dB", palette.truth, 11),
            ),
            log_axes(x, None, "response (dB)"),
            gaps=frozenset({1}),
            y_range=(min(-6.0, 5.0 * math.floor(lowest / 5.0)), max(2.0, math.ceil(highest + 0.5))),
            log_x=True,
        )
        self._response.show(x, [spectra.response_db, cut], layout, spectra.state.view.resets)


class AllanView:
    """One chart: the recording's Allan deviation with its spread, the model's, and the model's minimum."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._text = gui.add_markdown("")
        self._chart = Chart(gui, 0.35)
        self._note = gui.add_markdown("")

    def show(self, allan: Allan | None) -> None:
        """Draw and write."""
        if allan is None or len(allan.found.size) < 2:
            self._text.content = NO_ALLAN if allan is None else allan.found.message
            self._note.content = ""
            self._chart.hide()
            return
        found, palette = allan.found, DARK if allan.state.view.dark else LIGHT
        self._text.content = f"**{found.message}**"
        self._note.content = (
            "Allan deviation: how much neighbouring averages differ. It falls while averaging reduces the noise "
            "(√r at one sample) and rises once the signal moves. Where the model deviates from the recording, "
            "q or r does not fit."
        )
        clock = log_time_scale(found.tau) if found.in_seconds else log_scale_for(found.tau, "samples")
        low, high, ys = floored((found.deviation, found.model))
        scale = log_scale_for(np.array([low, high]), allan.state.tuning.unit[:16])
        inside = found.size[0] <= found.best_size <= found.size[-1]  # beyond, the model is still falling
        best = np.argmin(found.model) if inside else -1
        mark = np.where(np.arange(len(found.size)) == best, found.model, np.nan)
        edges = [np.clip(found.deviation + sign * 2.0 * found.spread, low, high) for sign in (-1.0, 1.0)]
        x = found.tau * clock.factor
        reach = (low * scale.factor, high * scale.factor)
        marks = {"show": True, "size": 6, "space": 0, "fill": palette.truth}
        layout = ChartLayout(
            (
                {"label": f"averaging time ({clock.unit})"},
                line("−2 σ"),
                line("+2 σ"),
                {**line("recording", palette.truth, 2), "points": marks},
                line("model", palette.filtered, 2),
                dots("minimum of the model", palette.filtered, 13),
            ),
            log_axes(x, reach, scale.label("Allan deviation")),
            ({"series": (2, 1), "fill": "rgba(86, 180, 233, 0.22)"},),
            frozenset({4}),
            reach,
            log_x=True,
            log_y=True,
        )
        drawn = [*edges, *ys, mark]
        self._chart.show(x, [y * scale.factor for y in drawn], layout, allan.state.view.resets)


def cutoff_words(spectra: Spectra, axis: Scale) -> str:
    """The cut-off frequency in a sentence, in the unit of the axis too where that is another."""
    found = spectra.found
    if math.isnan(found.cutoff):
        return "This filter has no cut-off: it passes more than half of the power at every frequency."
    on_axis = f"{number(found.cutoff * axis.factor)} {axis.unit}"
    at = frequency(found.cutoff) if found.in_hertz else on_axis
    also = "" if at.endswith(f" {axis.unit}") else f", {on_axis} on the axis"
    return f"Cut-off (−3 dB): {at}{also}. Lower frequencies pass, higher ones are attenuated."


def floored(ys: tuple[Array, ...]) -> tuple[float, float, list[Array]]:
    """Ends of a logarithmic axis, and the lines lifted to its lower end; at most DECADES between the two."""
    everything = np.concatenate(ys)
    good = everything[np.isfinite(everything) & (everything > 0.0)]
    high = 1.5 * float(good.max()) if len(good) else 1.0
    low = max(float(good.min()) / 1.5, high * 10.0**-DECADES) if len(good) else 0.1
    return low, high, [np.clip(np.nan_to_num(y, nan=low), low, high) for y in ys]


def log_axes(x: Array, y: tuple[float, float] | None, label: str) -> tuple[dict[str, object], ...]:
    """Axes with round numbers written out; uPlot itself writes 0 for any value below 0.0005."""
    across, up = axes(label)
    across = {**across, **written(log_ticks(float(x[0]), float(x[-1])))}
    return across, up if y is None else {**up, **written(log_ticks(*y))}


def written(ticks: tuple[float, ...]) -> dict[str, object]:
    """Fixed ticks and their labels."""
    return {"splits": ticks, "values": tuple(number(tick, 1) for tick in ticks)}
