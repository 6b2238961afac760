"""Advice as options: what to add to the same `kalscope tune`, or leave out, to do what a piece of advice says."""

from __future__ import annotations

import math

from kalscope.analysis import actions
from kalscope.cli.tune.answer import Answer
from kalscope.cli.tune.options import SPECIFICATIONS
from kalscope.recording import Recording

TARGET_OPTIONS = {name: option for option, (name, _) in SPECIFICATIONS.items()}
"""The option of each target of `find_parameters`."""


def option_for(action: actions.Action | None, answer: Answer, recording: Recording) -> str:
    """The option that does it for this channel; "" where no option does, as for a new recording."""
    without = _without(answer)
    match action:
        case actions.AllowMomentum():
            words = ["--momentum auto", *without]
        case actions.SetSpikesAside():
            words = ["--robust", *without]
        case actions.EstimateAgain():
            words = without
        case actions.SetGate(sigma):
            words = ["--gate off" if sigma is None else f"--gate {sigma * sigma:.4g}"]
        case actions.UseStillStretch(first, last):
            words = [f"--still {still_text(recording, first, last)}"]
        case actions.SetRatio(ratio):
            words = [f"--ratio {ratio:.3g}"]
        case actions.Scale(q_factor, r_factor):
            words = _scaled(answer, q_factor, r_factor)
        case actions.GiveNoise():
            words = ["--still FROM:TO or --sigma STD"]
        case actions.ChooseFilter():
            words = [example(answer)]
        case actions.UnsetStart() | actions.RecordLonger() | None:
            words = []
    return " ".join(words)


def _without(answer: Answer) -> list[str]:
    """The options that keep q, r or momentum from being estimated: they must be left out."""
    asked = answer.request
    noise = asked.noise
    given = [
        *(TARGET_OPTIONS[name] for name in asked.target),
        *(["--ratio"] if asked.ratio is not None else []),
        *(["--overshoot"] if asked.overshoot is not None else []),
        *(f"--{name}" for name in ("still", "sigma", "density", "r") if getattr(noise, name) is not None),
        *(["--method"] if asked.method != "ml" else []),
    ]
    return [f"without {', '.join(given)}"] if given else []


def _scaled(answer: Answer, q_factor: float, r_factor: float) -> list[str]:
    """Both variances times their factor, as options of `kalscope open` and `filter`, which take them."""
    params = answer.found.params
    if params is None:
        return []
    q, r = params.q * q_factor, float(params.r) * r_factor
    return [f"--q {q:.4g} --r {r:.4g} of kalscope open and filter"]


def still_text(recording: Recording, first: int, last: int) -> str:
    """Samples `first` … `last` − 1 as FROM:TO, in as few digits as select the same ones."""
    time = recording.time
    for digits in range(3, 18):
        start, end = (f"{float(time[at]):.{digits}g}" for at in (first, last - 1))
        inside = ((time >= float(start)) & (time <= float(end))).nonzero()[0]
        if len(inside) and (inside[0], inside[-1]) == (first, last - 1):
            return f"{start}:{end}"
    return f"{float(time[first])!r}:{float(time[last - 1])!r}"


def example(answer: Answer) -> str:
    """An option that chooses a filter for any record: a lag of five samples where ms suit it, or a gain."""
    lag = math.nan if answer.sample_period is None else 5e3 * answer.sample_period
    return f"--lag-ms {lag:.4g}" if 0.01 <= lag < 1e4 else "--gain 0.2"
