"""What a board measured, how that compares with the figure here, and what to do where it refused: in words."""

from __future__ import annotations

import math

import numpy as np

from kalscope.common.text import count, number, percent, plural, squared
from kalscope.export.board.calibration import Calibrated, NotCalibrated
from kalscope.export.board.measuring import Measurement

EQUAL_WITHIN = 0.01
"""Share up to which the two figures are called equal: what float32 and the board's one pass may cost."""

_ADVICE = (
    ("too short", "Measure for longer."),
    ("too long", "Measure for a shorter time."),
    ("no reading", "Is the sensor plugged in, and does the sketch read it in time?"),
    ("spikes in", "The level jumped, or the wiring picks up pulses: keep the sensor still and check its wires."),
    (
        "at an end of the range",
        "The input is saturated: change its level or amplification until the readings lie inside. If the"
        " converter has more than 10 bits, write its range into KALSCOPE_READINGS of the sketch.",
    ),
    (
        "nearly all readings are equal",
        "The input is stuck, or its noise is smaller than a step of the converter. Check it, write that step into"
        " KALSCOPE_READINGS of the sketch, or enter r by hand.",
    ),
    ("the level moves", "Keep what the sensor measures constant, let it warm up, and measure again."),
    ("the noise is uneven", "Something was moved or switched for a part of the time: measure again undisturbed."),
    (
        "neighbouring readings",
        "The input moves slowly or hums, or the sensor smooths already: keep it still, shield it from mains hum, or"
        " take fewer samples a second.",
    ),
    ("too few readings", "Measure for longer."),
    ("float32 cannot hold", "Tune in a unit in which the readings are neither tiny nor huge, and export again."),
)
"""Words of a refusal, and what to do about it."""


def found_text(answer: Calibrated, unit: str) -> str:
    """What a board found and uses now, in a sentence."""
    r, q = (f"{number(float(value), 4)} {squared(unit)}" for value in (answer.r, answer.q))
    used = [f"from {_samples(answer.samples)}"]
    used += [plural(answer.spikes, "spike") + " left out"] if answer.spikes else []
    used += [f"{count(answer.missing)} missing"] if answer.missing else []
    text = f"r = {r}, and for the lag of the export q = {q}; {', '.join(used)}."
    if answer.is_rounding:
        text += f" This is the rounding to steps of {_value(answer.step, unit)}: the readings hardly change."
    return text


def compared_text(measured: Measurement, unit: str) -> str:
    """How that compares with the same rule over the same samples here; "" where the board refused."""
    answer, here = measured.answer, measured.here
    if isinstance(answer, NotCalibrated):
        return ""
    board = math.sqrt(answer.r)
    if here is None:
        return (
            f"σ = {_value(board, unit)} on the board; the samples that it used did not all arrive here, so there is"
            " no figure to compare it with."
        )
    ours = math.sqrt(here.r)
    share = abs(board / ours - 1.0)
    how = f"equal within {_rounded_up(share)}" if share <= EQUAL_WITHIN else f"they differ by {percent(share)}"
    where = "here" if measured.lost else "here from the same samples"
    text = f"σ = {_value(board, unit)} on the board, {_value(ours, unit)} {where}: {how}."
    if measured.lost:
        text += f" {_samples(measured.lost)} of the board did not arrive here, so the two differ in their samples."
    return text


def refusal_text(answer: NotCalibrated) -> str:
    """Why a board kept its values, and what to do."""
    reason = answer.reason
    if reason == "cancelled":
        return "The measurement was cancelled: the board keeps its values."
    advice = next((advice for words, advice in _ADVICE if words in reason), "")
    return f"The board keeps its values: {reason}. {advice}".rstrip()


def _value(value: float | np.float32, unit: str) -> str:
    return f"{number(float(value), 4)}{' ' if unit else ''}{unit}"


def _samples(n: int) -> str:
    return f"{count(n)} sample{'' if n == 1 else 's'}"


def _rounded_up(share: float) -> str:
    """A share to one digit, never below what it is: 0.3 %."""
    percents = max(100.0 * share, 0.001)
    power = 10.0 ** math.floor(math.log10(percents))
    return f"{math.ceil(percents / power - 1e-9) * power:.1g} %"
