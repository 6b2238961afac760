"""Changes of the State that the user asks for: pure functions."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from kalscope.analysis import actions
from kalscope.analysis.channel_kinds import default_channel
from kalscope.common.text import TIME_UNITS, command_line, lag_text, one_line, typed_gate, typed_number
from kalscope.errors import BadFile, BadSetting
from kalscope.estimation.result import Estimate
from kalscope.filtering.classic import Chain
from kalscope.filtering.params import MAX_FAST, MAX_MOMENTUM
from kalscope.filtering.steady import steady_state
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import option, option_words
from kalscope.sources.live.samples import Snapshot
from kalscope.sources.live.source import LiveSource
from kalscope.tuning.choose import name_of_fused
from kalscope.tuning.file import loads
from kalscope.tuning.toml_text import text_of
from kalscope.tuning.tuning import ChannelTuning, Tuning, chain_text, typed_chain
from kalscope_app.session import opening
from kalscope_app.session.state import (
    LINKS,
    MAX_SENSORS,
    MAX_VARIANTS,
    MIN_SENSORS,
    ORDERS,
    BoardCalibration,
    Change,
    Fusion,
    Live,
    OpenFleet,
    Outcome,
    Sent,
    State,
    Variant,
    requested,
)

if TYPE_CHECKING:
    from kalscope.estimation.request import FitResult
    from kalscope.fleet.results import Fleet


# Changes of the parameters of the channel on screen, and of its filter.
#
# A browser may send anything, so a change clamps its values or raises BadSetting; it never trusts a widget's
# limits.


DECADES = {"q": (-8, 3), "r": (-5, 4), "p0": (-6, 6)}
"""Range of each slider, in decades around the starting r of the channel."""


def slider_limits(state: State, name: str) -> tuple[int, int]:
    """Lowest and highest exponent of a slider: around the signal's own noise, wider if the value is outside."""
    return exponents_around(state.start.r, DECADES[name], [getattr(state.tuning, name) or 0.0], slack=0.0)


def exponents_around(noise: float, ends: tuple[int, int], values: Iterable[float], slack: float) -> tuple[int, int]:
    """Exponents `ends` decades around a variance, and wider where values lie outside by `slack`."""
    centre = round(math.log10(noise)) if noise > 0.0 else 0
    low, high = (centre + end for end in ends)
    for exponent in (math.log10(value) for value in values if value > 0.0):
        low, high = min(low, math.floor(exponent + slack)), max(high, math.ceil(exponent - slack))
    return max(low, -300), min(high, 300)


@requested
def set_slider(state: State, name: str, position: float) -> State:
    """A slider was moved: q, r or p0 becomes 10^position; moving p0 means a start by value.

    The fast factor too; one speed at its low end. The slider of the momentum counts as `momentum_at` does.
    """
    if not math.isfinite(position):
        return state
    if name == "momentum":
        value = momentum_at(position)
    else:
        low, high = (0.0, math.log10(MAX_FAST)) if name == "fast" else slider_limits(state, name)
        value = _rounded(10.0 ** min(max(position, low), high))
        value = None if name == "fast" and value <= 1.0 else value
    return state if value == getattr(state.tuning, name) else _by_hand(state, name, value)


@requested
def set_point(state: State, q_exponent: float, r_exponent: float) -> State:
    """A point of the tuning map was chosen: q and r become 10^exponent, to three digits."""
    if not state.has_one_speed or not (math.isfinite(q_exponent) and math.isfinite(r_exponent)):
        return state
    q, r = (_rounded(10.0 ** min(max(e, -300.0), 299.9)) for e in (q_exponent, r_exponent))
    return state if (q, r) == (state.tuning.q, state.tuning.r) else state.with_tuning(q=q, r=r, how="by hand")


NOTHING = {"p0": None, "x0": None, "gate": None, "momentum": 0.0, "fast": None, "spikes": 0.0}
"""The parameters that may be left out, and their values then."""

WORDS_OF_NOTHING = ("", "automatic", "diffuse", "first", "off", "none")
"""What a user may type for them."""


def typed_value(name: str, text: str) -> float | None:
    """The value of a parameter that a user typed; BadSetting where it is no number and no word for none."""
    nothing = name in NOTHING and text.strip().lower() in WORDS_OF_NOTHING
    return NOTHING[name] if nothing else typed_number(name, text)


