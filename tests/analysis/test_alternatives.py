"""Simpler filters at equal lag or noise, measured on ramps and noise made here."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.support import signals

from kalscope import BadSetting, FilterParams, estimate, kalman_filter, ratio_for, smooth, steady_state
from kalscope.analysis.alternatives import compare_alternatives, fixed_lag
from kalscope.analysis.candidates import at_lag, at_noise
from kalscope.filtering.classic import Bench, ChainFilter

RNG = np.random.default_rng(20)
WINDOWED = {"Moving average", "Median"}
MEASURED = {"Median", "One-euro"}


def bench_for(lag):
    return Bench(noise=RNG.normal(size=5000), speed=0.2, samples=100_000, present_lag=lag)


@pytest.mark.slow
@pytest.mark.parametrize("lag", [1.0, 3.0, 9.512, 40.0, 400.0])
def test_each_alternative_has_the_lag_it_is_said_to_have_and_the_one_asked_or_its_nearest(lag):
    """On a noisy ramp up and down, with other noise than the bench's."""
    bench, n = bench_for(lag), int(60 * (lag + 1)) + 6000
    noise, ramp = np.random.default_rng(99).normal(size=n), 0.2 * np.arange(n)
    for one in at_lag(lag, bench):
        tolerance = 0.05 if one.name in MEASURED else 1e-3
        late = np.mean((ramp - (one.run(ramp + noise) - one.run(noise - ramp)) / 2)[n // 3 :]) / 0.2
        assert late == pytest.approx(one.lag_samples, rel=tolerance, abs=tolerance), one.name
        nearest = max(0.5, 0.05 * lag) + 0.5 * (one.name != "Moving average")
        assert abs(one.lag_samples - lag) <= (nearest if one.name in WINDOWED else 0.02 * lag), one.name


@pytest.mark.slow
@pytest.mark.parametrize("decibel", [2.0, 6.0, 13.02, 20.0])
def test_each_alternative_leaves_the_noise_it_is_said_to_leave_and_the_one_asked_or_its_nearest(decibel):
    gain, noise = 10 ** (-decibel / 10), np.random.default_rng(98).normal(size=400_000)
    for one in at_noise(gain, bench_for((1 / (2 * gain / (1 + gain))) - 1)):
        # A median sees how dense the noise is in its middle, which 5000 draws of it tell to a tenth.
        tolerance = 0.15 if one.name in MEASURED else 0.06
        left = np.mean(one.run(noise)[80_000:-80_000] ** 2)
        assert left == pytest.approx(one.noise_gain, rel=tolerance), one.name
        missed = abs(10 * math.log10(one.noise_gain / gain))
        window = int(one.parameters.split()[-1]) if one.name in WINDOWED else math.inf
        assert missed <= (0.2 if window == math.inf else max(0.3, 10 * math.log10((window + 2) / window))), one.name


def test_missing_samples_leave_no_hole_and_no_future_in_a_causal_filter():
    z = RNG.normal(size=400).cumsum()
    z[:5] = z[100:140] = np.nan
    for one in at_lag(4.0, bench_for(4.0)):
        curve = one.run(z)
        assert np.array_equal(np.isfinite(curve), np.arange(400) >= 5), one.name
        assert curve.tobytes() == ChainFilter(one.chain, FilterParams(1.0, 1.0)).run(z).x.tobytes()
        changed = z.copy()
        changed[300:] += 1e6
        assert np.array_equal(one.run(changed)[5:300], curve[5:300], equal_nan=True), one.name


@pytest.mark.slow
def test_on_a_random_walk_under_white_noise_nothing_beats_the_true_kalman_filter():
    truth = np.cumsum(0.2 * RNG.normal(size=60_000))
    z = truth + RNG.normal(size=60_000)
    for match in ("lag", "noise"):
        found = compare_alternatives(z, FilterParams(q=0.04, r=1.0), match=match, truth=truth)
        words = {"lag": "lag", "noise": "noise reduction"}[match]
        assert found.verdict.startswith(f"At equal {words}, nothing simpler does better")
        assert "No significant difference: exponential." in found.verdict
        assert found.present.rmse <= min(one.rmse for one in found.others if one.causal) * (1 + 1e-4)
        predicted = math.sqrt(steady_state(FilterParams(0.04, 1)).p)
        assert found.others[-1].name == "Smoother (offline bound)"
        assert found.others[-1].rmse < found.present.rmse == pytest.approx(predicted, rel=0.02)


@pytest.mark.slow
def test_spikes_that_none_can_predict_do_not_hide_what_a_median_does():
    truth = 100.0 + 20.0 * np.sin(np.arange(3000) / 150)
    z = truth + RNG.normal(size=3000)
    z[7::33] = 400.0
    params = FilterParams(q=ratio_for(lag_samples=4.0), r=1.0)
    blind, known = compare_alternatives(z, params), compare_alternatives(z, params, truth=truth)
    assert "spikes that none could predict" in blind.note
    assert "spike" not in known.note
    for one, same in zip(blind.others, known.others, strict=True):  # both judge every filter alike
        real = one.against is not None and one.against.real
        assert not real or one.against.better == same.against.better, one.name


PARAMS, NOISE = FilterParams(q=0.1, r=1.0), RNG.normal(size=500)


@pytest.mark.parametrize(
    ("z", "params", "words"),
    [
        (NOISE, FilterParams(q=0.0, r=1.0), "With q = 0 the filter never settles"),
        (NOISE, FilterParams(q=1.0, r=0.0), "passes the signal unchanged"),
        (NOISE, FilterParams(q=1e-9, r=1.0), "more than a quarter"),
        (1e-200 * NOISE, FilterParams(1e-201, 1e-200), "use a unit in which they lie"),
        (1e200 * NOISE, FilterParams(1e199, 1e200), "use a unit in which they lie"),
        ([1.0, 2.0, np.nan, 3.0], PARAMS, "only 3 finite samples"),
        ([], PARAMS, "only 0 finite samples"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_words(z, params, words):
    found = compare_alternatives(z, params)
    assert (words in found.verdict, found.others, len(found.present.curve)) == (True, (), len(z))


def test_a_constant_stays_constant_and_a_wrong_argument_is_refused():
    flat = compare_alternatives(np.full(200, 5.0), PARAMS)
    assert all(np.allclose(one.curve[20:], 5.0) for one in flat.others)
    assert "cannot be compared" in flat.verdict
    with pytest.raises(BadSetting, match='match must be "lag" or "noise"'):
        compare_alternatives(np.zeros(50), PARAMS, match="both")
    with pytest.raises(BadSetting, match="one channel"):
        compare_alternatives(np.zeros((50, 2)), PARAMS)


# --- momentum ---


@pytest.mark.parametrize("lag", [0.7, 3.0, 9.5, 60.0])
def test_each_candidate_overshoots_a_step_as_it_is_said_to(lag):
    step = np.repeat([0.0, 1.0], 20_000)
    for one in at_lag(lag, bench_for(lag)):
        assert one.overshoot == pytest.approx(max(0.0, np.nanmax(one.run(step)) - 1.0), abs=1e-6), one.name


@pytest.mark.slow
def test_a_filter_with_momentum_is_compared_at_its_own_lag():
    truth, params = signals.moving(60_000, 60.0, 0.3, r=0.0), FilterParams(0.3, 1.0, momentum=60.0)
    z = truth + RNG.normal(size=60_000)
    found = compare_alternatives(z, params, truth=truth)
    steady = steady_state(params)
    assert found.present.lag_samples == steady.lag_samples
    assert found.present.overshoot == steady.overshoot > 0.05
    assert found.present.parameters == f"K = {steady.gain:.4g}, L = {steady.velocity_gain:.4g}"
    exponential = next(one for one in found.others if one.name == "Exponential")
    assert exponential.lag_samples == pytest.approx(steady.lag_samples)
    assert exponential.noise_reduction_db < steady.noise_reduction_db - 1.0
    assert (exponential.matched, exponential.against.worse) == (True, True)
    assert "nothing simpler does better than your filter here" in found.verdict
    errors = (kalman_filter(z, params).x - truth)[-found.judged :]
    assert found.present.rmse == pytest.approx(math.sqrt(np.mean(errors**2)), rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("momentum", [0.0, 20.0])
def test_the_fixed_lag_smoother_sees_so_much_ahead_and_its_gain_is_known_without_the_truth(momentum):
    rng = np.random.default_rng(8)
    walk = np.cumsum(rng.normal(size=4000))
    truth = np.convolve(walk, np.exp(-np.arange(200) / momentum), "same") if momentum else walk
    noise = 0.3 * np.abs(np.diff(truth)).mean() * 10.0
    z = truth + rng.normal(0.0, noise, 4000)
    model = estimate(z).params
    params = FilterParams(ratio_for(lag_samples=3.0) * model.r, model.r)
    blind, known = (fixed_lag(z, params, model, true) for true in (None, truth))
    assert blind.curve[2000] == pytest.approx(smooth(z[: 2000 + 3 + 1], model).x[2000], abs=0.02 * noise)
    gains = [float(one.parameters.split(": ")[1].split()[0]) for one in (blind, known)]
    assert gains[0] == pytest.approx(gains[1], abs=6.0)
    assert gains[1] > 7.0
    found = compare_alternatives(z, params, truth=truth, model=model)
    assert [one.name for one in found.others[-2:]] == ["Fixed lag", "Smoother (offline bound)"]
    assert found.others[-2].rmse == known.rmse == pytest.approx(np.std((known.curve - truth)[200:-200]), rel=0.1)


@pytest.mark.slow
def test_two_speeds_predict_better_than_what_has_their_lag_in_motion():
    rng = np.random.default_rng(0)
    z = np.cumsum((rng.random(3000) < 1 / 250) * rng.normal(size=3000) * 15) + rng.normal(size=3000)
    params = FilterParams(1e-4, 1.0, fast=1e6, spikes=0.01)
    compared = compare_alternatives(z, params)
    euro = next(one for one in compared.others if one.name == "One-euro")
    assert compared.present.lag_samples == steady_state(params.moving).lag_samples
    assert compared.present.noise_reduction_db == steady_state(params).noise_reduction_db
    assert compared.present.prediction < 0.95 * euro.prediction
