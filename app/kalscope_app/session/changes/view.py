"""Changes of the view: the window, the theme, the map, what is drawn beside the signal."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

from kalscope.errors import BadSetting
from kalscope_app.session.state import Change, State
from kalscope_app.session.view import MAP_COLOURS


def set_window(first: float, last: float) -> Change:
    """Show the recording from `first` to `last`, s; at least ten samples; the whole of it is None."""

    def change(state: State) -> State:
        t = state.recording.time
        begin, end = float(t.min()), float(t.max())
        if not (math.isfinite(first) and math.isfinite(last)):
            return state
        low, high = sorted((min(max(first, begin), end), min(max(last, begin), end)))
        shortest = 10.0 * (state.recording.sample_period or 1.0)
        if high - low < shortest:
            low, high = max(begin, min(low, end - shortest)), min(end, max(high, low + shortest))
        window = None if low <= begin and high >= end else (low, high)
        live = replace(state.live, following=False) if state.live else None  # the user looks back
        same = window == state.view.window and live == state.live
        return state if same else replace(state.with_view(window=window), live=live)

    return change


def reset_view(state: State) -> State:
    """Show the whole recording and forget the zoom."""
    return state.with_reset_view(window=None)


def set_search_method(method: str, methods: Collection[str]) -> Change:
    """Search q and r by another method, one of `methods`."""

    def change(state: State) -> State:
        if method not in methods:
            raise BadSetting(
                f"the way to find q and r must be one of {', '.join(methods)} (got {str(method)[:40]!r})"
            )
        return state.with_view(search_method=method)

    return change


def set_smoother(shown: bool) -> Change:
    """Draw the best possible offline curve, or not."""
    return lambda state: state.with_view(smoother=bool(shown))


def set_velocity(shown: bool) -> Change:
    """Draw the velocity in place of the gain, where the filter has momentum, or not."""
    return lambda state: state.with_view(velocity=bool(shown))


def set_gain_shown(shown: bool) -> Change:
    """Draw the gain chart, or not."""
    return lambda state: state.with_view(gain_shown=bool(shown))


def set_why_shown(shown: bool) -> Change:
    """Show the reasons for the verdict, or not."""
    return lambda state: state.with_view(why_shown=bool(shown))


def set_match_by(match_by: str) -> Change:
    """Compare simpler filters at equal "lag" or equal "noise" reduction."""
    return lambda state: state.with_view(match_by="noise" if match_by == "noise" else "lag")


def set_drawn_alternative(name: str) -> Change:
    """Draw one simpler filter beside the present one, by its name; any other word draws all."""
    return lambda state: state.with_view(drawn_alternative=str(name)[:60])


def set_dark(dark: bool) -> Change:
    """Dark or light theme."""
    return lambda state: state.with_view(dark=bool(dark))


def set_map_shown(shown: bool) -> Change:
    """Show the tuning map, or leave its space to the charts."""
    return lambda state: state.with_view(map_shown=bool(shown))


def set_map_colour(colour: str) -> Change:
    """Colour the tuning map by another measure; the error needs a known truth."""

    def change(state: State) -> State:
        if colour not in MAP_COLOURS:
            raise BadSetting(f"the map's colour must be one of {', '.join(MAP_COLOURS)} (got {str(colour)[:40]!r})")
        if colour == "RMSE" and state.recording.truth is None:
            raise BadSetting("the map's colour must be likelihood or lag where the truth is not known (got RMSE)")
        return state.with_view(map_colour=colour)

    return change
