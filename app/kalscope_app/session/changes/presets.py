"""Settings to begin with, each with a reason of one line: by lag, and those of two source documents. Pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

from kalscope.errors import BadSetting
from kalscope.estimation.known import params_for_specification
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.filtering.steady_state import ratio_for, steady_state
from kalscope.papers.interactive_matter_2009 import ASSUMED_R, WALK
from kalscope.papers.maarif_2019 import SIMULATED_FIGURES
from kalscope_app.session.state import Change, State


@dataclass(frozen=True)
class Preset:
    """One choice of q, r and momentum."""

    title: str
    """What it is called on screen."""
    why: str
    """One or two sentences on what it is for."""
    params: Callable[[State], FilterParams]
    """q, r and momentum for the channel on screen; its start and its gate stay as they are."""


LAGS = (
    ("smooth", 50.0, "For what moves slowly, such as a temperature: a tenth of the noise stays."),
    (
        "balanced",
        10.0,
        "For a first look at any sensor: about a fifth of the noise stays, and changes stay visible.",
    ),
    ("fast", 2.0, "For what a controller acts on: it hardly lags, and nearly half of the noise stays."),
)
"""Name, lag in samples and reason of the presets by lag."""

OVERSHOOT = 0.1
"""Share of a step by which the preset with momentum overshoots."""

FOLLOWS_RAMPS = (
    "For what keeps its direction, such as an arm that bends or a pulse: as smooth as *balanced*, with a lag of "
    "5.7 samples instead of 10. A step overshoots by a tenth."
)
"""Why there is a preset with momentum."""

PAPER_1 = {
    3: "More process noise than sensor noise: the output is almost the raw signal.",
    4: "Q as large as R: the noise falls to two thirds, with hardly any lag.",
    5: "R/Q = 10: visibly smoother, still fast.",
    6: "R/Q = 100, the ratio that the paper recommends: smooth, and about ten samples late.",
    7: "R/Q = 100 again: the curve of R = 1, Q = 0.01, because only the ratio shapes it; the band is wider.",
    8: "R/Q = 1000: very smooth; the paper finds that too much of the signal is lost.",
}
"""Why, by the figure of the first paper."""

PAPER_3 = {
    "q_128": "The document's first try: fast, but the noise passes.",
    "q_4": "Its second try: some of the noise is gone.",
    "q_0125": "Its third try: smooth, and still quick enough for a hand that tilts a board.",
    "r_1": "With the last q and a small r: quicker, but rougher.",
    "r_4": "With the last q and a noise of two counts: a compromise.",
    "r_32": "With the last q and a noise of nearly six counts: smoothest, but late.",
}
"""Why, by the picture of the third document."""


def _by_lag(lag_samples: float, state: State) -> FilterParams:
    """The signal's own noise as r, var(Δz)/2 of the recording, and the q that has the lag."""
    r = state.start.r
    return FilterParams(min(float(f"{r * ratio_for(lag_samples=lag_samples):.3e}"), MAX_VARIANCE), r)


@lru_cache(maxsize=1)
def _follows_ramps() -> FilterParams:
    """The filter for r = 1: the noise of the balanced preset, and the momentum that overshoots by OVERSHOOT."""
    balanced = steady_state(FilterParams(ratio_for(lag_samples=10.0), 1.0))
    decibel = float(balanced.noise_reduction_db)
    return params_for_specification(1.0, noise_reduction_db=decibel, overshoot=OVERSHOOT)


def _with_momentum(state: State) -> FilterParams:
    """The signal's own noise as r, as the presets by lag have it, and momentum."""
    unit, r = _follows_ramps(), state.start.r
    q, momentum = (float(f"{value:.3e}") for value in (float(unit.ratio) * r, float(unit.momentum)))
    return FilterParams(min(q, MAX_VARIANCE), r, momentum=momentum)


def _fixed(q: float, r: float, _state: State) -> FilterParams:
    return FilterParams(q, r)


def _all() -> tuple[Preset, ...]:
    by_lag = [Preset(f"{name}: lag {lag:g} samples", why, partial(_by_lag, lag)) for name, lag, why in LAGS]
    by_lag.append(Preset(f"follows ramps: overshoot {100.0 * OVERSHOOT:g} %", FOLLOWS_RAMPS, _with_momentum))
    first = [
        Preset(f"Ma'arif 2019: R = {r:g}, Q = {q:g}", f"Figure {figure}. {PAPER_1[figure]}", partial(_fixed, q, r))
        for figure, r, q in SIMULATED_FIGURES
    ]
    third = [
        Preset(f"interactive matter: {_of_picture(key, q, r)}", PAPER_3[key] + _assumed(key), partial(_fixed, q, r))
        for key, q, r in WALK
    ]
    return (*by_lag, *first, *third)


def _of_picture(key: str, q: float, r: float) -> str:
    return f"q = {q:g}" if key.startswith("q_") else f"r = {r:g}"


def _assumed(key: str) -> str:
    return f" It does not give r; {ASSUMED_R:g} is assumed." if key.startswith("q_") else " q = 0.125."


PRESETS = {preset.title: preset for preset in _all()}
"""Presets by title, in the order of the menu."""


def choose_preset(title: str) -> Change:
    """Show what a preset would do."""
    preset = _known(title)
    return lambda state: state.with_view(preset=preset.title)


def take_preset(title: str) -> Change:
    """Q, r and momentum of a preset become the present ones; the start and the gate stay."""
    preset = _known(title)

    def change(state: State) -> State:
        params = preset.params(state)
        values = {name: getattr(params, name) for name in ("q", "r", "momentum")}
        tuned = state.with_standard_filter().with_tuning(**values, how=f"preset {preset.title}")
        return tuned.with_view(preset=preset.title)

    return change


def _known(title: str) -> Preset:
    if title not in PRESETS:
        raise BadSetting(f"preset must be one of {', '.join(PRESETS)} (got {title[:40]!r})")
    return PRESETS[title]