@requested
def set_text(state: State, name: str, text: str) -> State:
    """An exact value was typed: a number, or a word for none; the gate in σ, a momentum also as a time."""
    if name == "gate":
        return _by_hand(state, "gate", typed_gate(text))
    is_momentum = name == "momentum"
    value = typed_momentum(text, state.recording.sample_period) if is_momentum else typed_value(name, text)
    if getattr(state.tuning, name) == value:
        return state
    if name == "p0" and value is None:
        return state.with_tuning(p0=None, x0=None)
    if name == "x0" and state.tuning.p0 is None:
        return state.with_tuning(x0=value, p0=state.tuning.r)
    return _by_hand(state, name, value)


def _by_hand(state: State, name: str, value: float | None) -> State:
    """One parameter set by hand; those of the start and the gate have no history that this ends.

    Momentum and two speeds exclude each other, and a filter with two speeds has no gate.
    """
    how = "by hand" if name in ("q", "r", "momentum", "fast") else state.tuning.how
    more: dict[str, Any] = {"fast": None, "spikes": 0.0} if name in ("momentum", "gate") and value else {}
    if name == "fast":
        more = {"momentum": 0.0, "gate": None} if value else {"spikes": 0.0}
    return state.with_tuning(**{**more, name: value}, how=how)


def reset_parameters(state: State) -> State:
    """Back to the starting values of the channel, or to those of the fused sensors."""
    if state.fusion is not None:
        return state.with_fusion(replace(state.fusion, tuning=state.fusion.start, dropped=frozenset()))
    return state.with_tuning_of(state.index, state.start)


TOO_LATE = "after another recording was opened; nothing was changed."
"""How a note ends on an answer that comes too late."""


@requested
def apply_found(state: State, recording: Recording, channel: str, found: FitResult) -> State:
    """A search has ended: its q, r, momentum and gate become the channel's, if the channel is still there."""
    if not state.continues(recording):
        return replace(state, note=f"The search ended {TOO_LATE}")
    at, params = recording.index(channel), found.params
    before = state.tunings[at]
    outcome = Outcome(**vars(found), before=before, after=None)
    if params is None:
        return replace(state, searched=outcome)
    by_hand = before not in (state.searched and state.searched.after, *(one.after for one in state.firsts))
    kept = before if by_hand else replace(before, gate=None, p0=None, x0=None)
    values: dict[str, Any] = {name: getattr(params, name) for name in ("q", "r", "momentum", "fast", "spikes")}
    values |= {"gate": params.gate} if params.fast or params.gate is not None else {}
    values |= {} if params.p0 is None else {"p0": params.p0, "x0": params.x0}
    after = replace(kept, **values, how=found.how, chain=found.chain, paper=None)
    searched = replace(outcome, after=after) if channel == state.channel else None
    return replace(state.with_tuning_of(at, after), searched=searched)


@requested
def set_sample_period(state: State, text: str) -> State:
    """The time between two samples was typed, s; an empty box is what the recording says."""
    period = typed_number("sample period", text) if text.strip() else None
    return state if period == state.typed_period else opening.with_sample_period(state, period)


# Changes of the momentum τ of the channel on screen: by its slider, or typed in samples or as a time.
#
# The slider counts log₁₀(1 + τ): its low end is exactly 0, and from a few samples on equal steps are equal ratios.


MAX_POSITION = 5.0
"""Where the slider ends: at MAX_MOMENTUM, 100,000 samples."""

OFF = "off"
"""The text for no momentum."""


def slider_position(momentum: float) -> float:
    """The position of the slider for a momentum in samples, 0 … MAX_POSITION."""
    return math.log1p(momentum) / math.log(10.0)


def momentum_at(position: float) -> float:
    """The momentum in samples at a position of the slider, to three digits; exactly 0 at its low end."""
    held = min(max(position, 0.0), MAX_POSITION)
    return min(float(f"{math.expm1(held * math.log(10.0)):.2e}"), MAX_MOMENTUM)


def typed_momentum(text: str, period: float | None) -> float:
    """The momentum in samples that a user typed.

    Raises:
        BadSetting: it is not a number, or it is a time and the sample period is not known.
    """
    bare = re.sub(r" samples?$", "", text.strip().lower())
    unit, length = next((one for one in TIME_UNITS if bare.endswith(one[0])), ("", 0.0))
    if not unit:
        return typed_value("momentum", bare) or 0.0
    if period is None:
        raise BadSetting(f"momentum must be in samples while the sample period is not known (got {text[:40]!r})")
    return typed_number("momentum", bare.removesuffix(unit)) * length / period


