"""`estimate`: published answers, the unit law, intervals that cover, edges told in words, and spikes set aside."""

from __future__ import annotations

import math
from dataclasses import fields
from importlib.resources import files
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.effort import FUZZ
from tests.support.signals import walk

from kalscope import BadSetting, FilterParams, estimate, kalman_filter
from kalscope.estimation.fit import estimate_fixed_r, estimate_fixed_ratio
from kalscope.estimation.likelihood import log_likelihood
from kalscope.estimation.momentum import likelihood_profile
from kalscope.estimation.spikes import MAX_SHARE
from kalscope.filtering.kernels import GATE_LIMIT


@pytest.fixture(scope="module")
def unemployment():
    """US unemployment, %, quarterly 1959-2009 (public domain)."""
    table = files("statsmodels") / "datasets/macrodata/macrodata.csv"
    return np.genfromtxt(str(table), delimiter=",", names=True)["unemp"]


# --- published tables -----------------------------------------------------------------------------------


def test_nile(nile):
    """15099, 1469.1 (Durbin & Koopman 2012, p. 37); 15098.52, 1469.18, −632.5456 (KFAS, by several hands)."""
    found = estimate(nile)
    assert (round(found.r, 2), round(found.q, 2), round(found.loglik, 4)) == (15098.52, 1469.18, -632.5456)
    assert (found.verdict, found.params) == ("ok", FilterParams(q=found.q, r=found.r))


def test_nile_interval_and_standard_error(nile):
    """The 95 % profile interval of λ; and the s.e. 0.1143 of R's arima(Nile, c(0, 1, 1)) for θ = −(1 − K)."""
    found = estimate(nile)
    low, high = found.ratio_interval
    assert (round(low, 4), round(high, 3)) == (0.0137, 0.557)
    for ratio in (low, high):
        at_end = likelihood_profile(nile, [math.log(ratio), math.log(ratio) + 1]).loglik[0]
        assert found.loglik - at_end == pytest.approx(3.841458820694124 / 2, abs=1e-6)
    assert found.gain_interval == pytest.approx((0.1103, 0.5181), abs=1e-4)
    step = 1e-2
    down, top, up = likelihood_profile(nile, math.log(found.ratio) + step * np.array([-1, 0, 1])).loglik
    gain = kalman_filter(nile, found.params).k[-1]
    theta_se = gain * (1 - gain) / (2 - gain) * step / math.sqrt(2 * top - down - up)  # dK/d ln λ · s.e.(ln λ)
    assert round(theta_se, 4) == 0.1143
    assert found.lag_interval == pytest.approx((1 / found.gain_interval[1] - 1, 1 / found.gain_interval[0] - 1))


