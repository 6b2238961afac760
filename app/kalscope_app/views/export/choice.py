"""What the user chose to export, what will differ on the device, and the files to export. Pure."""

from __future__ import annotations

import io
import re
import zipfile
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from kalscope.common.text import decibels, duration, frequency, lag_text, number, plural, typed_number
from kalscope.errors import BadSetting
from kalscope.estimation.finding import Request
from kalscope.export.registry import TARGETS, export_tuning
from kalscope.export.write import in_sketch_folder, limits_of, sketch_name
from kalscope.filtering.steady_state import steady_state
from kalscope.tuning.device_period import meeting_goal, rescaled_to_period
from kalscope.tuning.paper_tuning import PaperTuning
from kalscope.tuning.tuning import Tuning, same_period
from kalscope_app.session.state import State
from kalscope_app.views.markdown import escape_markdown

TITLES = {target.title: name for name, target in TARGETS.items() if target.is_offered}
"""Targets by their names on screen."""
COMMON_TITLES = tuple(title for title, name in TITLES.items() if TARGETS[name].is_common)
"""Those that the list of targets begins with."""

UNEVEN = 0.5
"""Periods by which a time step must differ from one before a device would show it."""

MET = 1e-3
"""A goal that is missed by a smaller share is met."""

GAPS = (
    "On screen, gaps in time count. The code and the test vectors take one period per sample: pass a NaN to the "
    "device's filter for each missing sample."
)


@dataclass(frozen=True)
class Choice:
    """What the user chose to export."""

    target: str = "arduino"
    """A name of `TARGETS`."""
    all_channels: bool = False
    """Not only the channel on screen."""
    period: str = ""
    """Sample period of the device as it was typed, s; empty = that of the recording."""
    fixed_gains: bool = False
    """Only the settled filter, where the target has that choice."""
    calibration: bool = False
    """With a sketch that measures r itself, where the target has that choice."""
    goal: Request | None = None
    """What the channel on screen must meet at that period too, while that is its goal; None = q is converted."""


@dataclass(frozen=True)
class DeviceNotes:
    """The texts below the choice."""

    lag: str
    """The lag at the period of the device, markdown; "" where it is not known."""
    offer: str
    """Label of the button that meets the goal there, or undoes that; "" = no button."""
    limits: str
    """What will differ from the screen, markdown; "" where nothing does."""


def has_fixed_gains(target: str) -> bool:
    """Whether the settled filter alone can be exported to a target."""
    return TARGETS[target].fixed_gains is not None


def has_calibration(target: str) -> bool:
    """Whether a target has code that measures r itself."""
    return TARGETS[target].calibration is not None


def device_notes(state: State, choice: Choice = Choice()) -> DeviceNotes:
    """How the filter on screen will run on the device at this choice. A study."""
    lag = offer = ""
    if state.is_standard:
        with suppress(BadSetting):  # the limits say why
            lag, offer = _lag_notes(state, choice)
    return DeviceNotes(lag, offer, limits_text(state, choice))


def _lag_notes(state: State, choice: Choice) -> tuple[str, str]:
    tuning, here, goal = device_tuning(state, choice), state.recording.sample_period, goal_of(state)
    period = tuning.sample_period
    if period is None:
        return "", ""
    lag = _measured(tuning, state.channel, "lag_s")[1]
    if not choice.period.strip() or here is None or same_period(period, here):
        return f"Lag **{lag}** at {duration(period)} per sample, as recorded.", ""
    recorded = _measured(state.as_tuning(), state.channel, "lag_s")[1]
    text = f"Lag **{lag}** at {duration(period)} per sample; {recorded} as recorded."
    if goal is None:
        return text, ""
    ((name, wanted),) = goal.target.items()
    value, words = _measured(tuning, state.channel, name)
    if name != "lag_s":
        text += f" {GOALS[name].format(words)}"
    if choice.goal == goal:
        return text, "Use q as tuned"
    missed = abs(value - wanted) > MET * abs(wanted)
    return text, f"Meet {_in_words(name, wanted)} at this period" if missed else ""


GOALS = {"lag_samples": "{}.", "cutoff_hz": "Cut-off {}.", "noise_reduction_db": "Noise {}.", "gain": "{}."}
"""How the value of a goal is written beside the lag."""


