"""The compiled loops of the classic filters: one channel, as the loop of a device computes it, no checks.

Every loop takes the samples `z` (NaN where missing: it holds its output), the steps `dt` in sample periods (empty =
1 each; only the one-euro filter uses them), the constants `k` and the state `s`, both of the type of z, counters
`at`, and fills `out`. It continues from `s` and `at`, so a stream is a record of one sample at a time. s[0] is the
last output, NaN before the first finite sample.

float32 arrays give what a board computes, one rounding per operation. Therefore no number is written into a
formula: it would be a double.

`s[1]` of a filter that feeds back is what rounding left out of its output. Without it a float32 at a level of 1e5
no longer moves once its corrections are below 0.004; with it nothing is lost (Kahan 1965, CACM 8, 40).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Floats = NDArray[Any]
"""float64, or float32 as a board computes."""
Counters = NDArray[np.int64]


@compiled()
def moving_average(z: Floats, dt: Floats, k: Floats, s: Floats, at: Counters, out: Floats) -> None:
    """Mean of the last N samples, or of fewer at the start; k = (1,).

    s holds the output, a level, the sum of the window around it, the next level, the sum around that of the samples
    since the last full turn, the number of samples in the window, and the window. A running sum drifts; here it is
    replaced once per turn by one that was summed from zero, so no rounding error lasts longer than 2N samples.
    """
    one, window = k[0], s[6:]
    n, place = window.shape[0], at[0]
    for i in range(z.shape[0]):
        if not math.isnan(z[i]):
            if place == 0:
                s[3] = z[i]
                s[4] = 0.0
            if s[5] < n:
                if math.isnan(s[0]):
                    s[1] = z[i]
                s[5] += one
                s[2] += z[i] - s[1]
            else:
                s[2] += z[i] - window[place]
            s[4] += z[i] - s[3]
            window[place] = z[i]
            place += 1
            if place == n:
                place = 0
                s[1], s[2] = s[3], s[4]
            s[0] = s[1] + s[2] / s[5]
        out[i] = s[0]
    at[0] = place


@compiled()
def median(z: Floats, dt: Floats, k: Floats, s: Floats, at: Counters, out: Floats) -> None:
    """Median of the last N samples, N odd; the window begins filled with the first one.

    s holds the output, the window in order of arrival, and the same in order of size.
    """
    n = (s.shape[0] - 1) // 2
    window, ordered = s[1 : n + 1], s[n + 1 :]
    place = at[0]
    for i in range(z.shape[0]):
        new = z[i]
        if not math.isnan(new):
            if math.isnan(s[0]):
                window[:] = new
                ordered[:] = new
            old, j = window[place], 0
            while ordered[j] != old:
                j += 1
            while j + 1 < n and ordered[j + 1] < new:
                ordered[j] = ordered[j + 1]
                j += 1
            while j > 0 and ordered[j - 1] > new:
                ordered[j] = ordered[j - 1]
                j -= 1
            ordered[j] = window[place] = new
            place = place + 1 if place + 1 < n else 0
            s[0] = ordered[n // 2]
        out[i] = s[0]
    at[0] = place


@compiled()
def exponential(z: Floats, dt: Floats, k: Floats, s: Floats, at: Counters, out: Floats) -> None:
    """Exponential smoothing x += α (z − x), begun at the first sample; k = (α,), s = (x, its rest)."""
    alpha = k[0]
    for i in range(z.shape[0]):
        if not math.isnan(z[i]):
            if math.isnan(s[0]):
                s[0] = z[i]
            before = s[0]
            step = s[1] + alpha * ((z[i] - before) - s[1])
            s[0] = before + step
            s[1] = step - (s[0] - before)
        out[i] = s[0]


@compiled()
def one_euro(z: Floats, dt: Floats, k: Floats, s: Floats, at: Counters, out: Floats) -> None:
    """Exponential smoothing whose cut-off f grows with the speed: α = w/(1 + w), w = 2π f · time.

    The speed is smoothed likewise, with a cut-off of its own; it is taken from the last output. k = (2π f at
    speed 0, its growth with the speed, 2π f of the speed, 1, 1e30), s = (x, its rest, speed, time). Of two samples
    at the same time the second changes only the speed.

    Casiez, Roussel & Vogel (2012), CHI '12, 2527, section "1€ filter".
    """
    slowest, growth, of_speed, one, most = k
    for i in range(z.shape[0]):
        s[3] += dt[i] if dt.shape[0] else one
        if not math.isnan(z[i]):
            if math.isnan(s[0]):
                s[0] = z[i]
            else:
                before, elapsed = s[0], s[3]
                apart = (z[i] - before) - s[1]
                s[2] += of_speed / (one + of_speed * elapsed) * (apart - elapsed * s[2])
                turn = (slowest + growth * abs(s[2])) * elapsed
                if not turn < most:  # beyond any float: the sample itself
                    turn = most
                step = s[1] + turn / (one + turn) * apart
                s[0] = before + step
                s[1] = step - (s[0] - before)
            s[3] = 0.0
        out[i] = s[0]


@compiled()
def notch(z: Floats, dt: Floats, k: Floats, s: Floats, at: Counters, out: Floats) -> None:
    """Second-order notch, settled at the first sample; k from `Notch.constants`, s = (output, level, two sums).

    Transposed direct form II (Oppenheim & Schafer, "Discrete-Time Signal Processing", section 6.3.4) of what is
    above the first sample, of which float32 keeps more digits than of a large level.
    """
    gain, turn, decay = k
    for i in range(z.shape[0]):
        if not math.isnan(z[i]):
            if math.isnan(s[0]):
                s[1] = z[i]
            above = z[i] - s[1]
            passed = gain * above + s[2]
            s[2] = turn * (above - passed) + s[3]
            s[3] = gain * above - decay * passed
            s[0] = s[1] + passed
        out[i] = s[0]


@compiled()
def butterworth(z: Floats, dt: Floats, k: Floats, s: Floats, at: Counters, out: Floats) -> None:
    """Second-order low-pass, settled at the first sample, as a state-variable filter of two integrators.

    Its constants stay exact where the cut-off is low: the direct form has 1 + a₁ + a₂ ≈ (2πf)², of which float32
    keeps no digit. s = (output, rest of the level, level, slope); k from `Butterworth.constants`. Zavalishin
    (2020), "The Art of VA Filter Design", section 4.4.
    """
    to_slope, decay, to_level, half = k
    for i in range(z.shape[0]):
        if not math.isnan(z[i]):
            if math.isnan(s[0]):
                s[2] = z[i]
            before, slope = s[2], s[3]
            apart = (z[i] - before) - s[1]
            step = to_slope * slope + to_level * apart
            s[0] = before + (s[1] + half * step)
            s[3] = slope + (to_slope * apart - decay * slope)
            step = s[1] + step
            s[2] = before + step
            s[1] = step - (s[2] - before)
        out[i] = s[0]
