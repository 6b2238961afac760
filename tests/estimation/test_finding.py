"""`find_parameters`: the first answer, and what a wish or a known noise fixes."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest

from kalscope import FilterParams, denoise, estimate, ratio_for, steady_state
from kalscope.errors import BadSetting
from kalscope.estimation import request
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.estimation.settings import momentum_gain, movement_lost, movement_of, noise_left

N, PERIOD = 2000, 0.02
TIME = PERIOD * np.arange(N)


def bends(rng):
    """Fingers that bend: a smooth rise or fall a second, as in the demo."""
    truth = np.full(N, 400.0)
    for start in np.arange(0.9, TIME[-1] - 0.5, 1.0) + rng.uniform(-0.25, 0.25, 39):
        progress = np.clip((TIME - start) / rng.uniform(0.3, 0.5), 0.0, 1.0)
        truth += (rng.choice(np.arange(370, 710, 20)) - truth[-1]) * progress**2 * (3.0 - 2.0 * progress)
    return truth


def levels(rng):
    return np.repeat(rng.normal(0.0, 50.0, N // 100), 100)


SIGNALS = {  # the movement, and the standard deviation of the noise
    "demo": (bends, 17.0),
    "sine": (lambda rng: 100.0 * np.sin(np.pi * TIME + rng.uniform(0.0, 6.0)), 10.0),
    "waves": (lambda rng: np.cumsum(np.repeat(rng.normal(0.0, 8.0, 40), 50)) + 60.0 * np.sin(2.5 * TIME), 17.0),
    "steps": (levels, 10.0),
    "ramps": (lambda rng: np.convolve(levels(rng), np.ones(25) / 25.0, "same"), 10.0),
    "random walk": (lambda rng: np.cumsum(rng.normal(0.0, 1.0, N)), 3.0),
    "slow temperature": (lambda rng: 20.0 + np.cumsum(rng.normal(0.0, 0.01, N)), 0.3),
}


def rms(errors):
    return math.sqrt(float(np.mean(errors * errors)))


@pytest.mark.slow
@pytest.mark.parametrize("name", SIGNALS)
def test_with_noise_it_is_as_good_as_the_best_fixed_q_r_and_momentum(name):
    """The best is searched with the truth, on a grid that is fine enough for 1 %."""
    against_best = []
    for seed in range(3):
        rng = np.random.default_rng([seed, list(SIGNALS).index(name)])
        movement, noise = SIGNALS[name]
        truth = movement(rng)
        z = truth + rng.normal(0.0, noise, N)

        def error(params, z=z, truth=truth):
            return rms(denoise(z, params) - truth)

        grid = [(ratio, tau) for ratio in np.geomspace(1e-6, 100.0, 33) for tau in (0.0, 3.0, 10.0, 30.0, 100.0)]
        best = min(error(FilterParams(ratio, 1.0, momentum=tau)) for ratio, tau in grid)
        found = find_parameters(z)
        assert found.reason == "best_fit"
        assert error(found.params) <= rms(z - truth)
        against_best.append(error(found.params) / best)
    assert np.median(against_best) <= 1.05


@pytest.mark.slow
@pytest.mark.parametrize("name", SIGNALS)
def test_at_a_given_lag_the_momentum_of_the_best_fit_is_used_where_it_leaves_less_error_than_none(name):
    movement, noise = SIGNALS[name]
    rng = np.random.default_rng([7, list(SIGNALS).index(name)])
    truth = movement(rng)
    z = truth + rng.normal(0.0, noise, N)
    first = find_parameters(z).params
    for lag in (steady_state(first).lag_samples, 1.0, 5.0):
        found = find_parameters(z, Request(target={"lag_samples": lag})).params
        ratios = {tau: ratio_for(lag_samples=lag, momentum=tau) for tau in (0.0, first.momentum)}
        errors = [rms(denoise(z, FilterParams(ratio, 1.0, momentum=tau)) - truth) for tau, ratio in ratios.items()]
        assert steady_state(found).lag_samples == pytest.approx(lag)
        assert rms(denoise(z, found) - truth) <= 1.02 * min(errors)
        if name == "sine":  # what is said of momentum at this lag
            gain = momentum_gain(z, None, FilterParams(ratios[0.0], 1.0), estimate(z))
            assert gain == pytest.approx(1.0 - errors[1] / errors[0], abs=0.04)


RECORDS = {
    "best_fit": np.cumsum(np.random.default_rng(3).normal(size=500))
    + np.random.default_rng(4).normal(0.0, 3.0, 500),
    "medium": np.sin(np.arange(3000) / 9.0),  # nothing but movement
    "slow": np.random.default_rng(1).normal(size=300),
    "constant": np.full(50, 4.0),
    "too_few": np.array([1.0, 2.0, math.nan, 9.0]),  # the last is no code
    "bad_unit": np.resize([1e200, -1e200], 60),
}


@pytest.mark.slow
@pytest.mark.parametrize("reason", RECORDS)
def test_every_record_has_a_filter_and_its_reason(reason):
    z = RECORDS[reason]
    found = find_parameters(z, sample_period=PERIOD)
    assert (found.reason, found.message[-1], "came" in found.message) == (reason, ".", False)
    assert min(found.params.q, found.params.r) > 0.0
    assert noise_left(found.params) < request.HARDLY
    assert np.isfinite(denoise(z, found.params)).sum() >= np.isfinite(z).sum()
    assert request.starting_params(z) == found.params


def test_movement_lost_is_one_minus_the_response_of_the_filter():
    params, turn = FilterParams(0.2, 1.0), 2.0 * math.pi / 40.0
    gain = steady_state(params).gain
    lost = abs(1.0 - gain / (1.0 - (1.0 - gain) * cmath.exp(-1j * turn)))
    assert movement_lost(np.sin(turn * np.arange(20_000)), params, None) == pytest.approx(lost, rel=2e-3)


def test_the_settings_lose_what_they_say_and_a_lag_is_proposed_that_is_not_slower_than_the_present():
    found = find_parameters(RECORDS["medium"], sample_period=PERIOD)
    named = {one.name: one for one in found.costs if one.name}
    assert [one.movement_lost for one in named.values()] == pytest.approx([0.05, 0.1, 0.2], rel=0.02)
    assert list(named) == ["light", "medium", "strong"]
    assert np.all(np.diff([(one.lag_samples, -one.noise_left) for one in found.costs], axis=0) > 0.0)
    assert steady_state(found.params).lag_samples == pytest.approx(named["medium"].lag_samples)
    assert found.lost == pytest.approx(0.1, rel=0.02)
    for ratio in (1e-4, 1e4):
        present = FilterParams(ratio, 1.0)
        assert request.proposed_lag(found.costs, present) <= steady_state(present).lag_samples


def test_a_code_for_no_echo_neither_starts_nor_moves_the_filter_and_a_step_is_followed_at_once():
    """As of an ultrasonic sensor: 400 is out of range; the distance falls from 100 to 10."""
    rng = np.random.default_rng(8)
    truth = np.repeat([100.0, 10.0], [40, 80])
    z = truth + rng.normal(0.0, 3.0, 120)
    coded = rng.random(120) < 0.2
    coded[[0, 40, 41, 42]] = True, False, False, False
    z[coded] = 400.0
    found = find_parameters(z)
    x = denoise(z, found.params)
    assert x[[0, 42]] == pytest.approx([100.0, 10.0], abs=10.0)
    assert "400 came" in found.message
    only = replace(found.estimate.params, gate=16.0)
    assert rms(x - truth) < 0.5 * rms(denoise(z, only) - truth)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_no_gate_keeps_out_more_than_a_tenth_of_the_movement(seed):
    """As of a light sensor: bright and dark, and flashes that a spike-proof fit takes for spikes."""
    rng = np.random.default_rng(seed)
    bright = np.where(rng.random(500) < 0.15, rng.exponential(1500.0, 500), 0.0)
    z, flashes = np.repeat(bright, 6) + rng.normal(0.0, 20.0, 3000), rng.random(3000) < 0.01
    z[flashes] += rng.exponential(6000.0, flashes.sum())
    found = find_parameters(z)
    ungated = replace(found.params, gate=None, x0=None, p0=None)
    assert found.lost <= 0.1 + movement_lost(movement_of(z, None, found.estimate), ungated, None)


@pytest.mark.slow
def test_of_a_long_record_spikes_and_momentum_are_found_as_of_a_short_one():
    """Parts of it decide what is set aside and whether there is momentum; q, r and momentum are of all of it."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(5)
    n = 300_000
    truth = np.cumsum(lfilter([0.1], [1.0, -math.exp(-1.0 / 40.0)], rng.normal(size=n)))
    z, spikes = truth + rng.normal(0.0, 3.0, n), np.flatnonzero(rng.random(n) < 0.01)
    z[spikes] += 60.0
    found = find_parameters(z)
    aside = np.flatnonzero(found.estimate.outliers)
    assert np.isin(spikes, aside).all()
    assert len(aside) < 1.02 * len(spikes)
    assert found.params.momentum == pytest.approx(40.0, rel=0.05)
    clean = estimate(np.where(found.estimate.outliers, math.nan, z), robust=False)
    assert (found.params.momentum, found.params.ratio) == (clean.momentum, pytest.approx(clean.ratio, rel=1e-9))