def _measured(tuning: Tuning, channel: str, name: str) -> tuple[float, str]:
    """The value that a filter has for a goal, as a number and in words."""
    steady = steady_state(tuning.channel(channel).params, tuning.sample_period)
    if name == "lag_s":
        samples = steady.lag_samples
        return samples * (tuning.sample_period or 1.0), lag_text(samples, tuning.sample_period)
    value = float(getattr(steady, name))
    return value, _in_words(name, value)


def _in_words(name: str, value: float) -> str:
    return {
        "lag_s": duration(value),
        "lag_samples": plural(value, "sample"),
        "cutoff_hz": frequency(value),
        "noise_reduction_db": decibels(-value),
        "gain": f"gain {number(value)}",
    }[name]


def goal_of(state: State) -> Request | None:
    """The goal that the filter on screen was found for; None where there is no goal, or no longer one."""
    outcome = state.answers.outcome
    if outcome is None or outcome.after is None or outcome.request is None:
        return None
    return outcome.request if outcome.request.target else None


def limits_text(state: State, choice: Choice = Choice()) -> str:
    """What will differ from the screen, as markdown; "" where nothing does."""
    if isinstance(state.tuning, PaperTuning):
        return "There is no code for the Khan et al. filter: choose *Kalman filter* in the Tune tab."

    def level(name: str) -> float:
        z = state.recording.channel(name)
        return float(np.abs(z[np.isfinite(z)]).max(initial=0.0)) or 1.0

    try:
        files_of(state, choice)  # shows why an export would be refused before a button is pressed
        tuning = device_tuning(state, choice)
        limits = limits_of(tuning, None, choice.target, level, fixed_gains=choice.fixed_gains)
    except BadSetting as error:
        return f"Cannot export: {escape_markdown(str(error), 400)}"
    lines = [escape_markdown(f"{limit[:1].upper()}{limit[1:]}", 400) for limit in limits]
    if state.dt is not None and np.any(np.abs(state.dt - 1.0) > UNEVEN):
        lines.append(GAPS)
    return "\n".join(f"- {line}" for line in lines) if len(lines) > 1 else "".join(lines)


def files_of(state: State, choice: Choice, *, vectors: bool = False) -> dict[str, str]:
    """The files of a choice for what is on screen, by name; with the test vectors if asked for.

    Raises:
        BadSetting: As `export_tuning`, and where a channel has the Khan et al. filter.
    """
    recording = state.recording if vectors else None
    return export_tuning(
        device_tuning(state, choice),
        choice.target,
        vectors=recording,
        fixed_gains=choice.fixed_gains,
        calibration=choice.calibration,
    )


def device_tuning(state: State, choice: Choice) -> Tuning:
    """The tuning of the device: the chosen channels, or the sensors that are fused, at its period.

    Raises:
        BadSetting: The period is not valid, or a channel has the Khan et al. filter.
    """
    tuning = state.as_tuning()
    if state.fusion is not None:
        sensors = tuple(one for one in tuning.channels if one.name in state.measured)
        tuning = replace(tuning, channels=sensors, selected="")
    else:
        state.require_exportable(state.recording.names if choice.all_channels else [state.channel])
        tuning = replace(tuning.only(None if choice.all_channels else state.channel), fusion=None)
    if not choice.period.strip():
        return tuning
    period = typed_number("period", choice.period)
    if choice.goal is not None and choice.goal == goal_of(state):
        return meeting_goal(tuning, state.channel, choice.goal, period)
    return rescaled_to_period(tuning, period)


def toggled(choice: Choice, state: State) -> Choice:
    """The choice after a click on the button that meets the goal, or undoes that."""
    goal = goal_of(state)
    return replace(choice, goal=None if choice.goal == goal else goal)


def packed(target: str, files: dict[str, str]) -> tuple[str, bytes]:
    """Name and bytes of one download: one file as it is, several as a zip, a sketch in a folder of its name."""
    if len(files) == 1:
        name, text = next(iter(files.items()))
        return name, text.encode()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in in_sketch_folder(files).items():
            archive.writestr(zipfile.ZipInfo(name, (2000, 1, 1, 0, 0, 0)), text)
    title = sketch_name(files) or f"kalscope-{re.sub(r'[^a-z0-9]+', '-', target)}"
    return f"{title}.zip", buffer.getvalue()
