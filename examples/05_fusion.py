"""Fuse several sensors of one quantity, and see what each of them is worth.

Three sensors of a signal whose truth is known: their noises and offsets are found from the readings alone, and
the fused value is compared with the truth beside each sensor's own filter. With a path as argument the picture of
docs/fusion.md is written there: python examples/05_fusion.py docs/pictures/fusion.svg
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import kalscope
from kalscope.common.charts import Line, Panel, draw_svg
from kalscope.common.numbers import Array

SIGMAS = (1.0, 1.3, 0.5)
OFFSETS = (0.3, 0.0, -0.3)
SETTLED = slice(100, None)
"""Rows after the start, which is not judged here."""


def main() -> None:
    recording = kalscope.synthesize(
        "random_walk", n=4000, period=1.0, sigmas=SIGMAS, offsets=OFFSETS, every=(1, 1, 5), seed=20
    )
    z = recording.values
    assert recording.truth is not None
    truth = recording.truth[:, 0]

    found = kalscope.estimate_fusion(z, names=recording.names)
    params = found.params
    assert params is not None
    print(found.message)
    print("sensor   noise σ  known   offset  known  share")
    for i, name in enumerate(recording.names):
        print(
            f"{name:6}{np.sqrt(params.sensor_r[i]):10.3f}{SIGMAS[i]:7.1f}{params.offset[i]:9.3f}{OFFSETS[i]:7.1f}"
            f"{100 * params.shares[i]:6.0f} %"
        )

    print("error against the truth")
    for i, name in enumerate(recording.names):
        alone = kalscope.fuse(z[:, [i]], params.only([i])).x
        print(f"  {name} alone       {error(alone, truth):.3f}")
    print(f"  fused         {error(kalscope.fuse(z, params).x, truth):.3f}")
    without = z.copy()
    without[:, 0] = np.nan  # a sensor that drops out is a column of missing readings
    print(f"  a drops out   {error(kalscope.fuse(without, params).x, truth):.3f}")

    stream = kalscope.KalmanFilter(params)  # the same row by row, as a program that reads the sensors gets them
    assert [stream.update(row) for row in z[:50]] == kalscope.fuse(z, params).x[:50].tolist()
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(picture(), encoding="utf-8")


def error(x: Array, truth: Array) -> float:
    """Standard deviation of x around the truth; an offset that all sensors share cannot be known."""
    return float(np.std((x - truth)[SETTLED]))


def picture() -> str:
    """Three level sensors on a tank: what they read, and the fused level where the best of them fails."""
    recording = kalscope.open_source("sample:tank_level")
    found = kalscope.estimate_fusion(recording.values, names=recording.names)
    assert found.params is not None
    fused = kalscope.fuse(recording.values, found.params)
    shown = slice(620, 860)
    curves = [
        (recording.values[:, i], name, style)
        for i, (name, style) in enumerate(zip(recording.names, ("s3", "raw", "s1"), strict=True))
    ]
    panels = [
        panel("Three level sensors as they read; the sonar fails from 700 s to 780 s", curves, recording, shown),
        panel("Fused, ±2 σ", band(fused.x, fused.p), recording, shown),
    ]
    svg = draw_svg(panels, "Three level sensors on a tank, and the level fused from them")
    return svg.replace("<svg ", '<svg style="background:#fff" ', 1)


def band(x: Array, p: Array) -> list[tuple[Array, str, str]]:
    """The fused value, and its 95 % band."""
    return [(x - 2 * np.sqrt(p), "±2 σ", "truth"), (x + 2 * np.sqrt(p), "±2 σ", "truth"), (x, "fused", "s2")]


def panel(title: str, curves: list[tuple[Array, str, str]], recording: kalscope.Recording, shown: slice) -> Panel:
    """The curves over time, each through its own readings; broken where there are none for longer than 10 s."""
    lines: list[Line] = []
    for y, label, style in curves:
        at = np.flatnonzero(np.isfinite(y[shown])) + shown.start
        gaps = np.flatnonzero(np.diff(recording.time[at]) > 10.0) + 1
        time = np.insert(recording.time[at], gaps, recording.time[at][gaps])
        lines.append(Line(time, np.insert(y[at], gaps, np.nan), label, style))
    return Panel(title, tuple(lines), "time (s)", "mm")


if __name__ == "__main__":
    main()
