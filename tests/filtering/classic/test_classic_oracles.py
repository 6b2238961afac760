"""The loops of the classic filters against scipy, numpy and the published one-euro filter, and in float32."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from kalscope.classic import Butterworth, Exponential, Median, MovingAverage, OneEuro
from kalscope.filtering import classic
from kalscope.filtering.classic import RunningStage

ONE_EURO = Path(__file__).parents[3] / "../shared/data/one_euro_truth/groundTruth.csv"
EVEN = np.empty(0)


def filtered(z, stage, kind=np.float64):
    return RunningStage(stage, kind).take(z, EVEN)


def walk(n=3000, gaps=True):
    rng = np.random.default_rng(7)
    z = 40.0 + np.cumsum(rng.normal(size=n)) + rng.normal(size=n)
    if gaps:
        z[rng.random(n) < 0.2] = np.nan
        z[:3] = np.nan
    return z


def holding(z, of_finite):
    """A filter of samples without gaps over those that came; its output is held in between."""
    out = np.full(len(z), np.nan)
    out[np.isfinite(z)] = of_finite(z[np.isfinite(z)])
    for i in range(1, len(z)):
        out[i] = out[i] if np.isfinite(z[i]) else out[i - 1]
    return out


def mean_of(seen, window):
    return np.array(
        [math.fsum(seen[max(0, i + 1 - window) : i + 1]) / min(i + 1, window) for i in range(len(seen))]
    )


@pytest.mark.slow
def test_each_is_what_scipy_and_numpy_compute():
    from scipy.ndimage import median_filter
    from scipy.signal import butter, lfilter, sosfilt

    z = walk()

    def low_pass(cutoff):
        return lambda seen: sosfilt(butter(2, 2 * cutoff, output="sos"), seen - seen[0]) + seen[0]

    def smoothing(alpha):
        return lambda seen: lfilter([alpha], [1, alpha - 1], seen - seen[0]) + seen[0]

    def middle(window):
        return lambda seen: median_filter(seen, window, mode="nearest", origin=(window - 1) // 2)

    cases = [(Butterworth(f), low_pass(f)) for f in (0.49, 0.1, 0.003)]
    cases += [(Exponential(a), smoothing(a)) for a in (1.0, 0.4, 0.002)]
    cases += [(Median(n), middle(n)) for n in (1, 3, 9, 201)]
    cases += [(MovingAverage(n), lambda seen, n=n: mean_of(seen, n)) for n in (1, 2, 9, 500)]
    for stage, oracle in cases:
        bound = 0.0 if isinstance(stage, Median) else 1e-12 * np.nanmax(np.abs(z))
        apart = np.abs(filtered(z, stage) - holding(z, oracle))
        assert np.nanmax(apart) <= bound, stage
        assert np.array_equal(np.isnan(apart), np.arange(len(z)) < 3), stage


def test_a_low_pass_of_a_low_cut_off_trails_a_ramp_by_its_lag_to_the_last_digits():
    """Where 1 + a₁ + a₂ is 4e-7, the sections of scipy are off by 1e-5 of the lag."""
    ramp = np.arange(90_000.0)
    stage = Butterworth(1e-4)
    assert ramp[-1] - filtered(ramp, stage)[-1] == pytest.approx(stage.lag, rel=1e-11)
    step = np.repeat([0.0, 1.0], [1, 4000])
    assert filtered(step, Butterworth(0.01))[-1] == pytest.approx(1.0, rel=1e-15)


@pytest.mark.slow
def test_a_long_median_by_scipy_gives_the_bits_of_the_loop_and_its_state(monkeypatch):
    z = np.round(walk(900), 0)
    for kind in (np.float64, np.float32):
        for window in (77, 601):
            rows = []
            for many in (math.inf, 0.0):
                monkeypatch.setattr(classic, "MANY_MOVES", many)
                one = RunningStage(Median(window), kind)
                rows.append((one.take(z[:700], EVEN).tobytes(), one.take(z[700:], EVEN).tobytes()))
            assert rows[0] == rows[1]
    assert np.isnan(filtered(np.full(3, np.nan), Median(77))).all()


def published(z, steps, cutoff, beta, speed_cutoff):
    """Casiez, Roussel & Vogel (2012): α = 1/(1 + τ/Te) with τ = 1/(2πf); time goes on through gaps."""
    x, dx, elapsed, out = None, 0.0, 0.0, []
    for value, step in zip(z, steps, strict=True):
        elapsed += step
        if not math.isnan(value):
            if x is None:
                x = value
            else:
                share = lambda f: 1 / (1 + 1 / (2 * math.pi * f) / elapsed)  # noqa: E731, B023
                dx = share(speed_cutoff) * ((value - x) / elapsed) + (1 - share(speed_cutoff)) * dx
                a = share(cutoff + beta * abs(dx))
                x = a * value + (1 - a) * x
            elapsed = 0.0
        out.append(math.nan if x is None else x)
    return np.array(out)


def test_one_euro_is_its_published_lines_also_over_uneven_steps():
    z = walk(400)
    uneven = np.random.default_rng(2).uniform(0.2, 4.0, len(z))
    for steps, given in ((np.ones(len(z)), EVEN), (uneven, uneven)):
        for settings in ((0.02, 0.1, 0.05), (3.0, 0.0, 1e-4), (1e-4, 2.0, 100.0)):
            ours = RunningStage(OneEuro(*settings)).take(z, given)
            np.testing.assert_allclose(ours, published(z, steps, *settings), rtol=1e-12)


def test_one_euro_of_two_samples_at_one_moment_or_of_any_speed_stays_finite():
    z, dt = np.array([1.0, 5.0, 5.0, 2.0]), np.array([1.0, 0.0, 1.0, 0.0])
    out = RunningStage(OneEuro(0.1, 0.0, 0.1)).take(z, dt)
    assert (out[1], out[3]) == (1.0, out[2])
    huge = np.array([0.0, 1e30, -1e30, 3.0], dtype=np.float32)
    for kind in (np.float64, np.float32):
        assert np.array_equal(filtered(huge, OneEuro(1.0, 1e30, 1.0), kind)[:3], huge[:3])


@pytest.mark.skipif(not ONE_EURO.is_file(), reason="shared/data is not beside the repository")
def test_one_euro_is_its_authors_own_ground_truth():
    _, _, noisy, truth = np.loadtxt(ONE_EURO, delimiter=",", skiprows=1).T
    ours = filtered(noisy, OneEuro(1.0 / 120.0, 0.1, 1.0 / 120.0))  # 120 Hz, cut-offs 1 Hz, β 0.1
    assert np.abs(ours - truth).max() < 1e-5  # times and values are printed with six digits


@pytest.mark.slow
def test_float32_stays_within_a_unit_of_its_last_digit_and_does_not_drift():
    """A level of 1e5 under noise of 1, whose distance of two floats is 0.0078, over a million samples."""
    rng = np.random.default_rng(3)
    z = (1e5 + rng.normal(size=1_000_000)).astype(np.float32)
    ulp = float(np.spacing(np.float32(1e5)))
    stages = (
        MovingAverage(500),
        Exponential(1e-5),
        Exponential(2.0**-12),
        Butterworth(1e-5),
        OneEuro(1e-5, 1e-5, 0.01),
    )
    for stage in stages:
        apart = np.abs(filtered(z, stage, np.float32) - filtered(z, stage))
        assert apart.max() <= ulp, stage
    for stage in (*stages, Median(9)):  # ten times the level and back, then a gap
        moved = np.concatenate([z[:2000], 10 * z[:2000], z[:2000], np.full(200, np.nan)])
        apart = np.abs(filtered(moved, stage, np.float32) - filtered(moved, stage))
        assert apart.max() <= (0.0 if stage == Median(9) else 4 * np.spacing(np.float32(1e6))), stage
        forgotten = apart[-1000:].max() <= ulp
        assert forgotten or stage.start_samples > 2000, stage
