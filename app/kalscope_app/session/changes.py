"""Changes of the State that the user asks for: pure functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from kalscope.analysis import actions
from kalscope.analysis.channel_kinds import default_channel
from kalscope.analysis.findings import request_in
from kalscope.common.text import TIME_UNITS, lag_text, one_line, typed_gate, typed_number
from kalscope.errors import BadFile, BadSetting
from kalscope.estimation.result import Estimate
from kalscope.filtering.classic import Chain
from kalscope.filtering.params import MAX_MOMENTUM, FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.recording import Recording
from kalscope.tuning.choose import name_of_fused
from kalscope.tuning.file import loads
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.session.opening import adapted, with_first_answer, with_sample_period
from kalscope_app.session.state import (
    LINKS,
    MAX_SENSORS,
    MIN_SENSORS,
    ORDERS,
    Change,
    Fusion,
    OpenFleet,
    Outcome,
    State,
    Variant,
    pinned,
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
    noise, value = state.start.r, getattr(state.tuning, name)
    centre = round(math.log10(noise)) if noise > 0.0 else 0
    low, high = (centre + end for end in DECADES[name])
    if value:
        low, high = min(low, math.floor(math.log10(value))), max(high, math.ceil(math.log10(value)))
    return max(low, -300), min(high, 300)


@requested
def set_exponent(state: State, name: str, exponent: float) -> State:
    """A slider was moved: q, r or p0 becomes 10^exponent; moving p0 means a start by value."""
    if not math.isfinite(exponent):
        return state
    low, high = slider_limits(state, name)
    return _by_hand(state, name, _rounded(10.0 ** min(max(exponent, low), high)))


@requested
def set_point(state: State, q_exponent: float, r_exponent: float) -> State:
    """A point of the tuning map was chosen: q and r become 10^exponent, to three digits."""
    if not state.is_standard or not (math.isfinite(q_exponent) and math.isfinite(r_exponent)):
        return state
    q, r = (_rounded(10.0 ** min(max(e, -300.0), 299.9)) for e in (q_exponent, r_exponent))
    return state if (q, r) == (state.tuning.q, state.tuning.r) else state.with_tuning(q=q, r=r, how="by hand")


@requested
def set_text(state: State, name: str, text: str) -> State:
    """An exact value was typed: q, r, p0 (or "", "diffuse": automatic), x0 (or "": the first sample), gate in σ."""
    if name == "x0" and text.strip().lower() in ("", "first"):
        return state.with_tuning(x0=None)
    if name == "p0" and text.strip().lower() in ("", "automatic", "diffuse"):
        return set_automatic_start(True)(state)
    if name == "gate":
        return state.with_tuning(gate=typed_gate(text))
    value = typed_number(name, text)
    if getattr(state.tuning, name) == value:
        return state
    if name == "x0" and state.tuning.p0 is None:
        return state.with_tuning(x0=value, p0=state.tuning.r)
    return _by_hand(state, name, value)


def _by_hand(state: State, name: str, value: float) -> State:
    """One parameter set by hand; only q, r and the momentum have a history that this ends."""
    how = "by hand" if name in ("q", "r") else state.tuning.how
    return state.with_tuning(**{name: value}, how=how)


@requested
def set_automatic_start(state: State, automatic: bool) -> State:
    """Automatic (diffuse) start at the first sample, or p0 and x0 by value, beginning with p0 = r."""
    if automatic == (state.tuning.p0 is None):
        return state
    return state.with_tuning(p0=None if automatic else max(state.tuning.r, 1e-300), x0=None)


def reset_parameters(state: State) -> State:
    """Back to the starting values of the channel, or to those of the fused sensors."""
    if state.fusion is not None:
        return state.with_fusion(replace(state.fusion, tuning=state.fusion.start, dropped=frozenset()))
    start = state.start
    values = {name: getattr(start, name) for name in (*PARAMETERS, "how")}
    return state.with_tuning(**values)


@requested
def apply_found(state: State, recording: Recording, channel: str, found: FitResult) -> State:
    """A search has ended: its q, r, momentum and gate become the channel's, if the channel is still there."""
    if not state.continues(recording):
        note = "The search ended after another recording was opened; nothing was changed."
        return state.with_answers(note=note)
    at = recording.index(channel)
    before = state.settings.tunings[at]
    if found.params is None:
        return state.with_answers(
            outcome=Outcome(found.how, found.message, before, None, found.estimate, found.request)
        )
    q, r, momentum = (float(value) for value in (found.params.q, found.params.r, found.params.momentum))
    last = state.answers.outcome
    by_hand = before not in (last and last.after, *(one.after for one in state.settings.firsts))
    kept = before if by_hand else replace(before, gate=None, p0=None, x0=None)
    gate = kept.gate if found.params.gate is None else found.params.gate
    start = {} if found.params.p0 is None else {"p0": found.params.p0, "x0": found.params.x0}
    values = {"q": q, "r": r, "momentum": momentum, "gate": gate, **start}
    after = replace(kept, **values, how=found.how, chain=None, paper=None)
    answer = Outcome(found.how, found.message, before, after, found.estimate, found.request)
    outcome = answer if channel == state.channel else None
    return state.with_tuning_of(at, after).with_answers(outcome=outcome)


