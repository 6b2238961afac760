"""The time axis that the charts share: its unit, its name, and a window that follows a live board."""

from __future__ import annotations

import math

from kalscope.common.array import Array
from kalscope_app.engine.frame import Frame
from kalscope_app.views.scales import Scale, time_scale_for


def time_axis(frame: Frame) -> Scale:
    """Unit of the shared time axis, by the length of what is shown."""
    time, reach = time_points(frame)
    first, last = reach or (float(time[0]), float(time[-1]))
    span = last - first if len(time) > 1 else 1.0
    return time_scale_for(span, frame.state.recording.sample_period)


def follows(frame: Frame) -> bool:
    """Whether the window follows a live board's newest sample."""
    live = frame.state.live
    return live is not None and live.following and live.snapshot is not None


def time_points(frame: Frame) -> tuple[Array, tuple[float, float] | None]:
    """Times of the samples on the time axis, s, and the range of the axis if that is not theirs.

    A window that follows counts back from the newest sample, so that neither its axis nor a zoom moves.
    """
    time, live = frame.drawn.time, frame.state.live
    if live is None or not follows(frame):
        return time, None
    newest = float(frame.state.recording.time[-1])
    span = live.span if math.isfinite(live.span) else rounded_up(float(time[-1] - time[0]))
    return time - newest, (-span, 0.0)


def rounded_up(value: float) -> float:
    """The next of 1, 2, 5 × 10^k, so that a growing axis changes only now and then."""
    decade = 10.0 ** math.floor(math.log10(max(value, 1e-3)))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= value)


def time_label(clock: Scale, *, before_now: bool = False) -> str:
    """Name of the time axis, with its unit."""
    if clock.unit == "samples":
        return "sample"
    return f"time before now ({clock.unit})" if before_now else f"time ({clock.unit})"
