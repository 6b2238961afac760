"""Chains and classic filters: against scipy, numpy and published lines; in pieces; settings and how they settle."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, steady_state
from kalscope.classic import Butterworth, Chain, Exponential, Median, MovingAverage, Notch, OneEuro
from kalscope.filtering.classic import ChainFilter, RunningStage
from kalscope.filtering.filter import GrowingRun

STAGES = (MovingAverage(7), Exponential(0.03), Median(9), Butterworth(0.01), OneEuro(0.01, 0.3, 0.1))
CHAINS = (Chain(5), *(Chain(n, stage) for n in (1, 3) for stage in STAGES))
CHAINS += Chain(notch=Notch(0.2, 0.05)), Chain(3, STAGES[0], Notch(0.03, 0.01))
MOVING = FilterParams(0.1, 2.0, gate=9.0, momentum=4.0)


def record(n=160):
    """A walk with spikes, gaps, equal and signed zeros, and uneven steps, two of them 0."""
    rng = np.random.default_rng(4)
    z = 1e3 + np.cumsum(rng.normal(size=n)) + rng.normal(size=n)
    z[rng.random(n) < 0.05] += 50.0
    z[60:80] = rng.choice([0.0, -0.0, 1.0], 20)
    z[rng.random(n) < 0.1] = np.nan
    z[:2] = np.nan
    dt = rng.uniform(0.1, 3.0, n)
    dt[[20, 21, 100]] = 0.0
    return z, dt


@pytest.mark.slow
def test_a_stream_and_a_record_that_grows_give_the_bits_of_the_whole():
    z, dt = record()
    for chain in CHAINS:
        for steps in (None, dt):
            used = ChainFilter(chain, MOVING)
            whole, stream, grown = used.run(z, steps), used.stream(), GrowingRun(used.stream())
            found = [stream.update(z[i], None if steps is None else steps[i]) for i in range(len(z))]
            assert np.array(found).tobytes() == whole.x.tobytes(), chain
            for at in (slice(0, 1), slice(1, 1), slice(1, 57), slice(57, None)):
                grown.extend(z[at], None if steps is None else steps[at])
            for name in ("x", "p", "k", "innovation", "s", "velocity", "velocity_p", "rejected"):
                np.testing.assert_array_equal(getattr(grown.result, name), getattr(whole, name), f"{chain} {name}")


ONE_EURO = Path(__file__).parents[2] / "../shared/data/one_euro_truth/groundTruth.csv"
EVEN = np.empty(0)
LONGEST = 20_001
"""Samples of a median that scipy takes over."""


def filtered(z, stage, kind=np.float64):
    return RunningStage(stage, kind).take(z, EVEN)


def walk(n=3000):
    rng = np.random.default_rng(7)
    z = 40.0 + np.cumsum(rng.normal(size=n)) + rng.normal(size=n)
    z[rng.random(n) < 0.2] = z[:3] = np.nan
    return z


def holding(z, of_finite):
    """A filter of samples without gaps over those that came; its output is held in between."""
    out = np.full(len(z), np.nan)
    out[np.isfinite(z)] = of_finite(z[np.isfinite(z)])
    for i in range(1, len(z)):
        out[i] = out[i] if np.isfinite(z[i]) else out[i - 1]
    return out


@pytest.mark.slow
def test_each_is_what_scipy_and_numpy_compute():
    from scipy.ndimage import median_filter
    from scipy.signal import butter, iirnotch, lfilter, sosfilt

    z = walk()

    def low_pass(cutoff):
        return lambda seen: sosfilt(butter(2, 2 * cutoff, output="sos"), seen - seen[0]) + seen[0]

    def smoothing(alpha):
        return lambda seen: lfilter([alpha], [1, alpha - 1], seen - seen[0]) + seen[0]

    def middle(window):
        return lambda seen: median_filter(seen, window, mode="nearest", origin=(window - 1) // 2)

    def notch(frequency, width):
        return lambda seen: lfilter(*iirnotch(2 * frequency, frequency / width), seen - seen[0]) + seen[0]

    def mean(window):
        return lambda seen: [
            math.fsum(seen[max(0, i - window) : i]) / min(i, window) for i in range(1, len(seen) + 1)
        ]

    cases = [(Notch(*of), notch(*of)) for of in ((0.01, 0.001), (0.2, 0.05), (0.49, 0.2))]
    cases += [(Butterworth(f), low_pass(f)) for f in (0.49, 0.1, 0.003)]
    cases += [(Exponential(a), smoothing(a)) for a in (1.0, 0.4, 0.002)]
    cases += [(Median(n), middle(n)) for n in (1, 3, 9, 201, LONGEST)]
    cases += [(MovingAverage(n), mean(n)) for n in (1, 2, 9, 500)]
    for stage, oracle in cases:
        bound = 0.0 if isinstance(stage, Median) else 1e-12 * np.nanmax(np.abs(z))
        apart = np.abs(filtered(z, stage) - holding(z, oracle))
        assert np.nanmax(apart) <= bound, stage
        assert np.array_equal(np.isnan(apart), np.arange(len(z)) < 3), stage
    in_pieces = RunningStage(Median(LONGEST))
    pieces = [in_pieces.take(z[at], EVEN) for at in (slice(2900), slice(2900, None))]
    assert np.concatenate(pieces).tobytes() == filtered(z, Median(LONGEST)).tobytes()


def test_a_low_pass_of_a_low_cut_off_trails_a_ramp_by_its_lag_to_the_last_digits():
    """Where 1 + a₁ + a₂ is 4e-7, the sections of scipy are off by 1e-5 of the lag."""
    ramp = np.arange(90_000.0)
    stage = Butterworth(1e-4)
    assert ramp[-1] - filtered(ramp, stage)[-1] == pytest.approx(stage.lag, rel=1e-11)
    step = np.repeat([0.0, 1.0], [1, 4000])
    assert filtered(step, Butterworth(0.01))[-1] == pytest.approx(1.0, rel=1e-15)


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
    _, second, third, last = RunningStage(OneEuro(0.1, 0.0, 0.1)).take(z, dt)
    assert (second, last) == (1.0, third)
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
    slow = Exponential(1e-5), Exponential(2.0**-12), Butterworth(1e-5), OneEuro(1e-5, 1e-5, 0.01)
    for stage in (MovingAverage(500), *slow):
        apart = np.abs(filtered(z, stage, np.float32) - filtered(z, stage))
        assert apart.max() <= ulp, stage


PARAMS = FilterParams(0.04, 1.0, gate=9.0)


def settled(chain, z, period=None):
    used = ChainFilter(chain, PARAMS)
    return used.settled(used.run(z), period)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: MovingAverage(0), "window must be a whole number from 1 to 100000 (got 0)"),
        (lambda: MovingAverage(True), "window must be a whole number from 1 to 100000 (got True)"),
        (lambda: Median(4), "window must be an odd number of samples, such as 5 (got 4)"),
        (lambda: Exponential(math.nan), "alpha must be a number from 9.31e-10 to 1 (got nan)"),
        (lambda: Butterworth(0.5), "cutoff in cycles per sample must be a number from 1e-06 to 0.499 (got 0.5)"),
        (lambda: OneEuro(1.0, 1.0, 0.0), "speed_cutoff in cycles per sample must be a number from 1e-12 to 1e+09"),
        (lambda: OneEuro(1.0, 10**400, 1.0), "beta must be a number from 0 to 1e+300 (got 1000"),
        (lambda: Chain(2), "median must be an odd number of samples, such as 3 (got 2)"),
        (Chain, "a chain must have a median of at least 3 samples, a notch, or a filter in place of Kalman's"),
        (lambda: Chain(3, "one-euro"), "then must be a classic filter, or None for the Kalman filter (got"),
    ],
)  # fmt: skip
def test_what_is_no_setting_is_refused_in_words(make, says):
    with pytest.raises(BadSetting) as refused:
        make()
    assert str(refused.value).startswith(says)


def test_a_linear_filter_settles_by_formula_as_its_answer_to_a_step_and_to_a_wave():
    impulse, n = np.zeros(4000), 2000
    impulse[n] = 1.0
    step = np.cumsum(impulse)
    for stage in (MovingAverage(25), Exponential(0.07), Butterworth(0.012)):
        found = settled(Chain(1, stage), impulse, period=0.01)
        h, s = (ChainFilter(Chain(1, stage), PARAMS).denoise(z)[n:] for z in (impulse, step))
        assert found.gain == pytest.approx(h[0])
        assert found.lag_samples == pytest.approx(np.sum(np.arange(n) * h), rel=1e-9)
        assert found.lag_s == pytest.approx(0.01 * found.lag_samples)
        assert found.noise_reduction_db == pytest.approx(-10 * np.log10(np.sum(h**2)), rel=1e-9)
        at_cutoff = np.sum(h * np.exp(-2j * np.pi * 0.01 * found.cutoff_hz * np.arange(n)))
        assert abs(at_cutoff) == pytest.approx(math.sqrt(0.5), rel=1e-9)
        assert found.settle_samples == pytest.approx(np.flatnonzero(np.abs(s - 1) > 0.01)[-1] + 2, abs=2)
        assert found.overshoot == pytest.approx(s.max() - 1, abs=1e-3)
        assert math.isnan(found.p)


@pytest.mark.slow
def test_a_median_or_a_one_euro_filter_is_measured_on_the_noise_and_speed_of_the_run():
    z = np.random.default_rng(5).normal(size=20_000)
    kalman, both = steady_state(PARAMS), settled(Chain(5), z)
    assert both.lag_samples == pytest.approx(kalman.lag_samples + 2, abs=0.05)
    assert both.settle_samples == kalman.settle_samples + 2
    assert (both.gain, both.p) == (kalman.gain, kalman.p)
    left = ChainFilter(Chain(5), PARAMS).denoise(np.random.default_rng(6).normal(size=200_000))[1000:]
    assert both.noise_reduction_db == pytest.approx(-10 * np.log10(np.mean(left**2)), abs=0.3)
    middle = settled(Chain(1, Median(9)), z, period=2.0)
    assert middle.lag_s == pytest.approx(8.0, abs=0.1)
    assert np.isnan([middle.gain, middle.cutoff_hz]).all()
    slow, quick = (settled(Chain(3, OneEuro(0.01, beta, 0.01)), z) for beta in (0.0, 3.0))
    assert quick.lag_samples < 0.5 * slow.lag_samples
    assert slow.noise_reduction_db > quick.noise_reduction_db + 3