def add_momentum(state: State) -> State:
    """Begin with a momentum as long as the lag, to two digits; a slider can then find a better one."""
    lag = steady_state(state.tuning.params).lag_samples
    return _by_hand(state, "momentum", float(f"{min(max(lag, 1.0), MAX_MOMENTUM):.1e}"))


def momentum_words(momentum: float, period: float | None) -> str:
    """A momentum as a time, or in samples where the sample period (s) is not known; "off" for none."""
    return lag_text(momentum, period) if momentum > 0.0 else OFF


# Changes of the chain of filters that a channel runs in place of the Kalman filter alone.


MEDIANS = {"off": 1, "3 samples": 3, "5 samples": 5}
"""Samples of the medians that may be chosen as the first filter, by the words on screen."""


def median_words(window: int) -> str:
    """A median of `window` samples as the menu names it."""
    return "off" if window == 1 else f"{window} samples"


@requested
def use_chain(state: State, chain: Chain) -> State:
    """The channel on screen runs this chain; its q and r stay."""
    state.require_one_channel()
    if state.tuning.chain == chain:
        return state
    after = state.with_tuning(chain=chain, paper=None)
    words = f"{chain.words[:1].upper()}{chain.words[1:]}"
    return replace(after, note=f"{words} runs now; Undo reverts it.")


@requested
def set_median(state: State, words: str) -> State:
    """Put a median before the filter that runs, or none."""
    chain = state.tuning.chain
    if words == median_words(1 if chain is None else chain.median):
        return state
    _require("the median", words, MEDIANS)
    then, notch, window = chain and chain.then, chain and chain.notch, MEDIANS[words]
    gone = window == 1 and then is None and notch is None
    return state.with_tuning(chain=None if gone else Chain(window, then, notch))


def _require(what: str, choice: str, choices: Collection[str]) -> None:
    """BadSetting where it is none of the choices."""
    if choice not in choices:
        raise BadSetting(f"{what} must be one of {', '.join(choices) or 'none'} (got {str(choice)[:40]!r})")


# Changes of the channels: which is on screen, which are linked, whose settings are copied.


@requested
def select_channel(state: State, name: str) -> State:
    """Show another channel, with its own parameters, or the fused value."""
    fused = state.fused is not None and name == state.fused.tuning.name
    if not fused:
        state.recording.index(name)
    if fused is state.shows_fused and (fused or name == state.channel):
        return state
    channel = state.channel if fused else name
    state = replace(state.with_reset_view(), channel=channel, shows_fused=fused, searched=None, note="")
    return state if fused else opening.with_first_answer(state)


def channel_named(recording: Recording, text: str) -> str:
    """A channel by its name, or by its number from 1 where no channel is called so."""
    number = int(text) if text.isascii() and text.isdecimal() and len(text) < 6 else 0
    if text not in recording.names and 1 <= number <= len(recording.names):
        return recording.names[number - 1]
    return text


@requested
def set_link(state: State, link: str) -> State:
    """Tune this channel alone or all together; all then take the present one's setting at once."""
    _require("the way of tuning channels", link, LINKS)
    # Not those of the fused value, which may be on screen.
    return replace(state, link=link).with_tuning_of(state.index, state.tunings[state.index])


@requested
def set_board_channel(state: State, name: str | None) -> State:
    """Say which channel is the board's own filtered curve; None: there is none."""
    if name is not None:
        state.recording.index(name)
    return state if name == state.board else replace(state, board_choice=name)


# Changes of the fused filter: sensors are fused, one drops out, its noise or its offset changes.


def candidates(state: State) -> tuple[str, ...]:
    """Channels of the quantity on screen, in their order: those of its unit, without the board's own curve.

    Of too many the first ones and the one on screen; sensors that are already fused are always included.
    """
    recording, fusion = state.recording, state.fused
    unit = recording.units[state.index] if fusion is None else fusion.tuning.unit
    alike = [name for name, of in zip(recording.names, recording.units, strict=True) if of == unit]
    filtered = {f"{name}_filtered" for name in alike}
    filtered |= {"filtered"} if "raw" in alike else set[str]()
    alike = [name for name in alike if name not in filtered]
    first = () if fusion is None else fusion.tuning.sensors
    wanted = [*first, *([state.channel] if state.channel in alike else []), *alike]
    chosen = set(list(dict.fromkeys(wanted))[:MAX_SENSORS])
    return tuple(name for name in recording.names if name in chosen) if len(chosen) >= MIN_SENSORS else ()