def test_standard_errors_are_those_of_the_observed_information(nile):
    """The inverse Hessian of the log-likelihood in (q, r), by differences of the filter's own value."""
    found = estimate(nile)
    h = np.array([found.q, found.r]) * 1e-3

    def at(i, j):
        return log_likelihood(nile, FilterParams(found.q + i * h[0], found.r + j * h[1]))

    hqq = (at(1, 0) - 2 * at(0, 0) + at(-1, 0)) / h[0] ** 2
    hrr = (at(0, 1) - 2 * at(0, 0) + at(0, -1)) / h[1] ** 2
    hqr = (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / (4 * h[0] * h[1])
    errors = np.sqrt(np.diag(np.linalg.inv(-np.array([[hqq, hqr], [hqr, hrr]]))))
    np.testing.assert_allclose([found.q_se, found.r_se], errors, rtol=1e-3)


def test_nile_with_missing_years(nile):
    """t = 21–40 and 61–80 missing; statsmodels' exact diffuse start gives 17889.6, 685.9 on its own path."""
    z = nile.copy()
    z[20:40] = z[60:80] = np.nan
    found = estimate(z)
    assert (round(found.r, 2), round(found.q, 2), round(found.loglik, 5)) == (17899.84, 685.82, -380.00773)


def test_norwegian_fatalities(norway):
    """0.00326838, 0.0047026 (rounded by the source's optimiser), loglik/n 0.8468622; C&K section 2.3."""
    found = estimate(np.log(norway))
    assert (found.r, found.q) == pytest.approx((0.00326838, 0.0047026), rel=1e-4)
    assert round(found.loglik / 34, 7) == 0.8468622


def test_unemployment_is_the_published_boundary_case(unemployment):
    """KFAS comes to r = 4.26e-6 and −70.97243; at r = 0 exactly q = 0.1182174646 and −70.96771641."""
    found = estimate(unemployment, momentum=0.0)
    assert (found.verdict, found.r, found.params) == ("no_noise", 0.0, None)
    assert found.q == pytest.approx(0.1182174646, rel=1e-5)
    assert round(found.loglik, 8) == -70.96771641


# --- the unit ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_another_unit_gives_the_same_answer(nile, unemployment):
    """statsmodels 0.15 gives (17040, 10156) for the Nile and s = 1e3 with converged=True."""
    gappy, short = walk(300, 0.02, missing=0.2), walk(40, 1.0)
    for z, s in product((nile, gappy, short, unemployment), (1e-9, 0.3e9)):
        one, other = estimate(z), estimate(z * s)
        assert (other.q, other.r) == pytest.approx((one.q * s * s, one.r * s * s), rel=1e-6)
        assert other.ratio_interval == pytest.approx(one.ratio_interval, rel=1e-6)
        assert other.verdict == one.verdict
        assert other.resolution == pytest.approx(one.resolution * s)
        if not one.resolution:  # else it names the step
            assert other.message == one.message


# --- irregular sampling ----------------------------------------------------------------------------------


def test_lines_repeated_with_the_same_time_and_value_prove_nothing():
    z = walk(400, 0.1)
    twice, dt = np.repeat(z, 2), np.tile([1.0, 0.0], 400)
    a, b = estimate(z), estimate(twice, dt=dt)
    assert b.q == pytest.approx(a.q, rel=1e-9)
    assert b.verdict == "ok"


# --- coverage and pile-up --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.001, 1.0] if FUZZ == 1 else [0.001, 0.01, 0.1, 1.0])
def test_the_interval_covers_the_truth_in_95_of_100_records(ratio):
    g = np.random.default_rng(2)
    hits = 0
    for _ in range(200):
        z = np.cumsum(g.normal(0, math.sqrt(ratio), 300)) + g.normal(0, 1, 300)
        low, high = estimate(z, momentum=0.0).ratio_interval
        hits += low <= ratio <= high
    assert 0.92 <= hits / 200 <= 0.98


@pytest.mark.slow
def test_a_signal_that_does_not_move_is_told_so_in_about_65_of_100_records():
    """The pile-up at zero: Shephard & Harvey (1990); 63–66 % with the diffuse start."""
    g = np.random.default_rng(3)
    found = [estimate(g.normal(0, 1, 300), momentum=0.0) for _ in range(200)]
    still = [one for one in found if one.verdict == "no_movement"]
    assert len(still) / 200 == pytest.approx(0.65, abs=0.06)
    assert all(one.q == 0.0 and one.ratio_interval[0] == 0.0 and one.params is None for one in still)
    assert "record longer" in still[0].message


# --- edges in words --------------------------------------------------------------------------------------


POOR = {
    "too_few": [[], [np.nan] * 30, [1.0, 2.0, np.nan, 3.0, 1.0, 2.0, 1.0, 1.5]],
    "constant": [[0.0] * 20],
    "no_movement": [[1.0, 2.0, 1.0, 3.0, 1.0, 2.5, 1.0, 3.5], (-1.0) ** np.arange(40)],
    "no_noise": [[0.0] * 20 + [1.0]],
    "bad_unit": [[1e306, -1e306] * 10, [1e-320, 0.0] * 10],
}


@pytest.mark.parametrize("verdict", POOR)
def test_poor_records_get_a_verdict_and_no_parameters(verdict):
    for found in map(estimate, POOR[verdict]):
        assert (found.verdict, found.params, found.message[-1]) == (verdict, None, ".")
        assert verdict != "bad_unit" or "unit" in found.message
        assert not np.isnan([found.q, found.r, found.ratio, found.loglik, *found.ratio_interval]).any()


# --- any record -----------------------------------------------------------------------------------------


@st.composite
def records(draw):
    """Odd ones: steps, doubles, extreme scales, no time, much missing."""
    n = draw(st.integers(0, 60))
    g = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    z = g.normal(0, 1, n)
    shapes = [z, np.round(z), np.cumsum(z), np.sign(z), (z > 2) * 1.0, np.exp(9 * z), 1e15 + np.round(z)]
    z = draw(st.sampled_from(shapes)) * 10.0 ** draw(st.sampled_from([-250, -9, 0, 9, 250]))
    z[g.random(n) < draw(st.sampled_from([0.0, 0.3, 0.9]))] = np.nan
    steps = [None, np.zeros(n), g.uniform(0, 2, n), g.integers(0, 4, n) * 1.0, 10.0 ** g.uniform(-300, 300, n)]
    return z, draw(st.sampled_from(steps))


@pytest.mark.slow
@given(records())
def test_any_record_gets_numbers_and_words(record):
    z, dt = record
    each = [estimate(z, dt, momentum=0.0, robust=False), estimate(z, dt, momentum=0.0), estimate(z, robust=True)]
    for one in (*each, estimate_fixed_r(z, 1.0, dt), estimate_fixed_ratio(z, 0.01, dt)):
        values = [one.q, one.r, one.ratio, one.loglik, one.q_se, one.r_se]
        values += [*one.ratio_interval, *one.gain_interval, *one.lag_interval]
        assert not np.isnan(values).any()
        assert one.message.endswith(".")
        assert one.params is None or min(one.q, one.r) > 0


# --- manners --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{}, {"dt": [1.0]}, {"dt": [1.0, -1.0]}, {"robust": "yes"}])
def test_bad_settings_are_refused(options):
    with pytest.raises(BadSetting):
        estimate([1.0, 2.0] if options else [1.0, np.inf, 2.0], **options)


# --- one of the two is fixed ----------------------------------------------------------------------------


def test_fixed_r_finds_the_best_q_for_it(nile):
    found = estimate_fixed_r(nile, 10_000.0)
    assert (found.method, found.r) == ("fixed_r", pytest.approx(10_000.0))
    q = found.q * np.linspace(0.8, 1.2, 401)
    best = q[np.argmax([log_likelihood(nile, FilterParams(v, 10_000.0)) for v in q])]
    assert found.q == pytest.approx(best, rel=1.1e-3)
    assert found.loglik == pytest.approx(log_likelihood(nile, FilterParams(found.q, 10_000.0)), rel=1e-12)
    assert found.loglik < estimate(nile).loglik


def test_far_too_large_an_r_leaves_no_movement_and_far_too_small_an_r_takes_all_for_movement(nile):
    assert estimate_fixed_r(nile, 1e7).verdict == "no_movement"
    tiny = estimate_fixed_r(nile, 1e-30)
    assert tiny.verdict == "ok"
    assert tiny.q == pytest.approx(np.mean(np.diff(nile) ** 2), rel=1e-6)


def test_fixed_ratio_finds_the_best_r_for_it(nile):
    found = estimate_fixed_ratio(nile)
    assert found.ratio == pytest.approx(0.01)
    r = found.r * np.linspace(0.9, 1.1, 401)
    best = r[np.argmax([log_likelihood(nile, FilterParams(0.01 * v, v)) for v in r])]
    assert found.r == pytest.approx(best, rel=6e-4)
    assert "contradicts" in found.message  # 0.01 is outside the Nile's 0.0137 … 0.557
    assert "allows" in estimate_fixed_ratio(nile, 0.1).message
    assert found.params is not None


N = 1200


def spiky(share=0.03, size=20.0, beside=1):
    """A record with spikes of both signs, and where they are; `beside` stand side by side with one sign."""
    z, g = walk(N, 0.01), np.random.default_rng(1000)
    where = np.zeros(N, dtype=bool)
    for first in g.choice(N // 8 - 2, round(share * N / beside), replace=False) * 8 + 8:
        where[first : first + beside] = True
        z[first : first + beside] += size * g.choice([-1.0, 1.0])
    return z, where


def fields_of(one, names=()):
    return [getattr(one, name) for name in names or [f.name for f in fields(one) if f.name != "outliers"]]


PAIR = ("q", "r", "ratio", "momentum")


@pytest.mark.slow
@pytest.mark.parametrize("size", [10.0, 100.0, 1e6])
@pytest.mark.parametrize("beside", [1, 2, 3])
def test_it_is_the_fit_of_the_record_without_the_spikes(size, beside):
    z, where = spiky(size=size, beside=beside)
    found = estimate(z)
    np.testing.assert_array_equal(found.outliers, where)
    oracle = estimate(np.where(where, np.nan, z), robust=False)
    assert found.ratio == pytest.approx(oracle.ratio, rel=1e-12)
    assert oracle.r < found.r < 1.002 * oracle.r  # the few good samples beyond 4 σ
    assert (found.plain_q, found.plain_r) == tuple(fields_of(estimate(z, robust=False), ("q", "r")))
    assert found.outlier_share == where.mean()


@pytest.mark.parametrize("seed", range(6))
def test_without_spikes_it_is_the_plain_fit_bit_for_bit(seed):
    z = walk(600, 0.01, seed)
    found, plain = estimate(z), estimate(z, robust=False)
    assert fields_of(found) == fields_of(plain)
    assert (found.outliers, found.gate) == (None, None)


def test_spikes_without_noise_are_left_to_the_gate():
    g = np.random.default_rng(5)
    truth = np.cumsum(g.normal(0.0, 1.0, N))
    z = truth.copy()
    spikes = g.choice(N, N // 100, replace=False)
    z[spikes] += 25.0
    found = estimate(z)
    assert (found.verdict, found.params.gate) == ("only_spikes", found.gate**2)
    assert found.ratio == pytest.approx(found.ratio_interval[0])
    assert found.r == found.params.r < 0.05
    first, plain = (kalman_filter(z, one.params).x - truth for one in (found, estimate(z, robust=False)))
    assert np.std(first) < 0.5 * np.std(plain)


@pytest.mark.slow
@pytest.mark.parametrize("length", [3, GATE_LIMIT, GATE_LIMIT + 1, N])
def test_a_step_and_a_lone_pulse_are_movements(length):
    z = walk(N, 0.01)
    z[500 : 500 + length] += 30.0
    assert fields_of(estimate(z)) == fields_of(estimate(z, robust=False))


@pytest.mark.slow
@pytest.mark.parametrize("ends", [[0], [0, 1], [N - 1], [N - 2, N - 1], [0, N - 1]])
def test_the_ends_are_judged_by_their_only_side(ends):
    z = walk(N, 0.01)
    z[ends] += 40.0
    assert np.flatnonzero(estimate(z).outliers).tolist() == ends


@pytest.mark.slow
def test_missing_samples_and_long_steps_say_the_same():
    z, where = spiky()
    gone = np.zeros(N, dtype=bool)
    gone[5::7] = True
    gone[400:420] = True
    holes = np.where(gone, np.nan, z)
    present = ~gone
    steps = np.diff(np.flatnonzero(present), prepend=-1).astype(float)
    one, other = estimate(holes), estimate(z[present], dt=steps)
    np.testing.assert_array_equal(one.outliers, where & present)
    np.testing.assert_array_equal(one.outliers[present], other.outliers)
    assert fields_of(one, PAIR) == fields_of(other, PAIR)
    assert one.outlier_share == other.outlier_share == (where & present).sum() / present.sum()


def test_too_many_are_refused_with_words():
    z, where = spiky(share=0.24, beside=2)
    found = estimate(z)
    assert found.outlier_share > MAX_SHARE
    assert (found.verdict, found.params) == ("too_many_outliers", None)
    assert "Check the wiring" in found.message
    assert np.mean(found.outliers == where) > 0.99


@pytest.mark.parametrize("known", [lambda z, **k: estimate_fixed_r(z, 1.0, **k), estimate_fixed_ratio])
def test_one_known_variance_is_spike_proof_too(known):
    z, where = spiky()
    found = known(z)
    np.testing.assert_array_equal(found.outliers, where)
    oracle = known(np.where(where, np.nan, z), robust=False)
    assert found.q == pytest.approx(oracle.q, rel=2e-3)
    assert known(z, robust=False).outliers is None


def test_one_step_of_a_coarse_converter_is_no_spike():
    z = walk(N, 0.001)
    coarse = np.round(z / 6.0) * 6.0
    assert estimate(coarse).outliers is None
    coarse[[100, 600, 601]] += 60.0
    assert np.flatnonzero(estimate(coarse).outliers).tolist() == [100, 600, 601]


@pytest.mark.slow
def test_impacts_that_no_gate_can_tell_from_movement_stay_in_the_fit():
    g = np.random.default_rng(8)
    z = np.cumsum(g.standard_t(2.0, N))
    z[g.choice(N, 3 * N // 100, replace=False)] += 25.0
    found, plain = estimate(z), estimate(z, robust=False)
    assert fields_of(found, PAIR) == fields_of(plain, PAIR)
    assert (plain.verdict, found.gate) == ("ok", None)
    assert "stay in the fit" in found.message
    assert estimate(z, robust=True).verdict == "no_noise"