@requested
def set_sample_period(state: State, text: str) -> State:
    """The time between two samples was typed, s; an empty box is what the recording says."""
    period = typed_number("sample period", text) if text.strip() else None
    return state if period == state.open.typed_period else with_sample_period(state, period)


# Changes of the momentum τ of the channel on screen: by its slider, or typed in samples or as a time.
#
# The slider counts log₁₀(1 + τ): its low end is exactly 0, and from a few samples on equal steps are equal ratios.


MAX_POSITION = 5.0
"""Where the slider ends: at MAX_MOMENTUM, 100,000 samples."""

OFF = "off"
"""The text for no momentum."""

_SAMPLES = (" samples", " sample")


def slider_position(momentum: float) -> float:
    """The position of the slider for a momentum in samples, 0 … MAX_POSITION."""
    return math.log1p(momentum) / math.log(10.0)


def momentum_at(position: float) -> float:
    """The momentum in samples at a position of the slider, to three digits; exactly 0 at its low end."""
    held = min(max(position, 0.0), MAX_POSITION)
    return min(float(f"{math.expm1(held * math.log(10.0)):.2e}"), MAX_MOMENTUM)


@requested
def set_momentum_position(state: State, position: float) -> State:
    """The slider was moved."""
    return with_momentum(state, momentum_at(position)) if math.isfinite(position) else state


@requested
def set_momentum_text(state: State, _name: str, text: str) -> State:
    """A momentum was typed: samples, or a time such as 240 ms; empty or "off" is none."""
    return with_momentum(state, typed_momentum(text, state.recording.sample_period))


def typed_momentum(text: str, period: float | None) -> float:
    """The momentum in samples that a user typed.

    Raises:
        BadSetting: it is not a number, or it is a time and the sample period is not known.
    """
    bare = text.strip().lower()
    if bare in ("", OFF, "none"):
        return 0.0
    for word in _SAMPLES:
        bare = bare.removesuffix(word)
    unit = next(((word, length) for word, length in TIME_UNITS if bare.endswith(word)), None)
    if unit is None:
        return typed_number("momentum", bare)
    if period is None:
        raise BadSetting(f"momentum must be in samples while the sample period is not known (got {text[:40]!r})")
    word, length = unit
    return typed_number("momentum", bare.removesuffix(word)) * length / period


def with_momentum(state: State, momentum: float) -> State:
    """The state with another momentum for the channel on screen; raises what FilterParams raises."""
    return state if momentum == state.tuning.momentum else state.with_tuning(momentum=momentum, how="by hand")


def add_momentum(state: State) -> State:
    """Begin with a momentum as long as the lag, to two digits; a slider can then find a better one."""
    lag = steady_state(state.tuning.params).lag_samples
    return with_momentum(state, float(f"{min(max(lag, 1.0), MAX_MOMENTUM):.1e}"))