WISHED = {"lag_s": 0.1, "lag_samples": 7.0, "cutoff_hz": 2.5, "noise_reduction_db": 12.0, "gain": 0.15}
KNOWN = {"nothing": (Noise(), None), "r": (Noise(r=1.5), 1.5), "sigma": (Noise(sigma=1.25), 1.5625)}
KNOWN |= {"density": (Noise(density=0.25, bandwidth_hz=25.0), 1.5625), "still": (Noise(still=(0, 60)), "still")}


def local_level():
    """A random walk under noise; constant for its first 60 samples."""
    rng = np.random.default_rng(5)
    steps = rng.normal(scale=math.sqrt(0.1), size=400)
    steps[:60] = 0.0
    return 20.0 + np.cumsum(steps) + rng.normal(size=400)


Z = local_level()


def ask(z, **options):
    return find_parameters(z, Request(**options), sample_period=PERIOD)


# ---- the truth table: who decides λ, who decides r, and what is left to the record


@pytest.mark.slow
@pytest.mark.parametrize("known", KNOWN)
@pytest.mark.parametrize("ratio", [None, 0.01])
@pytest.mark.parametrize("target", [None, *request.TARGETS])
def test_a_wish_fixes_the_ratio_the_noise_fixes_r_and_the_rest_is_estimated(target, ratio, known):
    noise, r = KNOWN[known]
    asked = {target: WISHED[target]} if target else None
    if target and ratio is not None:
        with pytest.raises(BadSetting, match="only one target for λ may be given"):
            ask(Z, target=asked or {}, ratio=ratio, noise=noise)
        return
    found = ask(Z, target=asked or {}, ratio=ratio, noise=noise)
    assert found.message.endswith(".")
    if r == "still":
        r = float(np.polyfit(np.arange(60), Z[:60], 1, full=True)[1][0]) / 58.0
    if r is not None:
        assert found.params.r == pytest.approx(r, rel=1e-12)
    if target:
        assert getattr(steady_state(found.params, PERIOD), target) == pytest.approx(WISHED[target], rel=1e-9)
    if ratio is not None:
        assert found.params.ratio == pytest.approx(ratio, rel=1e-12)
    all_is_given = target or (ratio is not None and r is not None)
    by = None if all_is_given else "fixed_ratio" if ratio is not None else "ml" if r is None else "fixed_r"
    assert (found.estimate.method if found.estimate else None) == by
    assert found.estimate is None or found.estimate.params == found.params
    assert by != "ml" or found.how == "maximum likelihood"