def readings_of(state: State, sensors: tuple[str, ...]) -> list[int]:
    """Columns of the sensors that are to be fused.

    Raises:
        BadSetting: too few or too many, or of different units.
    """
    if not MIN_SENSORS <= len(sensors) <= MAX_SENSORS:
        raise BadSetting(f"tick {MIN_SENSORS} to {MAX_SENSORS} sensors of one quantity (got {len(sensors)})")
    columns = [state.recording.index(name) for name in sensors]
    if len({state.recording.units[at] for at in columns}) > 1:
        raise BadSetting(f"sensors that are fused must have one unit (got {', '.join(sensors)[:100]})")
    return columns


@requested
def apply_estimate(state: State, recording: Recording, sensors: tuple[str, ...], found: Estimate) -> State:
    """A search has ended: its filter is on screen, if it found one and the recording still is."""
    if found.params is None:
        raise BadSetting(found.message)
    if not state.continues(recording):
        return replace(state, note=f"The sensors were fused {TOO_LATE}")
    unit = recording.units[recording.index(sensors[0])]
    tuning = ChannelTuning.of_params(name_of_fused(recording), unit, found.params, "maximum likelihood", sensors)
    return state.with_fusion(Fusion(tuning, tuning, estimate=found)).with_reset_view()


def stop_fusing(state: State) -> State:
    """The channel's own filter again; Undo brings the fused one back."""
    return state if state.fused is None else state.with_fusion(None).with_reset_view()


@requested
def set_taking_part(state: State, sensor: str, takes_part: bool) -> State:
    """A sensor drops out, or is taken in again; BadSetting for the last one."""
    fusion, _ = _fusion_of(state, sensor)
    dropped = fusion.dropped - {sensor} if takes_part else fusion.dropped | {sensor}
    if len(dropped) == len(fusion.tuning.sensors):
        raise BadSetting(f"at least one sensor must take part (got {sensor[:40]!r}, the last one, dropped out)")
    return state.with_fusion(replace(fusion, dropped=dropped))


@requested
def set_sensor_text(state: State, sensor: str, name: str, text: str) -> State:
    """An exact r or offset of a sensor was typed."""
    fusion, at = _fusion_of(state, sensor)
    value = 0.0 if name == "offset" and not text.strip() else typed_number(f"{name} of {sensor[:40]}", text)
    each = getattr(fusion.tuning, name)
    if each[at] == value:
        return state
    values = {name: (*each[:at], value, *each[at + 1 :])}
    return state.with_fusion(replace(fusion, tuning=replace(fusion.tuning, **values, how="by hand")))


def _fusion_of(state: State, sensor: str) -> tuple[Fusion, int]:
    """The fused filter and the index of a sensor; BadSetting where it does not have this sensor."""
    if state.fused is None or sensor not in state.fused.tuning.sensors:
        raise BadSetting(f"the sensor must be one of those that are fused (got {sensor[:40]!r})")
    return state.fused, state.fused.tuning.sensors.index(sensor)


# Changes of the open fleet, and the step from one of its devices to the recording on screen.


@requested
def open_fleet(state: State, fleet: Fleet) -> State:
    """Open a fleet, and the map, which shows its devices."""
    return replace(state.with_view(map_shown=True), fleet=OpenFleet(fleet))


def close_fleet(state: State) -> State:
    """Close the fleet."""
    return replace(state, fleet=None)


def set_fleet_order(order: str) -> Change:
    """Sort the devices in another way."""
    _require("sort by", order, ORDERS)
    return _set_fleet("order", str, order)


@requested
def _set_fleet(state: State, name: str, kept: Callable[[Any], Any], value: Any) -> State:

    return state if state.fleet is None else replace(state, fleet=replace(state.fleet, **{name: kept(value)}))


find_devices = partial(_set_fleet, "find", lambda text: one_line(str(text))[:200].strip())
"""List the devices whose names contain a text."""