def momentum_words(momentum: float, period: float | None) -> str:
    """A momentum as a time, or in samples where the sample period (s) is not known; "off" for none."""
    return lag_text(momentum, period) if momentum > 0.0 else OFF


# Changes of the chain of filters that a channel runs in place of the Kalman filter alone.


MEDIANS = ("off", "3 samples", "5 samples")
"""Medians that may be chosen as the first filter, in the words on screen."""


def median_words(window: int) -> str:
    """A median of `window` samples as the menu names it."""
    return "off" if window == 1 else f"{window} samples"


@requested
def use_chain(state: State, chain: Chain) -> State:
    """The channel on screen runs this chain; its q and r stay."""
    state.require_one_channel()
    if state.tuning.chain == chain:
        return state
    after = state.with_standard_filter().with_tuning(chain=chain)
    words = f"{chain.words[:1].upper()}{chain.words[1:]}"
    return after.with_answers(note=f"{words} runs now; Undo reverts it.")


def use_kalman_filter(state: State) -> State:
    """The Kalman filter alone again, at the q and r that it had."""
    return state.with_standard_filter()


@requested
def set_median(state: State, words: str) -> State:
    """Put a median before the filter that runs, or none."""
    chain = state.tuning.chain
    if words == median_words(1 if chain is None else chain.median):
        return state
    if words not in MEDIANS:
        raise BadSetting(f"the median must be one of {', '.join(MEDIANS)} (got {words[:40]!r})")
    then, off = None if chain is None else chain.then, words == "off"
    window = 1 if off else int(words.partition(" ")[0])
    return state.with_tuning(chain=None if off and then is None else Chain(window, then))


# Changes of the channels: which is on screen, which are linked, whose settings are copied.


@requested
def select_channel(state: State, name: str) -> State:
    """Show another channel, with its own parameters, or the fused value."""
    fusion = state.settings.fusion
    fused = fusion is not None and name == fusion.tuning.name
    if not fused:
        state.recording.index(name)
    if fused is (state.fusion is not None) and (fused or name == state.channel):
        return state
    state = state.with_open(channel=state.channel if fused else name, fused=fused).with_reset_view()
    state = state if fused else with_first_answer(state)
    return state.with_answers(outcome=None, note="")


def channel_named(recording: Recording, text: str) -> str:
    """A channel by its name, or by its number from 1 where no channel is called so."""
    number = int(text) if text.isascii() and text.isdecimal() and len(text) < 6 else 0
    if text not in recording.names and 1 <= number <= len(recording.names):
        return recording.names[number - 1]
    return text


@requested
def set_link(state: State, link: str) -> State:
    """Tune this channel alone or all together; all then take the present one's setting at once."""
    if link not in LINKS:
        raise BadSetting(f"the way of tuning channels must be one of {', '.join(LINKS)} (got {link[:40]!r})")
    own = state.settings.tunings[state.index]  # not the fused value, which may be on screen
    return state.with_settings(link=link).with_tuning_of(state.index, own).with_answers(note="")


@requested
def set_board_channel(state: State, name: str | None) -> State:
    """Say which channel is the board's own filtered curve; None: there is none."""
    if name is not None:
        state.recording.index(name)
    return state if name == state.board else state.with_open(board_choice=name)


# Changes of the fused filter: sensors are fused, one drops out, its noise or its offset changes.


def candidates(state: State) -> tuple[str, ...]:
    """Channels of the quantity on screen, in their order: those of its unit, without the board's own curve.

    Of too many the first ones and the one on screen; sensors that are already fused are always included.
    """
    recording, fusion = state.recording, state.settings.fusion
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
    return apply_fusion(recording, sensors, found.params, "maximum likelihood", found)(state)


