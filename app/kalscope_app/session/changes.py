"""Changes of the State that the user asks for: pure functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING

from kalscope.analysis import actions
from kalscope.analysis.channel_kinds import default_channel
from kalscope.analysis.findings import request_in
from kalscope.common.text import TIME_UNITS, lag_text, one_line, typed_gate, typed_number
from kalscope.errors import BadFile, BadSetting
from kalscope.estimation.fit import params_for_specification
from kalscope.estimation.result import Estimate
from kalscope.filtering.classic import Chain
from kalscope.filtering.params import MAX_MOMENTUM, MAX_VARIANCE, FilterParams
from kalscope.filtering.steady import ratio_for, steady_state
from kalscope.papers.generalized import GeneralizedParams
from kalscope.papers.interactive_matter_2009 import ASSUMED_R, WALK
from kalscope.papers.maarif_2019 import SIMULATED_FIGURES
from kalscope.recording import Recording
from kalscope.tuning.choose import name_of_fused
from kalscope.tuning.file import loads
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.session.opening import adapted, with_sample_period
from kalscope_app.session.state import (
    COLOURS,
    LINKS,
    MAP_COLOURS,
    MAX_SENSORS,
    MIN_SENSORS,
    ORDERS,
    Change,
    Fusion,
    OpenFleet,
    Outcome,
    State,
    Variant,
    checked_name,
    pinned,
    scaled_copy,
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
    centre = round(math.log10(state.start.r))
    low, high = (centre + end for end in DECADES[name])
    value = getattr(state.tuning, name)
    if value:
        low, high = min(low, math.floor(math.log10(value))), max(high, math.ceil(math.log10(value)))
    return max(low, -300), min(high, 300)


def set_exponent(name: str, exponent: float) -> Change:
    """A slider was moved: q, r or p0 becomes 10^exponent; moving p0 means a start by value."""

    def change(state: State) -> State:
        if not math.isfinite(exponent):
            return state
        low, high = slider_limits(state, name)
        value = 10.0 ** min(max(exponent, low), high)
        return _by_hand(state, name, float(f"{value:.2e}"))  # three digits suit a slider

    return change


def set_point(q_exponent: float, r_exponent: float) -> Change:
    """A point of the tuning map was chosen: q and r become 10^exponent, to three digits."""

    def change(state: State) -> State:
        if not state.is_standard or not (math.isfinite(q_exponent) and math.isfinite(r_exponent)):
            return state
        q, r = (float(f"{10.0 ** min(max(e, -300.0), 299.9):.2e}") for e in (q_exponent, r_exponent))
        return state if (q, r) == (state.tuning.q, state.tuning.r) else state.with_tuning(q=q, r=r, how="by hand")

    return change


def set_text(name: str, text: str) -> Change:
    """An exact value was typed: q, r, p0 (or "", "diffuse": automatic), x0 (or "": the first sample), gate in σ."""

    def change(state: State) -> State:
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

    return change


def _by_hand(state: State, name: str, value: float) -> State:
    """One parameter set by hand; only q, r and the momentum have a history that this ends."""
    how = "by hand" if name in ("q", "r") else state.tuning.how
    return state.with_tuning(**{name: value}, how=how)


def set_automatic_start(automatic: bool) -> Change:
    """Automatic (diffuse) start at the first sample, or p0 and x0 by value, beginning with p0 = r."""

    def change(state: State) -> State:
        if automatic == (state.tuning.p0 is None):
            return state
        return state.with_tuning(p0=None if automatic else max(state.tuning.r, 1e-300), x0=None)

    return change


def reset_parameters(state: State) -> State:
    """Back to the starting values of the channel, or to those of the fused sensors."""
    if state.fusion is not None:
        return state.with_fusion(state.fusion.reset)
    start = state.start
    values = {name: getattr(start, name) for name in (*PARAMETERS, "how")}
    return state.with_tuning(**values)


def apply_found(recording: Recording, channel: str, found: FitResult) -> Change:
    """A search has ended: its q, r, momentum and gate become the channel's, if the channel is still there."""

    def change(state: State) -> State:
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
        gate = before.gate if found.params.gate is None else found.params.gate
        after = replace(before, q=q, r=r, momentum=momentum, gate=gate, how=found.how, chain=None, paper=None)
        answer = Outcome(found.how, found.message, before, after, found.estimate, found.request)
        outcome = answer if channel == state.channel else None
        return state.with_tuning_of(at, after).with_answers(outcome=outcome)

    return change


