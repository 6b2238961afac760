"""Changes of the fused filter: sensors are fused, one drops out, its noise or its offset changes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from kalscope.common.text import typed_number
from kalscope.errors import BadSetting
from kalscope.filtering.params import FilterParams
from kalscope.recording import Recording
from kalscope.tuning.choose import name_of_fused
from kalscope.tuning.tuning import ChannelTuning
from kalscope_app.session.changes.parameters import DECADES
from kalscope_app.session.fusion import MAX_SENSORS, MIN_SENSORS, Fusion
from kalscope_app.session.state import Change, State

if TYPE_CHECKING:
    from kalscope.estimation.fusion.result import FusionEstimate


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


def apply_estimate(recording: Recording, sensors: tuple[str, ...], found: FusionEstimate) -> Change:
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
    estimate: FusionEstimate | None = None,
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