@requested
def apply_fusion(
    state: State,
    recording: Recording,
    sensors: tuple[str, ...],
    params: FilterParams,
    how: str,
    estimate: Estimate | None = None,
) -> State:
    """Sensors are fused: their filter is on screen, if their recording still is."""
    if not state.continues(recording):
        note = "The sensors were fused after another recording was opened; nothing was changed."
        return state.with_answers(note=note)
    unit = recording.units[recording.index(sensors[0])]
    tuning = ChannelTuning.of_params(name_of_fused(recording), unit, params, how, sensors)
    return state.with_fusion(Fusion(tuning, tuning, estimate=estimate)).with_reset_view()


def stop_fusing(state: State) -> State:
    """The channel's own filter again; Undo brings the fused one back."""
    return state if state.settings.fusion is None else state.with_fusion(None).with_reset_view()


@requested
def set_taking_part(state: State, sensor: str, takes_part: bool) -> State:
    """A sensor drops out, or is taken in again."""
    fusion = _of(state, sensor)
    return state if fusion is None else state.with_fusion(fusion.with_taking_part(sensor, bool(takes_part)))


@requested
def set_sensor_text(state: State, sensor: str, name: str, text: str) -> State:
    """An exact r or offset of a sensor was typed."""
    fusion = _of(state, sensor)
    if fusion is None:
        return state
    value = 0.0 if name == "offset" and not text.strip() else typed_number(f"{name} of {sensor[:40]}", text)
    same = getattr(fusion.tuning, name)[fusion.tuning.sensors.index(sensor)] == value
    return state if same else state.with_fusion(fusion.with_sensor(sensor, **{name: value}))


def _of(state: State, sensor: str) -> Fusion | None:
    """The fused filter, if it has this sensor."""
    fusion = state.settings.fusion
    return fusion if fusion is not None and sensor in fusion.tuning.sensors else None


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
    if order not in ORDERS:
        raise BadSetting(f"sort by must be one of {', '.join(ORDERS)} (got {str(order)[:40]!r})")
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
        return state.with_answers(note=f"{name} has no q and r: {one_line(fleet.devices.reasons[i])[:200]}.")
    after = adapted(state, device_tuning(fleet, i))
    return after.with_answers(note=f"{name} at its own filter. {after.answers.note}".strip())


# Changes of the pinned settings.


PARAMETERS = ("q", "r", "momentum", "p0", "x0", "gate", "chain")
"""What a setting consists of."""


def pin_present(state: State) -> State:
    """Keep the present setting of the channel on screen as a variant, under the first free letter."""
    state.require_one_channel()
    if state.tuning.paper is not None:
        raise BadSetting("the Khan et al. filter has no q and r, so it cannot be pinned")
    same = next((one for one in state.variants if one.tuning.filter == state.filter), None)
    if same is not None:
        raise BadSetting(f"this setting is pinned already, as {same.name}")
    pin = pinned(state.tuning, state.variants)
    return state.with_settings(pins=(*state.settings.pins, pin)).with_answers(note="")


@requested
def use_variant(state: State, name: str) -> State:
    """The present setting becomes that of a variant."""
    tuning = _variant(state, name).tuning
    values = {key: getattr(tuning, key) for key in PARAMETERS}
    return state.with_standard_filter().with_tuning(**values, how=tuning.how)


@requested
def delete_variant(state: State, name: str) -> State:
    """Forget a variant; its letter and colour are free again."""
    gone = _variant(state, name)
    return state.with_settings(pins=tuple(one for one in state.settings.pins if one is not gone))


def _variant(state: State, name: str) -> Variant:
    for variant in state.variants:
        if variant.name == name:
            return variant
    choices = ", ".join(variant.name for variant in state.variants) or "none, nothing is pinned"
    raise BadSetting(f"variant must be one of {choices} (got {name[:40]!r})")


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
    live = replace(state.live, following=False) if state.live else None  # the user looks back
    same = window == state.view.window and live == state.live
    return state if same else replace(state.with_view(window=window), live=live)


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
    if method not in methods:
        raise BadSetting(f"the way to find q and r must be one of {', '.join(methods)} (got {str(method)[:40]!r})")
    return state.with_view(search_method=method)