def set_method_comparison(recording: Recording, channel: str, estimates: tuple[Estimate, ...]) -> Change:
    """The three methods have given their estimates."""

    def change(state: State) -> State:
        same = state.continues(recording) and state.channel == channel
        return state.with_answers(method_comparison=estimates) if same else state

    return change


def paper_filter(state: State) -> GeneralizedParams | None:
    """The Khan et al. filter, where the channel on screen runs it."""
    return state.filter if isinstance(state.filter, GeneralizedParams) else None


def set_variant_of_eq3(variant: str | None) -> Change:
    """Filter with the equations of Khan et al., "printed" or "without_slip", or with the standard filter (None)."""

    def change(state: State) -> State:
        paper = paper_filter(state)
        if variant is None:
            return state.with_standard_filter()
        if paper is None:
            return use_paper_filter(state, GeneralizedParams(max(state.tuning.r, 1e-290), None, None, variant))
        return state if paper.reading == variant else use_paper_filter(state, replace(paper, reading=variant))

    return change


def use_paper_filter(state: State, paper: GeneralizedParams) -> State:
    """The state with the filter of Khan et al. for the channel on screen."""
    tunings, at = state.settings.tunings, state.index  # linked channels follow q and r, not the filter
    tunings = (*tunings[:at], replace(tunings[at], chain=None, paper=paper), *tunings[at + 1 :])
    return state.with_settings(tunings=tunings).with_answers(outcome=None, note="")


def set_paper_text(name: str, text: str) -> Change:
    """A value of the Khan et al. filter was typed: sigma_m, sigma_e0 or e0; empty is automatic."""

    def change(state: State) -> State:
        paper = paper_filter(state)
        if paper is None:
            return state
        empty = name != "sigma_m" and text.strip().lower() in ("", "automatic")
        value = None if empty else typed_number(name, text)
        return use_paper_filter(state, replace(paper, **{name: value}))

    return change


def set_sample_period(text: str) -> Change:
    """The time between two samples was typed, s; an empty box is what the recording says."""

    def change(state: State) -> State:
        period = typed_number("sample period", text) if text.strip() else None
        return state if period == state.open.typed_period else with_sample_period(state, period)

    return change


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


def set_momentum_position(position: float) -> Change:
    """The slider was moved."""
    return lambda state: with_momentum(state, momentum_at(position)) if math.isfinite(position) else state


def set_momentum_text(_name: str, text: str) -> Change:
    """A momentum was typed: samples, or a time such as 240 ms; empty or "off" is none."""

    def change(state: State) -> State:
        return with_momentum(state, typed_momentum(text, state.recording.sample_period))

    return change


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


def use_chain(chain: Chain) -> Change:
    """The channel on screen runs this chain; its q and r stay."""

    def change(state: State) -> State:
        state.require_one_channel()
        if state.tuning.chain == chain:
            return state
        after = state.with_standard_filter().with_tuning(chain=chain)
        words = f"{chain.words[:1].upper()}{chain.words[1:]}"
        return after.with_answers(note=f"{words} runs now; Undo reverts it.")

    return change


def use_kalman_filter(state: State) -> State:
    """The Kalman filter alone again, at the q and r that it had."""
    return state.with_standard_filter()


def set_median(words: str) -> Change:
    """Put a median before the filter that runs, or none."""

    def change(state: State) -> State:
        chain = state.tuning.chain
        if words == median_words(1 if chain is None else chain.median):
            return state
        if words not in MEDIANS:
            raise BadSetting(f"the median must be one of {', '.join(MEDIANS)} (got {words[:40]!r})")
        then, off = None if chain is None else chain.then, words == "off"
        window = 1 if off else int(words.partition(" ")[0])
        return state.with_tuning(chain=None if off and then is None else Chain(window, then))

    return change


# Changes of the channels: which is on screen, which are linked, whose settings are copied.