@requested
def at_device(state: State, fleet: Fleet, i: int) -> State:
    """Set the recording of a device, which has just been opened, to its own filter.

    A device without q and r keeps its starting values; the note says why.
    """
    from kalscope.fleet.results import device_tuning

    name = one_line(fleet.devices.name(i))[:80]
    if fleet.devices.reasons[i]:
        return replace(state, note=f"{name} has no q and r: {one_line(fleet.devices.reasons[i])[:200]}.")
    return opening.adapted(state, device_tuning(fleet, i), f"{name} at its own filter.")


# Changes of the pinned settings.


def pin_present(state: State) -> State:
    """Keep the present setting of the channel on screen as a variant, under the first letter that is free."""
    state.require_one_channel()
    if state.tuning.paper is not None:
        raise BadSetting("the Khan et al. filter has no q and r, so it cannot be pinned")
    same = next((one for one in state.variants if one.tuning.filter == state.filter), None)
    if same is not None:
        raise BadSetting(f"this setting is pinned already, as {same.name}")
    free = set(range(MAX_VARIANTS)) - {one.number for one in state.variants}
    if not free:
        raise BadSetting(
            f"a channel must have at most {MAX_VARIANTS} pinned settings: delete one first (got {MAX_VARIANTS})"
        )
    return replace(state, pins=(*state.pins, Variant(min(free), state.tuning)), note="")


@requested
def use_variant(state: State, name: str) -> State:
    """The present setting becomes that of a variant."""
    return state.with_tuning_of(state.index, _variant(state, name).tuning)


@requested
def delete_variant(state: State, name: str) -> State:
    """Forget a variant; its letter and colour are free again."""
    gone = _variant(state, name)
    return replace(state, pins=tuple(one for one in state.pins if one is not gone))


def _variant(state: State, name: str) -> Variant:
    named = {one.name: one for one in state.variants}
    _require("variant", name, named)
    return named[name]


# Changes of the view: the window, the theme, the map, what is drawn beside the signal.


@requested
def set_window(state: State, first: float, last: float) -> State:
    """Show the recording from `first` to `last`, s; at least ten samples; the whole of it is None."""
    t = state.recording.time
    begin, end = float(t.min()), float(t.max())
    if not (math.isfinite(first) and math.isfinite(last)):
        return state
    low, high = sorted((min(max(first, begin), end), min(max(last, begin), end)))
    shortest = 10.0 * (state.recording.sample_period or 1.0)
    if high - low < shortest:
        low, high = max(begin, min(low, end - shortest)), min(end, max(high, low + shortest))
    window = None if low <= begin and high >= end else (low, high)
    after = state.with_view(window=window).with_live(following=False)  # the user looks back
    return state if (after.view, after.live) == (state.view, state.live) else after


def reset_view(state: State) -> State:
    """Show the whole recording and forget the zoom."""
    return state.with_reset_view(window=None)


def _set_view(name: str, kept: Callable[[Any], Any], value: Any) -> Change:
    return lambda state: state.with_view(**{name: kept(value)})


# Whether something is drawn or shown; each is called with a bool.
set_smoother = partial(_set_view, "smoother", bool)
set_velocity = partial(_set_view, "velocity", bool)
set_gain_shown = partial(_set_view, "gain_shown", bool)
set_why_shown = partial(_set_view, "why_shown", bool)
set_map_shown = partial(_set_view, "map_shown", bool)
set_dark = partial(_set_view, "dark", bool)
set_match_by = partial(_set_view, "match_by", lambda value: "noise" if value == "noise" else "lag")
"""Compare simpler filters at equal "lag" or equal "noise" reduction."""
set_drawn_alternative = partial(_set_view, "drawn_alternative", lambda name: str(name)[:60])
"""Draw one simpler filter beside the present one, by its name; any other word draws all."""


@requested
def set_search_method(state: State, method: str, methods: Collection[str]) -> State:
    """Search q and r by another method, one of `methods`."""
    _require("the way to find q and r", method, methods)
    return state.with_view(search_method=method)


# Changes that a piece of advice asks for, where no search is needed.


FOR_NOISE, FOR_LAG = "data sheet σ, fit q", "maximum lag"
"""The search methods that ask for the noise of the sensor, and for a lag."""


