"""What is said about the sampling of a recording: its rate, how sure it is, its pauses."""

from __future__ import annotations

from dataclasses import replace

from kalscope.common.text import count, duration, percent, sample_rate
from kalscope.recording import Gaps, Timing

_STAMPS = {
    "even": "",
    "uneven": " from uneven stamps",
    "bursts": " from stamps that come in bursts",
    "coarse": " from stamps of a coarse clock",
}
_SURE = 1e-4
"""A standard error below this share of the rate is not reported."""
_ALIKE = 0.02
"""Rates of the file and of the stamps that differ by more contradict each other."""


def with_words(
    timing: Timing, usual: tuple[float, float] | None, stated: float | None, gaps: Gaps, n: int
) -> Timing:
    """The timing with its summary and its notes.

    Args:
        timing: The facts.
        usual: Between which nine of ten steps lie, in s; None where nothing is said about them.
        stated: Sample period in s that the file states; None where it states none.
        gaps: How gaps are to be read.
        n: Samples, the missing ones left out.
    """
    notes = [*_about_stamps(timing, usual), *_about_stated(timing, stated), *_about_pauses(timing, gaps, n)]
    return replace(timing, summary=_summary(timing), notes=tuple(notes))


def _summary(timing: Timing) -> str:
    if timing.period is None:
        return ""
    rate = sample_rate(timing.period)
    if timing.source == "option":
        return f"{rate} as requested"
    if timing.source == "file":
        return f"{rate} as stated in the file"
    return f"{rate}{_STAMPS[timing.stamps]}{_sure(timing)}"


def _sure(timing: Timing) -> str:
    error = timing.error
    return f", standard error {percent(error)}" if error is not None and error > _SURE else ""


def _about_stamps(timing: Timing, usual: tuple[float, float] | None) -> list[str]:
    period, steps = timing.stamps_period, ""
    if period is None:
        return []
    rate = f"{sample_rate(period)}{_sure(timing)}"
    if usual is not None:
        steps = f"nine of ten steps lie between {usual[0]:.6g} and {usual[1]:.6g} s"
    if timing.stamps == "coarse":
        clock = f"the clock has a resolution of {duration(timing.resolution)}"
        return [f"{clock}: samples were placed evenly between its steps, {rate}"]
    if timing.stamps == "bursts":
        return [f"the stamps come in bursts: samples were placed evenly in time, {rate}"]
    said: list[str] = []
    if timing.error is None:
        said = [f"the stamps show no steady rate: the sample period, {period:.6g} s, is the median step"]
    elif timing.stamps == "uneven":
        said = [f"the stamps are uneven, {rate}"]
    return [": ".join((*said, steps))] if said and steps else said


def _about_stated(timing: Timing, stated: float | None) -> list[str]:
    own = timing.stamps_period
    if stated is None or own is None or timing.source == "option":
        return []
    if timing.source == "file":
        return [f"the sample rate is the one that the file gives, {sample_rate(stated)}"]
    if abs(stated - own) <= _ALIKE * own:
        return []
    return [
        f"the file gives a sample rate of {sample_rate(stated)}, but its stamps give {sample_rate(own)}: the stamps"
        " were used; --rate chooses the other"
    ]


def _about_pauses(timing: Timing, gaps: Gaps, n: int) -> list[str]:
    if not timing.pauses:
        return []
    found = "a gap" if timing.pauses == 1 else f"{timing.pauses} gaps"
    said = f"time has {found}, first after sample {timing.first_pause}, the longest {timing.longest_pause:.6g} s"
    if gaps != "rows":
        return [said]
    rows = f"{count(timing.missing)} {'row' if timing.missing == 1 else 'rows'}"
    if timing.missing > n:
        return [
            f"{said}; read it with --gaps dt (elapsed time): --gaps missing would add {rows} of missing samples"
        ]
    return [f"{said}; read it with --gaps missing (adds {rows} of missing samples) or --gaps dt (elapsed time)"]