ALL_OTHERS = "all other channels"


def select_channel(name: str) -> Change:
    """Show another channel, with its own parameters, or the fused value."""

    def change(state: State) -> State:
        fusion = state.settings.fusion
        fused = fusion is not None and name == fusion.tuning.name
        if not fused:
            state.recording.index(name)
        if fused is (state.fusion is not None) and (fused or name == state.channel):
            return state
        state = state.with_open(channel=state.channel if fused else name, fused=fused).with_reset_view()
        return state.with_answers(outcome=None, method_comparison=(), note="")

    return change


def channel_named(recording: Recording, text: str) -> str:
    """A channel by its name, or by its number from 1 where no channel is called so."""
    number = int(text) if text.isascii() and text.isdecimal() and len(text) < 6 else 0
    if text not in recording.names and 1 <= number <= len(recording.names):
        return recording.names[number - 1]
    return text


def set_link(link: str) -> Change:
    """Tune this channel alone or all together; all then take the present one's setting at once."""
    if link not in LINKS:
        raise BadSetting(f"the way of tuning channels must be one of {', '.join(LINKS)} (got {link[:40]!r})")

    def change(state: State) -> State:
        return state.with_settings(link=link).with_tuning_of(state.index, state.tuning).with_answers(note="")

    return change


def copy_setting(to: str) -> Change:
    """Copy the numbers of the channel on screen to another channel, or to all others."""

    def change(state: State) -> State:
        names, settings = state.recording.names, state.settings
        targets = [name for name in names if name != state.channel] if to == ALL_OTHERS else [to]
        chosen = {state.recording.index(name) for name in targets}
        tunings = tuple(
            scaled_copy(state.tuning, own) if i in chosen and names[i] != state.channel else own
            for i, own in enumerate(settings.tunings)
        )
        where = f"{len(chosen)} channels" if len(chosen) > 1 else "one channel"
        same = tunings == settings.tunings
        note = "" if same else f"The setting of {state.channel} was copied to {where}."
        return state.with_settings(tunings=tunings).with_answers(note=note)

    return change


def set_board_channel(name: str | None) -> Change:
    """Say which channel is the board's own filtered curve; None: there is none."""

    def change(state: State) -> State:
        if name is not None:
            state.recording.index(name)
        return state if name == state.board else state.with_open(board_choice=name)

    return change


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


def apply_estimate(recording: Recording, sensors: tuple[str, ...], found: Estimate) -> Change:
    """A search has ended: its filter is on screen, if it found one and the recording still is."""

    def change(state: State) -> State:
        if found.params is None:
            raise BadSetting(found.message)
        return apply_fusion(recording, sensors, found.params, "maximum likelihood", found)(state)

    return change


def apply_fusion(
    recording: Recording,
    sensors: tuple[str, ...],
    params: FilterParams,
    how: str,
    estimate: Estimate | None = None,
) -> Change:
    """Sensors are fused: their filter is on screen, if their recording still is."""

    def change(state: State) -> State:
        if not state.continues(recording):
            note = "The sensors were fused after another recording was opened; nothing was changed."
            return state.with_answers(note=note)
        unit = recording.units[recording.index(sensors[0])]
        tuning = ChannelTuning.of_params(name_of_fused(recording), unit, params, how, sensors)
        return state.with_fusion(Fusion(tuning, tuning, estimate=estimate)).with_reset_view()

    return change


def stop_fusing(state: State) -> State:
    """The channel's own filter again; Undo brings the fused one back."""
    return state if state.settings.fusion is None else state.with_fusion(None).with_reset_view()


def set_taking_part(sensor: str, takes_part: bool) -> Change:
    """A sensor drops out, or is taken in again."""

    def change(state: State) -> State:
        fusion = _of(state, sensor)
        return state if fusion is None else state.with_fusion(fusion.with_taking_part(sensor, bool(takes_part)))

    return change


def set_sensor_exponent(sensor: str, exponent: float) -> Change:
    """The slider of a sensor's noise was moved: its r becomes 10^exponent, to three digits."""

    def change(state: State) -> State:
        fusion = _of(state, sensor)
        if fusion is None or not math.isfinite(exponent):
            return state
        low, high = sensor_limits(fusion, sensor)
        return _with(state, fusion, sensor, "r", float(f"{10.0 ** min(max(exponent, low), high):.2e}"))

    return change


