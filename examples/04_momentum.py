"""Filter with momentum, and see what it buys.

The flex sensor of the demo with and without momentum: at the values of maximum likelihood, and at equal noise
reduction, where it helps and where it hurts. Its truth is known, so the error is measured. With a path as argument
the picture of docs/theory.md is written there: python examples/04_momentum.py docs/pictures/momentum.svg
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import kalscope
from kalscope.common.charts import Line, Panel, draw_svg
from kalscope.common.numbers import Array

PERIOD = 0.02
"""Sample period of the recording, s."""


def main() -> None:
    recording = kalscope.open_source("sample:flex_sensor")
    z = recording.channel("flex")
    truth = flex_truth(recording.time)
    before = kalscope.estimate(z, momentum=0).params
    after = kalscope.estimate(z).params
    assert before is not None
    assert after is not None

    rows = {
        "raw": kalscope.FilterParams(q=1.0, r=0.0),
        "maximum likelihood, five lines": before,
        "maximum likelihood, momentum": after,
        "8 dB, five lines": at_noise_reduction(8, 0),
        "8 dB, momentum 1 s": at_noise_reduction(8, 50),
        "13 dB, five lines": at_noise_reduction(13, 0),
        "13 dB, momentum 4 s": at_noise_reduction(13, 200),
    }
    print_table("flex sensor, 50 Hz, counts", rows, z, truth)
    walk, noise = np.random.default_rng(1).normal(0.0, (0.1, 1.0), (100_000, 2)).T
    truth_of_walk = np.cumsum(walk)
    rows = {f"13 dB, momentum {PERIOD * tau:g} s": at_noise_reduction(13, tau) for tau in (0, 20, 50, 200)}
    print_table("random walk", rows, truth_of_walk + noise, truth_of_walk)
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(picture(recording.time, z, truth), encoding="utf-8")


def print_table(title: str, rows: dict[str, kalscope.FilterParams], z: Array, truth: Array) -> None:
    """What each filter does, and its error against the truth."""
    print(f"{title:31}   τ       lag    noise  overshoot  settles    error")
    for name, params in rows.items():
        settled = kalscope.steady_state(params)
        error = np.sqrt(np.mean((kalscope.denoise(z, params) - truth)[100:] ** 2))
        print(
            f"{name:31}{params.momentum:4.0f}{1000 * PERIOD * settled.lag_samples:7.1f} ms"
            f"{0.0 - settled.noise_reduction_db:6.1f} dB{100 * settled.overshoot:9.1f} %"
            f"{PERIOD * settled.settle_samples:7.2f} s{error:9.3f}"
        )


def flex_truth(time: Array) -> Array:
    """The signal without noise, counts: sample_data/flex_sensor.md says how the recording was made."""
    angle = 1 - np.abs(1 - np.mod(time / 1.8, 2.0))
    return 340 + 260 * angle**1.2


def at_noise_reduction(decibels: float, momentum: float) -> kalscope.FilterParams:
    """The filter that reduces white noise by so much."""
    ratio = kalscope.ratio_for(noise_reduction_db=decibels, momentum=momentum)
    return kalscope.FilterParams(q=ratio, r=1.0, momentum=momentum)


def picture(time: Array, z: Array, truth: Array) -> str:
    """Three panels: the flex sensor where momentum helps and where it hurts, and a step."""
    steps = PERIOD * np.arange(350.0)
    step = np.where(steps >= 3.0, 100.0, 0.0)
    noisy = step + np.random.default_rng(1).normal(0.0, 10.0, len(step))
    flex, turn = (time, z, truth), slice(755, 905)
    panels = [
        panel("Flex sensor, −8 dB: a fifth of the lag", flex, turn, 8, 50),
        panel("Flex sensor, −13 dB: it cannot turn", flex, turn, 13, 200),
        panel("A step, −13 dB: it goes beyond", (steps, noisy, step), slice(100, None), 13, 50),
    ]
    svg = draw_svg(panels, "Filters with and without momentum on the flex sensor and on a step")
    return svg.replace("<svg ", '<svg style="background:#fff" ', 1)


def panel(title: str, signal: tuple[Array, Array, Array], shown: slice, decibels: float, momentum: float) -> Panel:
    """Time, samples and truth, with the two filters of one noise reduction."""
    time, z, truth = signal
    plain, moving = (kalscope.denoise(z, at_noise_reduction(decibels, tau)) for tau in (0, momentum))
    curves = (
        (z, "raw", "raw"),
        (plain, "five lines", "s1"),
        (moving, "with momentum", "s2"),
        (truth, "truth", "truth"),
    )
    lines = tuple(Line(time[shown], y[shown], label, style) for y, label, style in curves)
    return Panel(f"{title} (momentum {PERIOD * momentum:g} s)", lines, "time (s)", "counts")


if __name__ == "__main__":
    main()
