"""The ways to find q and r that the dashboard offers: what each asks the user for, and the search it requests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from kalscope.common.text import TIME_UNITS, number, trimmed, typed_number
from kalscope.errors import BadSetting
from kalscope.estimation.finding import METHOD_NAMES, Noise, Request
from kalscope_app.session.state import State
from kalscope_app.views.scales import Scale, time_scale_for

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
        asked = Request(target={name: factor * typed_number(label, texts[0])}, noise=_known_noise(state))
        if allowed:
            return replace(asked, overshoot=typed_number("overshoot", allowed) / 100.0)
        return replace(asked, momentum=state.tuning.momentum or "auto")

    return SearchMethod(request, ((label, content), *(((OVERSHOOT, ""),) if with_overshoot else ())))


def _known_noise(state: State) -> Noise:
    """The noise that the last search was given, while its result holds: a new goal does not change the sensor."""
    found = state.answers.outcome
    return Noise() if found is None or found.request is None else found.request.noise


def _lag(period: float | None) -> SearchMethod:
    """The goal of a lag: in samples where the sample period (s) is unknown, else in a unit that suits it."""
    if period is None:
        return _target("lag_samples", "lag (samples)", "10", with_overshoot=True)
    usual = 5.0 * period
    unit, length = TIME_UNITS[0] if usual < 1.0 else next(one for one in reversed(TIME_UNITS) if one[1] <= usual)
    content = "50" if period <= 0.025 else trimmed(usual / length, 1)
    return _target("lag_s", f"lag ({unit})", content, length, with_overshoot=True)


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
    slack = 1e-9 * max(abs(low), abs(high))  # 0.1 h is 360 s only up to rounding
    at = ((time >= low - slack) & (time <= high + slack)).nonzero()[0]
    if len(at) == 0:
        raise BadSetting(
            "the still stretch must lie inside the recording "
            f"(got {number(low * factor, 4)} to {number(high * factor, 4)})"
        )
    return Request(noise=Noise(still=(int(at[0]), int(at[-1]) + 1)))


def stretch_texts(state: State, first: int, last: int) -> tuple[str, str]:
    """Samples `first` … `last` − 1 as from and to in the unit of the time axis, in as few digits as suffice."""
    time, factor = state.recording.time, clock_of(state).factor
    ends = [float(time[at]) * factor for at in (first, last - 1)]
    for digits in range(3, 17):
        texts = tuple(f"{end:.{digits}g}" for end in ends)
        if _still(state, list(texts)).noise.still == (first, last):
            return texts[0], texts[1]
    return repr(ends[0]), repr(ends[1])


def clock_of(state: State) -> Scale:
    """Unit of the time axis on screen."""
    time = state.recording.time
    first, last = state.view.window or (float(time.min()), float(time.max()))
    return time_scale_for(last - first, state.recording.sample_period)


STILL = "a still stretch, fit q"

LAG_HINT = "The largest lag that you accept: the setting within it that leaves the least noise is used."

BOX_HINTS = {
    "": "A number that this method needs.",
    "cut-off (Hz)": "Higher frequencies are attenuated, lower ones pass.",
    "reduction (dB)": "How much less noise: 20 dB is a tenth of its size, 6 dB half of it.",
    OVERSHOOT: "How far a step may overshoot: more of it gives less noise or lag. Empty: the present momentum.",
    "gain K": "The weight of each new sample in the estimate, between 0 and 1.",
    "from": "Where the stretch begins, as on the time axis. Empty: where the part on screen begins.",
    "to": "Where the stretch ends, as on the time axis. Empty: where the part on screen ends.",
    "σ (std)": "The noise of one reading, one standard deviation, in the unit of the signal.",
    "per √Hz": "The noise density, in the unit of the signal per √Hz.",
    "bandwidth (Hz)": "The bandwidth that goes with the density.",
}
"""Hint of each box by its label."""


def hint_of(label: str) -> str:
    """The hint of a box."""
    return LAG_HINT if label.startswith("lag (") else BOX_HINTS[label]


LAG, MORE = "maximum lag", "more …"

SEARCH_METHODS: dict[str, SearchMethod] = {
    LAG: _lag(0.01),
    "cut-off frequency": _target("cutoff_hz", "cut-off (Hz)", "1"),
    "noise reduction": _target("noise_reduction_db", "reduction (dB)", "12", with_overshoot=True),
    "best fit": _method("ml"),
    STILL: SearchMethod(_still, (("from", ""), ("to", ""))),
    "data sheet σ, fit q": _noise(("sigma", "σ (std)", "")),
    "data sheet density, fit q": _noise(("density", "per √Hz", ""), ("bandwidth_hz", "bandwidth (Hz)", "")),
    "lag with overshoot": _lag(0.01),
    "noise reduction with overshoot": _target("noise_reduction_db", "reduction (dB)", "12", with_overshoot=True),
    "lag in samples": _target("lag_samples", "lag (samples)", "10", with_overshoot=True),
    "gain K": _target("gain", "gain K", "0.1"),
    "keep r, fit q": SearchMethod(lambda state, _texts: Request(noise=Noise(r=state.tuning.r))),
    "r/q = 100, fit r": SearchMethod(lambda _state, _texts: Request(ratio=0.01)),
    **{METHOD_NAMES[name]: _method(name) for name in ("em", "moments", "als", "allan")},
}
"""Ways by the words on screen, the most useful first."""

GOALS = tuple(SEARCH_METHODS)[:4]
"""The ways that the first menu offers; the others are behind MORE."""

MORE_METHODS = tuple(SEARCH_METHODS)[4:]

HINT = "What the filter is for. Best fit: the q and r that explain the recording best."


def method_of(state: State) -> SearchMethod:
    """The chosen way with the boxes that this record needs: an overshoot is asked for where there is momentum."""
    name = state.view.search_method
    is_lag = name in (LAG, "lag with overshoot")
    method = _lag(state.recording.sample_period) if is_lag else SEARCH_METHODS[name]
    without = name in GOALS and state.tuning.momentum == 0.0
    return replace(method, boxes=method.boxes[:1]) if without else method