@requested
def change_for(state: State, action: actions.Action, judged: State) -> State:
    """What an action does to the filter that was judged; nothing on another recording or channel.

    The values are those of the judged filter, so that two clicks do no more than one.
    """
    if not is_same_signal(state, judged):
        return state
    q, r, how = judged.tuning.q, judged.tuning.r, judged.tuning.how
    match action:
        case actions.Scale(q_factor, r_factor):
            from kalscope.analysis.findings import request_in

            keeps_goal = q_factor == r_factor and request_in(how, r) is not None  # q/r stays, and so does a goal
            how = how if keeps_goal else "by hand"
            return state.with_tuning(q=_rounded(q * q_factor), r=_rounded(r * r_factor), how=how)
        case actions.SetGate(sigma):
            return state.with_tuning(gate=None if sigma is None else sigma * sigma)
        case actions.UnsetStart():
            return state.with_tuning(p0=None, x0=None)
        case actions.GiveNoise() | actions.ChooseFilter():
            is_noise = isinstance(action, actions.GiveNoise)
            return state.with_view(search_method=FOR_NOISE if is_noise else FOR_LAG)
        case _:
            return state


def is_same_signal(state: State, judged: State) -> bool:
    """Whether the channel that was judged is still on screen."""
    return state.continues(judged.recording) and state.channel == judged.channel


def _rounded(value: float) -> float:
    """To three digits, as a slider sets it."""
    return float(f"{value:.2e}")


# A tuning file loaded in the dashboard: its q, r, p0 … become those of what is open.


ENDING = ".toml"
"""What the name of a tuning file ends with; every other file is a recording."""


def uploaded_settings(name: str, content: bytes) -> Tuning:
    """What an uploaded tuning file holds.

    Raises:
        BadFile: it is not a tuning file.
    """
    try:
        return loads(text_of(content))
    except BadFile as error:
        raise BadFile(f"{name!r}: {error}") from None


@requested
def use_settings(state: State, tuning: Tuning, name: str) -> State:
    """The values of a file, called `name`, become those of the channels of the same names; one undoable change."""
    return opening.adapted(state, tuning, f"Loaded {one_line(name)[:80]}.")


@requested
def as_it_was_left(state: State, tuning: Tuning) -> State:
    """The filters that this file had when it was last open, unless others than the starting values are set now."""
    if state.recording.source != tuning.source or state.tunings != state.starts:
        return state
    try:
        after = opening.adapted(state, tuning, "The filter is as you left it: Undo gives the starting values.")
    except BadSetting:  # the file has other channels now
        return state
    if (after.tunings, after.fused) == (state.tunings, state.fused):
        return state
    chosen = state.channel != default_channel(state.recording)  # on the command line
    return replace(after, channel=state.channel if chosen else after.channel)


# A live board in the State: its window follows the newest sample or is paused; `refreshed` adds new samples.
#
# The State holds the record as of the last refresh (`Snapshot`: views, so taking one costs nothing). What the user
# chose stays; only the record under it grows.


SPANS = {
    **{f"{seconds} s": float(seconds) for seconds in (1, 2, 5, 10, 30)},
    **{f"{minutes} min": 60.0 * minutes for minutes in (1, 2, 5, 10)},
    "all": math.inf,
}
"""Lengths of the window that follows the newest sample, s."""

START_SAMPLES, START_SECONDS = 100, 2.0
"""The starting r is measured on the first samples: on this many, or over this long if the board is slow."""

MIN_SAMPLES = 10
"""Fewer samples than this show nothing yet."""

WAITING = f"waiting for the first {MIN_SAMPLES} samples"
"""What is said instead of the size of the placeholder."""

MAX_STUDIED = 100_000
"""Newest samples that the checks, spectra and maps of a live record are computed from."""


def opened_live(board: LiveSource, title: str, before: State | None = None, tuning: Tuning | None = None) -> State:
    """A state that waits for the first samples of a board and then shows them.

    Args:
        board: the board.
        title: its name, as the user gave it.
        before: what was on screen.
        tuning: values to begin with, for the channels of the same names; None = measured on the first samples.
    """
    live = Live(board, deferred=() if tuning is None else (lambda state: opening.adapted(state, tuning),))
    # Until it has sent something, two missing samples are on screen.
    waiting = Recording(np.arange(2.0), ("signal",), ("",), np.full((2, 1), np.nan), None, title=title)
    return replace(opening.opened(waiting, before), note="", live=live)