def set_sensor_text(sensor: str, name: str, text: str) -> Change:
    """An exact r or offset of a sensor was typed."""

    def change(state: State) -> State:
        fusion = _of(state, sensor)
        if fusion is None:
            return state
        value = 0.0 if name == "offset" and not text.strip() else typed_number(f"{name} of {sensor[:40]}", text)
        return _with(state, fusion, sensor, name, value)

    return change


def sensor_limits(fusion: Fusion, sensor: str) -> tuple[int, int]:
    """Lowest and highest exponent of the slider of a sensor's r: around what was found, wider if r is outside."""
    at = fusion.tuning.sensors.index(sensor)
    found, now = fusion.start.r[at], fusion.tuning.r[at]
    centre = round(math.log10(found)) if found > 0.0 else 0
    low, high = (centre + end for end in DECADES["r"])
    if now > 0.0:
        low, high = min(low, math.floor(math.log10(now))), max(high, math.ceil(math.log10(now)))
    return max(low, -300), min(high, 300)


def _of(state: State, sensor: str) -> Fusion | None:
    """The fused filter, if it has this sensor."""
    fusion = state.settings.fusion
    return fusion if fusion is not None and sensor in fusion.tuning.sensors else None


def _with(state: State, fusion: Fusion, sensor: str, name: str, value: float) -> State:
    at = fusion.tuning.sensors.index(sensor)
    if getattr(fusion.tuning, name)[at] == value:
        return state
    return state.with_fusion(fusion.with_sensor(sensor, **{name: value}))


# Changes of the open fleet, and the step from one of its devices to the recording on screen.


MAX_FIND = 200
"""Characters of a text to find, at most."""


def open_fleet(fleet: Fleet) -> Change:
    """Open a fleet, and the map, which shows its devices."""
    return lambda state: replace(state.with_view(map_shown=True), fleet=OpenFleet(fleet))


def close_fleet(state: State) -> State:
    """Close the fleet."""
    return replace(state, fleet=None)


def set_fleet_order(order: str) -> Change:
    """Sort the devices in another way."""
    if order not in ORDERS:
        raise BadSetting(f"sort by must be one of {', '.join(ORDERS)} (got {str(order)[:40]!r})")
    return lambda state: state if state.fleet is None else replace(state, fleet=replace(state.fleet, order=order))


def set_fleet_colour(colour: str) -> Change:
    """Colour the devices by another measure."""
    if colour not in COLOURS:
        raise BadSetting(f"devices coloured by must be one of {', '.join(COLOURS)} (got {str(colour)[:40]!r})")
    return lambda state: state if state.fleet is None else replace(state, fleet=replace(state.fleet, colour=colour))


def find_devices(text: str) -> Change:
    """List the devices whose names contain a text."""
    wanted = one_line(str(text))[:MAX_FIND].strip()
    return lambda state: state if state.fleet is None else replace(state, fleet=replace(state.fleet, find=wanted))


def pick_device(i: int | None) -> Change:
    """Show which device a point of the map is; None: none is picked."""
    return lambda state: state if state.fleet is None else replace(state, fleet=replace(state.fleet, picked=i))


def set_at_shared(chosen: bool) -> Change:
    """Open devices at the filter for all, or each at its own."""

    def change(state: State) -> State:
        return state if state.fleet is None else replace(state, fleet=replace(state.fleet, at_shared=bool(chosen)))

    return change


def at_device(fleet: Fleet, i: int) -> Change:
    """Set the recording of a device, which has just been opened, to its own filter or to that for all.

    A device without q and r keeps its starting values; the note says why.
    """
    from kalscope.fleet.results import device_tuning

    def change(state: State) -> State:
        name = one_line(fleet.devices.name(i))[:80]
        shared = fleet.shared is not None and state.fleet is not None and state.fleet.at_shared
        if not shared and fleet.devices.reasons[i]:
            return state.with_answers(note=f"{name} has no q and r: {one_line(fleet.devices.reasons[i])[:200]}.")
        after = adapted(state, device_tuning(fleet, i, shared=shared))
        which = "the filter for all" if shared else "its own filter"
        if after.fleet is not None and after.fleet.picked is not None:
            after = replace(after, fleet=replace(after.fleet, picked=None))
        return after.with_answers(note=f"{name} at {which}. {after.answers.note}".strip())

    return change


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