def test_spikes_do_not_raise_the_r_of_a_goal_and_the_answer_says_that_no_gate_is_set():
    z = Z.copy()
    z[20::100] += 40.0 * np.std(np.diff(Z))
    plain, found = ask(Z, target={"gain": 0.2}), ask(z, target={"gain": 0.2})
    assert found.params.r == pytest.approx(plain.params.r, rel=0.1)
    assert found.params.gate is None
    assert "spikes set aside for it. A goal sets no outlier gate" in found.message
    assert "spike" not in plain.message


# ---- what is refused


CONTRADICTIONS = [
    ({"target": {"gain": 0.2, "lag_s": 0.1}}, r"only one target for λ may be given \(got gain and lag_s\)"),
    ({"target": {"speed": 1.0}}, "target must be one of lag_s, .* 'speed'"),
    ({"ratio": 0.0}, "q/r must be a finite number above 0"),
    ({"noise": Noise(r=1.0, sigma=1.0)}, r"one source \(got r, sigma\)"),
    ({"noise": Noise(still=(0, 60), density=1.0, bandwidth_hz=1.0)}, r"one source \(got density, still\)"),
    ({"noise": Noise(sigma=1.0, bandwidth_hz=1.0)}, "bandwidth_hz needs density"),
    ({"noise": Noise(still=(0, 5))}, "still stretch must hold at least 8"),
    ({"target": {"noise_reduction_db": 9e9}}, "q above 0"),
    ({"overshoot": 0.1}, r"overshoot needs a target .* \(got none\)"),
    ({"overshoot": 0.1, "target": {"gain": 0.1}, "momentum": 0.0}, r"no momentum.*\(got momentum = 0.0\)"),
    ({"overshoot": 0.3, "target": {"gain": 0.1}}, r"overshoot must be at most 19\.\d+ % of a step"),
    ({"ratio": 0.1, "momentum": 3.0}, r'momentum must be "auto" or 0 with a ratio or known noise'),
    ({"noise": Noise(r=1.0), "momentum": 3.0}, r'momentum must be "auto" or 0 with a ratio or known noise'),
]


@pytest.mark.parametrize(("asked", "says"), CONTRADICTIONS)
def test_contradictions_and_numbers_out_of_range_are_refused(asked, says):
    with pytest.raises(BadSetting, match=says):
        ask(Z, **asked)


@pytest.mark.slow
@pytest.mark.parametrize("target", request.TARGETS)
def test_at_an_edge_a_wish_still_gives_its_filter(target):
    for verdict in ("medium", "slow", "constant", "too_few"):
        found = ask(RECORDS[verdict], target={target: WISHED[target]})
        assert found.params.r > 0.0
        assert getattr(steady_state(found.params, PERIOD), target) == pytest.approx(WISHED[target], rel=1e-9)


def test_a_target_is_met_at_the_momentum_that_is_given_and_a_given_r_that_explains_everything_is_not_called_good():
    for noise in (Noise(), Noise(r=1.5)):
        params = ask(Z, target={"lag_samples": 7.0}, momentum=15.0, noise=noise).params
        assert (params.momentum, steady_state(params).lag_samples) == (15.0, pytest.approx(7.0, rel=1e-9))
    found = ask(Z, noise=Noise(r=1e6))
    assert (found.reason, found.params.ratio) == ("slow", 0.01)
    assert "The r found is good" not in found.message
    assert "Record while the signal moves" in found.message