def _apply_deferred(state: State) -> State:
    """The state with what the command line asked for; the note says what could not be applied."""
    live, notes = state.live, list[str]()
    if live is None or not live.settled or not live.deferred:
        return state
    state = state.with_live(deferred=())
    for change in live.deferred:
        try:
            state = change(state)
            notes += filter(None, [state.note])
        except BadSetting as error:
            notes.append(f"Ignored command-line option: {error}.")
    return replace(state.with_reset_view(), note=" ".join(notes))


def refreshed(state: State, snapshot: Snapshot | None) -> State:
    """The state with the samples that its board has now; the same object where there are no new ones."""
    live = state.live
    if live is None or live.paused or snapshot is None or len(snapshot.recording) < MIN_SAMPLES:
        return state
    last = live.snapshot
    if last is not None and (last.generation, last.version) == (snapshot.generation, snapshot.version):
        return state
    if last is None or last.generation != snapshot.generation or not live.settled:
        state = _begun(state, snapshot)
    return replace(state, recording=snapshot.recording).with_live(snapshot=snapshot)


def _begun(state: State, snapshot: Snapshot) -> State:
    """Starting values from the first samples, and what is kept from before."""
    recording = snapshot.recording
    firsts: list[int] = np.isfinite(recording.values).argmax(axis=0).tolist()  # a topic may first appear later
    begin = max(firsts, default=0)
    lasted = float(recording.time[-1] - recording.time[begin])
    settled = len(recording) - begin >= START_SAMPLES or lasted >= START_SECONDS
    head = _part(recording, begin, begin + START_SAMPLES)
    found = list[Outcome]()
    for i, (first, name) in enumerate(zip(firsts, recording.names, strict=True)):
        answer = opening.first_answer if i < opening.MOST_CHANNELS else opening.not_fitted
        found.append(answer(_part(recording, first, first + START_SAMPLES), name))
    fresh = opening.with_first_answer(opening.opened(head, state, tuple(found)))
    last, now = state.live and state.live.snapshot, recording.names
    before = last.recording.names if last else ()
    if last is not None and (last.generation == snapshot.generation or before == now[: len(before)] != now):
        fresh = replace(fresh, note=state.note)
    if now == state.recording.names:
        fresh = fresh.with_view(resets=state.view.resets)
    choice = state.board_choice if state.board_choice in (*now, None) else fresh.board_choice
    fresh = replace(fresh, board_choice=choice, options=state.options, live=state.live)
    return _apply_deferred(fresh.with_live(settled=settled))


def without_samples(state: State) -> State:
    """The state as the history keeps it: without the samples, which the connection keeps."""
    if state.live is None or state.live.snapshot is None:
        return state
    few = _part(state.recording, 0, 2)
    stub = replace(few, time=few.time.copy(), values=few.values.copy())  # a view would keep the whole array
    return replace(state, recording=stub).with_live(snapshot=None, paused=False)


def with_current_samples(kept: State, present: State) -> State:
    """A state from the history with the samples on screen, if it is the same board."""
    same = kept.live and present.live and present.live.board is kept.live.board
    same = same and tuple(tuning.name for tuning in kept.tunings) == present.recording.names
    return replace(kept, recording=present.recording, live=present.live) if same else kept


def studied(state: State) -> State:
    """The state that idle-time computations use: the newest samples of a live record, all of any other."""
    n = len(state.recording)
    if state.live is None or n <= MAX_STUDIED:
        return state
    return replace(state, recording=_part(state.recording, n - MAX_STUDIED, n))


def live_window(state: State) -> tuple[float, float] | None:
    """First and last time on screen, s, of what is open; None = all of it."""
    if state.live is None or not state.live.following:
        return state.view.window
    if math.isinf(state.live.span):
        return None
    end = float(state.recording.time[-1])
    return end - state.live.span, end


def _part(recording: Recording, first: int, last: int) -> Recording:
    return replace(recording, time=recording.time[first:last], values=recording.values[first:last])


def follow(state: State) -> State:
    """The Live button: continue, at the newest sample."""
    return state.with_live(following=True, paused=False).with_reset_view(window=None) if state.live else state


def pause(state: State) -> State:
    """The Pause button: freeze the screen, while samples still arrive."""
    return state.with_live(paused=True)


@requested
def set_span(state: State, words: str) -> State:
    """Choose the length of the window that follows, by its label."""
    _require("the live window", words, SPANS)
    after = state.with_live(span=SPANS[words], following=True)  # a paused screen stays so
    return after.with_reset_view(window=None) if state.live else state


