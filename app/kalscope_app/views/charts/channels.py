"""The Channels tab: every channel on its own lane, their settings side by side, and copying between them."""

from __future__ import annotations

import numpy as np
import viser

from kalscope.common.array import Array
from kalscope.common.text import count, decibels, lag_text, number
from kalscope.filtering.steady_state import steady_state
from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.channels import ALL_OTHERS, copy_setting, set_link
from kalscope_app.session.changes.momentum import momentum_words
from kalscope_app.session.linked_channels import LINKS
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.studies.channels_overview import HALF_LANE, MAX_LANES, Lane, Overview
from kalscope_app.views.binding import bind, offer, on_user
from kalscope_app.views.charts.chart import Chart, ChartLayout
from kalscope_app.views.charts.style import DARK, LIGHT, Palette, axes, line
from kalscope_app.views.charts.time_axis import time_label
from kalscope_app.views.markdown import escape_markdown
from kalscope_app.views.scales import time_scale_for

ONE = "This recording has one channel. A recording with several shows them here side by side."

LANE_HEIGHT = 46
"""Least height of a lane, px, so that eight need no scrolling at 720 px."""

MIN_HEIGHT = 390
"""Height of the chart at least, px."""


class ChannelsView:
    """Chart, table and copy button."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._said = gui.add_markdown(ONE)
        self._chart = Chart(gui, 0.0, sync="kalscope-time")
        self._chart.handle.legend = {"show": False}
        self._chart.handle.height = MIN_HEIGHT
        self._table = gui.add_markdown("")
        with gui.add_folder("Set several channels", visible=False) as self._folder:
            self._together = gui.add_dropdown(
                "apply to",
                LINKS,
                hint="All together: each change under Tune sets every channel. Undo reverts it.",
            )
            self._to = gui.add_dropdown(
                "copy to",
                list[str]([ALL_OTHERS]),
                hint="The channels that get q, r, momentum, initial state and gate.",
            )
            self._copy = gui.add_button("Copy", hint="Copies the numbers once; Undo reverts it.")
        bind(self._together, session, set_link)
        on_user(self._copy.on_click, lambda _client: session.request(copy_setting(self._to.value)))

    def show(self, frame: Frame) -> None:
        """Offer the other channels."""
        names = frame.state.recording.names
        self._folder.visible = self._chart.handle.visible = len(names) > 1
        self._together.value = frame.state.settings.link
        others = (ALL_OTHERS, *(name for name in names if name != frame.state.channel))
        offer(self._to, others, self._to.value if self._to.value in others else ALL_OTHERS)

    def show_overview(self, overview: Overview) -> None:
        """Draw the lanes and write the table."""
        self._said.content = lead_of(overview)
        self._table.content = table_of(overview)
        if overview.lanes:
            height = max(60 + LANE_HEIGHT * len(overview.lanes), MIN_HEIGHT)
            self._chart.handle.height = height
            self._chart.show(*lanes_of(overview), overview.state.view.resets)


def lanes_of(overview: Overview) -> tuple[Array, list[Array], ChartLayout]:
    """The chart: lane 1 on top; raw pale, filtered bold, the channel on screen in its own colour."""
    state = overview.state
    palette = DARK if state.view.dark else LIGHT
    span = float(overview.time[-1] - overview.time[0]) if len(overview.time) > 1 else 1.0
    clock = time_scale_for(span, state.recording.sample_period)
    ys: list[Array] = []
    series: list[dict[str, object]] = [{"label": time_label(clock)}]
    for i, lane in enumerate(overview.lanes, 1):
        ys += [i - HALF_LANE * lane.raw, i - HALF_LANE * lane.filtered]
        series += [line(f"{i} raw", palette.raw), line(f"{i}", colour_of(lane, state, palette), 2)]
    across, up = axes("channel")
    layout = ChartLayout(
        tuple(series),
        ({**across, "label": time_label(clock), "size": 34}, {**up, "incrs": (1,), "space": 8}),
        y_range=(0.5, len(overview.lanes) + 0.5),
        y_down=True,
    )
    return overview.time * clock.factor, ys, layout


def colour_of(lane: Lane, state: State, palette: Palette) -> str:
    """The channel on screen as in the Signal tab, the others blue."""
    return palette.filtered if state.measured == (lane.name,) else palette.truth


def lead_of(overview: Overview) -> str:
    """What is seen here; one line of markdown."""
    if not overview.lanes:
        return ONE
    names = overview.state.recording.names
    current = "" if overview.state.fusion is not None else ", the current channel in orange"
    said = f"Each channel fills its own lane: **raw** thin, **filtered** bold{current}."
    more = len(names) - len(overview.lanes)
    return f"{said} {count(more)} more than {MAX_LANES} are not drawn." if more else said


def table_of(overview: Overview) -> str:
    """The channels with their settings; markdown, names escaped."""
    if not overview.lanes:
        return ""
    state, period = overview.state, overview.state.recording.sample_period
    with_momentum = any(tuning.momentum for tuning in state.settings.tunings)
    with_missing = any(lane.missing for lane in overview.lanes)
    head = [
        "",
        "channel",
        "q",
        "r",
        *(["τ"] if with_momentum else []),
        "lag",
        "noise",
        "from … to",
        *(["missing"] if with_missing else []),
    ]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for i, lane in enumerate(overview.lanes):
        tuning, unit = state.settings.tunings[i], escape_markdown(state.settings.tunings[i].unit, 12)
        bold = "**" if state.measured == (lane.name,) else ""
        cells = [f"{bold}{i + 1}{bold}", f"{bold}{escape_markdown(lane.name, 24)}{bold}"]
        if not tuning.filter.is_standard:
            cells += ["–"] * (5 if with_momentum else 4)
        else:
            steady = steady_state(tuning.params)
            cells += [number(tuning.q), number(tuning.r)]
            times = [momentum_words(tuning.momentum, period)] if with_momentum else []
            times += [lag_text(steady.lag_samples, period), decibels(-steady.noise_reduction_db)]
            cells += [text.replace(" ", "\u00a0") for text in times]
        reach = f"{number(lane.low)} … {number(lane.high)} {unit}".strip() if np.isfinite(lane.low) else "–"
        cells += [reach, *([count(lane.missing) if lane.missing else "–"] if with_missing else [])]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