# Settings to begin with, each with a reason of one line: by lag, and those of two source documents. Pure.


# Changes that a piece of advice asks for, where no search is needed.


FOR_NOISE, FOR_LAG = "data sheet σ, fit q", "maximum lag"
"""The search methods that ask for the noise of the sensor, and for a lag."""


@requested
def change_for(state: State, action: actions.Action, judged: State) -> State:
    """What an action does to the filter that was judged; nothing on another recording or channel.

    The values are those of the judged filter, so that two clicks do no more than one.
    """
    return _applied(action, state, judged) if is_same_signal(state, judged) else state


def is_same_signal(state: State, judged: State) -> bool:
    """Whether the channel that was judged is still on screen."""
    return state.continues(judged.recording) and state.channel == judged.channel


def _applied(action: actions.Action, state: State, judged: State) -> State:
    q, r = judged.tuning.q, judged.tuning.r
    match action:
        case actions.Scale(q_factor, r_factor):
            chosen = (
                q_factor == r_factor and request_in(judged.tuning.how, r) is not None
            )  # q/r stays, and so does a goal
            how = judged.tuning.how if chosen else "by hand"
            state = state.with_tuning(q=_rounded(q * q_factor), r=_rounded(r * r_factor), how=how)
        case actions.SetGate(sigma):
            state = state.with_tuning(gate=None if sigma is None else sigma * sigma)
        case actions.UnsetStart():
            state = set_automatic_start(True)(state)
        case actions.GiveNoise():
            state = state.with_view(search_method=FOR_NOISE)
        case actions.ChooseFilter():
            state = state.with_view(search_method=FOR_LAG)
        case _:
            pass
    return state


def _rounded(value: float) -> float:
    """To three digits, as a slider sets it."""
    return float(f"{value:.2e}")


# A tuning file loaded in the dashboard: its q, r, p0 … become those of what is open.


ENDING = ".toml"
"""What the name of a tuning file ends with; every other file is a recording."""

MAX_BYTES = 1_000_000
"""Bytes of an uploaded tuning file, at most; one of a thousand channels has 200 kB."""


def uploaded_settings(name: str, content: bytes) -> Tuning:
    """What an uploaded tuning file holds.

    Raises:
        BadFile: it is not a tuning file.
    """
    if len(content) > MAX_BYTES:
        raise BadFile(f"{name!r} must be a tuning file of at most 1 MB (got {len(content)} bytes)")
    try:
        return loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise BadFile(f"{name!r} must be a tuning file in UTF-8 (got other bytes)") from None
    except BadFile as error:
        raise BadFile(f"{name!r}: {error}") from None


@requested
def use_settings(state: State, tuning: Tuning, name: str) -> State:
    """The values of a file, called `name`, become those of the channels of the same names; one undoable change."""
    after = adapted(state, tuning)
    note = f"Loaded {one_line(name)[:80]}. {after.answers.note}".strip()
    return after.with_answers(note=note)


@requested
def as_it_was_left(state: State, tuning: Tuning) -> State:
    """The filters that this file had when it was last open, unless others than the starting values are set now."""
    settings = state.settings
    if state.recording.source != tuning.source or settings.tunings != settings.starts:
        return state
    try:
        after = adapted(state, tuning)
    except BadSetting:  # the file has other channels now
        return state
    # Older versions also kept filters that nobody had changed.
    pairs = zip(settings.tunings, after.settings.tunings, strict=True)
    tunings = tuple(now if kept.how == "starting values" else kept for now, kept in pairs)
    after = after.with_settings(tunings=tunings)
    if (after.settings.tunings, after.settings.fusion) == (settings.tunings, settings.fusion):
        return state
    if state.channel != default_channel(state.recording):  # chosen on the command line
        after = after.with_open(channel=state.channel)
    note = f"The filter is as you left it: Undo gives the starting values. {after.answers.note}".strip()
    return after.with_answers(note=note)