@requested
def set_sent(state: State, sent: Sent | None) -> State:
    """The board has taken a setting, and its curve is drawn; None: what it uses is not known."""
    if sent is not None and state.board is None and sent.filtered in state.recording.names:
        state = replace(state, board_choice=sent.filtered)
    return replace(state, sent=sent)


@requested
def set_calibration(state: State, calibration: BoardCalibration | None) -> State:
    """The board has measured its noise, or could not; None: it begins to."""
    # Its filter continued with what it measured: there is no restart from which to compare it.
    sent = state.sent if calibration is None or calibration.values is None else None
    return replace(state, calibration=calibration, sent=sent)


@requested
def set_kept(state: State, kept: bool) -> State:
    """The board keeps its values for its next start, or those of its export."""
    known = state.calibration
    return state if known is None else replace(state, calibration=replace(known, kept=kept))


def calibration_here(state: State) -> BoardCalibration | None:
    """The result of letting the board measure the channel on screen."""
    known = state.calibration
    return known if known and (known.record, known.channel) == (state.record_key, state.channel) else None


def use_calibration(state: State) -> State:
    """Filter the channel on screen with the r and q that its board measured."""
    known = calibration_here(state)
    if known is None or known.values is None:
        raise BadSetting("the board must have measured this channel first (got none)")
    state = state if state.uses_parameters else state.with_standard_filter()
    return state.with_tuning(**known.values.parameters, how="measured by the board")


# One line that reopens file, channel and setting: written from a State, and applied to one.


AUTOMATIC = {"p0": "automatic", "x0": "first", "gate": "off", "fast": "off"}
"""The texts that mean no number."""


@dataclass(frozen=True)
class ShareLine:
    """The line, and what must be said with it."""

    line: str
    """The command."""
    remarks: tuple[str, ...]
    """Sentences on what it does not contain; fixed texts, with nothing from a file."""


def share_line(state: State) -> ShareLine:
    """The command that reopens what is on screen: q and r always, the rest where it was changed."""
    recording, remarks = state.recording, list[str]()
    source = f"./{recording.source}" if recording.source.startswith("-") else recording.source
    if not source.isprintable() or not source:
        source, remarks = "FILE", ["Replace FILE with the path of the open file."]
    words = ["kalscope", "open", source]
    words += () if state.typed_period is None else option("sample-period", repr(state.typed_period))
    words += option_words(state.options)
    if len(recording.names) > 1:
        named = state.channel.isprintable() and state.channel.strip()
        words += option("channel", state.channel if named else str(state.index + 1))
    if state.fusion is not None:
        remarks.append("Fused sensors reopen with the tuning file above.")
    elif state.tuning.paper is not None:
        remarks.append("The Khan et al. filter reopens as its experiment has it.")
    else:
        tuning, start = state.tuning, state.start
        words += [*option("q", repr(tuning.q)), *option("r", repr(tuning.r))]
        for name in ("momentum", "fast", "spikes", "p0", "x0", "gate"):
            value = getattr(tuning, name)
            if value != getattr(start, name) and (name != "x0" or tuning.p0 is not None):
                words += option(name, AUTOMATIC[name] if value is None else repr(value))
        words += [] if tuning.chain is None else option("chain", chain_text(tuning.chain))
    if len(recording.names) > 1:
        remarks.append("The other channels open at their starting values; the tuning file above keeps them all.")
    return ShareLine(command_line(words), tuple(remarks))


def apply_options(state: State, channel: str | None, chain: str | None = None, **given: str) -> State:
    """The state with the channel and the setting of the command line; what is None stays as it was opened.

    Raises:
        BadSetting: no such channel, not a number, not a chain, or values that no filter can have.
    """
    values: dict[str, float | Chain | None] = {name: typed_value(name, text) for name, text in given.items()}
    if values.get("p0", 0.0) is None:
        values["x0"] = None
    if chain is not None:
        values["chain"] = typed_chain(chain)

    def change(state: State) -> State:
        if channel is not None:
            state = select_channel(channel_named(state.recording, channel))(state)
        return state.with_tuning(**values, paper=None, how="command line") if values else state

    live = state.live
    if live is None or live.settled or (channel is None and not values):
        return change(state)
    state.with_tuning(**values)  # refuses now what no channel could have
    return state.with_live(deferred=(*live.deferred, change))  # until the channels of the board are known