def use_variant(name: str) -> Change:
    """The present setting becomes that of a variant."""

    def change(state: State) -> State:
        tuning = _variant(state, name).tuning
        values = {key: getattr(tuning, key) for key in PARAMETERS}
        return state.with_standard_filter().with_tuning(**values, how=tuning.how)

    return change


def rename_variant(name: str, new: str) -> Change:
    """Rename a variant."""

    def change(state: State) -> State:
        variant = _variant(state, name)
        bare = checked_name(new, (one.name for one in state.variants if one is not variant))
        return _variants_with(state, variant, (replace(variant, name=bare),))

    return change


def delete_variant(name: str) -> Change:
    """Forget a variant; its letter and colour are free again."""
    return lambda state: _variants_with(state, _variant(state, name), ())


def _variant(state: State, name: str) -> Variant:
    for variant in state.variants:
        if variant.name == name:
            return variant
    choices = ", ".join(variant.name for variant in state.variants) or "none, nothing is pinned"
    raise BadSetting(f"variant must be one of {choices} (got {name[:40]!r})")


def _variants_with(state: State, old: Variant, new: tuple[Variant, ...]) -> State:
    pins = state.settings.pins
    at = next(i for i, one in enumerate(pins) if one is old)
    return state.with_settings(pins=(*pins[:at], *new, *pins[at + 1 :])).with_answers(note="")


# Changes of the view: the window, the theme, the map, what is drawn beside the signal.


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


# Settings to begin with, each with a reason of one line: by lag, and those of two source documents. Pure.


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


def take_preset(title: str) -> Change:
    """Q, r and momentum of a preset become the present ones; the start and the gate stay."""
    preset = _known(title)

    def change(state: State) -> State:
        params = preset.params(state)
        values = {name: getattr(params, name) for name in ("q", "r", "momentum")}
        return state.with_standard_filter().with_tuning(**values, how=f"preset {preset.title}")

    return change


def _known(title: str) -> Preset:
    if title not in PRESETS:
        raise BadSetting(f"preset must be one of {', '.join(PRESETS)} (got {title[:40]!r})")
    return PRESETS[title]


# Changes that a piece of advice asks for, where no search is needed.


FOR_NOISE, FOR_LAG = "data sheet σ, fit q", "maximum lag"
"""The search methods that ask for the noise of the sensor, and for a lag."""


def change_for(action: actions.Action, judged: State) -> Change:
    """What an action does to the filter that was judged; nothing on another recording or channel.

    The values are those of the judged filter, so that two clicks do no more than one.
    """

    def change(state: State) -> State:
        return _applied(action, state, judged) if is_same_signal(state, judged) else state

    return change


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


def use_settings(tuning: Tuning, name: str) -> Change:
    """The values of a file become those of the channels of the same names; one undoable change.

    Args:
        tuning: what the file holds.
        name: what it is called.
    """

    def change(state: State) -> State:
        after = adapted(state, tuning)
        note = f"Loaded {one_line(name)[:80]}. {after.answers.note}".strip()
        return after.with_answers(note=note)

    return change


def as_it_was_left(tuning: Tuning) -> Change:
    """The filters that this file had when it was last open, unless others than the starting values are set now."""

    def change(state: State) -> State:
        settings = state.settings
        if state.recording.source != tuning.source or settings.tunings != settings.starts:
            return state
        try:
            after = adapted(state, tuning)
        except BadSetting:  # the file has other channels now
            return state
        if (after.settings.tunings, after.settings.fusion) == (settings.tunings, settings.fusion):
            return state
        if state.channel != default_channel(state.recording):  # chosen on the command line
            after = after.with_open(channel=state.channel)
        note = f"The filter is as you left it: Undo gives the starting values. {after.answers.note}".strip()
        return after.with_answers(note=note)

    return change
