"""Laws and oracles of the filter: the seed documents' programs stand here as they are printed."""

from __future__ import annotations

import math
import shutil
import subprocess

import numpy as np
import pytest
from each import each
from five_lines import assert_same_bits, five_lines
from hypothesis import given
from hypothesis import strategies as st

from kalscope import (
    BadSetting,
    FilterParams,
    KalmanFilter,
    FilterParams,
    KalmanFilter,
    denoise,
    kalman_filter,
    smooth,
    starting_params,
)
from kalscope.filtering.kernels import GATE_LIMIT

NILE_Q, NILE_R = 1469.1, 15099.0


def noisy_walk(n=2000, q=0.01, r=1.0, seed=0, missing=0.0):
    g = np.random.default_rng(seed)
    z = np.cumsum(g.normal(0, math.sqrt(q), n)) + g.normal(0, math.sqrt(r), n)
    z[g.random(n) < missing] = np.nan
    return z


# --- the source documents -------------------------------------------------------------------------------


def test_matlab_appendix_of_the_first_paper_is_reproduced():
    """Ma'arif et al. (2019), appendix a: R = 100, Q = 1, P0 = 0, x0 = 0, z = (rand - rand)·100."""
    g = np.random.default_rng(1)
    xk, Pk, R, Q = 0.0, 0.0, 100.0, 1.0
    buff_xk, buff_zk = [], []
    for _ in range(100):
        zk = (g.random() - g.random()) * 100
        Pk = Pk + Q
        Kk = Pk / (Pk + R)
        xk = xk + (Kk * (zk - xk))
        Pk = (1 - Kk) * Pk
        buff_xk.append(xk)
        buff_zk.append(zk)
    result = kalman_filter(buff_zk, FilterParams(q=Q, r=R, p0=0.0, x0=0.0))
    assert result.x == pytest.approx(np.array(buff_xk), rel=1e-12, abs=1e-12)
    assert (result.p[-1], result.k[-1]) == pytest.approx((Pk, Kk), rel=1e-12)


def test_arduino_appendix_of_the_first_paper_is_reproduced():
    """Ma'arif et al. (2019), appendix b: R = 100, Q = 1, Pt_prev = 1, Xt_prev = 0; in double."""
    g = np.random.default_rng(2)
    sensor = g.integers(480, 540, 300).astype(float)
    R, Q, Pt_prev, Xt_prev, printed = 100.0, 1.0, 1.0, 0.0, []
    for SensorData in sensor:
        Xt_update = Xt_prev
        Pt_update = Pt_prev + Q
        Kt = Pt_update / (Pt_update + R)
        Xt = Xt_update + (Kt * (SensorData - Xt_update))
        Pt = (1 - Kt) * Pt_update
        Xt_prev, Pt_prev = Xt, Pt
        printed.append(Xt)
    assert kalman_filter(sensor, FilterParams(q=Q, r=R, p0=1.0, x0=0.0)).x == pytest.approx(
        np.array(printed), rel=1e-12
    )


def test_c_listing_of_the_third_document_compiled_by_gcc_agrees(tmp_path):
    """Interactive matter (2009): kalman_init and kalman_update as printed, compiled, on 1,000 samples."""
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("gcc is not installed")
    (tmp_path / "kalman.c").write_text(C_LISTING)
    program = tmp_path / "kalman"
    # x87-free double arithmetic without contraction, as C99 says: a * b + c in two roundings.
    subprocess.run([gcc, "-O1", "-ffp-contract=off", "-o", program, tmp_path / "kalman.c"], check=True)
    z = np.round(noisy_walk(1000, q=4.0, r=30.0), 3)
    text = "\n".join(map(repr, z.tolist()))
    for q, r, p, x in ((0.125, 1.0, 1023.0, 0.0), (4.0, 32.0, 1.0, 10.0), (128.0, 4.0, 0.0, -3.0)):
        command = [program, repr(q), repr(r), repr(p), repr(x)]
        done = subprocess.run(command, input=text, text=True, capture_output=True, check=True)
        expected = [float.fromhex(line) for line in done.stdout.split()]
        assert kalman_filter(z, FilterParams(q, r, p, x)).x == pytest.approx(
            np.array(expected), rel=1e-12, abs=1e-12
        )


C_LISTING = r"""
#include <stdio.h>
#include <stdlib.h>
typedef struct { double q; double r; double x; double p; double k; } kalman_state;
kalman_state kalman_init(double q, double r, double p, double intial_value) {
  kalman_state result;
  result.q = q; result.r = r; result.p = p; result.x = intial_value;
  return result;
}
void kalman_update(kalman_state* state, double measurement) {
  state->p = state->p + state->q;
  state->k = state->p / (state->p + state->r);
  state->x = state->x + state->k * (measurement - state->x);
  state->p = (1 - state->k) * state->p;
}
int main(int argc, char** argv) {
  kalman_state s = kalman_init(atof(argv[1]), atof(argv[2]), atof(argv[3]), atof(argv[4]));
  double z;
  while (scanf("%lf", &z) == 1) { kalman_update(&s, z); printf("%a\n", s.x); }
  return 0;
}
"""


def test_kalmanjs_readme_vector_is_reproduced():
    """Which prints 3, 2.3333333333333335, 1.5000000000000002; it multiplies in another order."""
    x = kalman_filter([3.0, 2.0, 1.0], FilterParams(1.0, 1.0)).x
    assert x == pytest.approx([3.0, 2.3333333333333335, 1.5000000000000002], rel=1e-15)


def test_nile_steps_and_log_likelihood_are_the_published_ones(nile):
    """Durbin & Koopman (2012), section 2.10; log-likelihood in the n - 1 convention, as KFAS prints it."""
    result = kalman_filter(nile, FilterParams(NILE_Q, NILE_R))
    assert result.x[:4] == pytest.approx([1120.0, 1140.92784, 1072.79853, 1117.30895], abs=5e-6)
    assert result.innovation[1:4] == pytest.approx([40.0, -177.92784, 137.20147], abs=5e-6)
    assert result.s[1:4] == pytest.approx([31667.1, 24467.83638, 22349.56994], abs=5e-6)
    assert result.p[-1] == pytest.approx(4032.158, abs=1e-3)
    assert result.k[-1] == pytest.approx(0.267048, abs=1e-6)
    assert result.m == 99
    assert kalman_filter(nile, FilterParams(1469.18, 15098.52)).loglik == pytest.approx(-632.5456, abs=5e-5)


def test_a_start_variance_far_above_r_is_the_unknown_start():
    """Where 1 - k is 0 in double, p = (1 - k) p would keep the first sample for ever."""
    z = noisy_walk(500, q=0.0, seed=7)
    for momentum, p0 in ((0.0, 1e17), (0.0, 1e300), (5.0, 1e17)):
        params = FilterParams(q=0.0, r=1.0, p0=p0, x0=0.0, momentum=momentum)
        means = np.cumsum(z) / np.arange(1, len(z) + 1)
        assert kalman_filter(z, params).x == pytest.approx(means, rel=1e-9)
        assert smooth(z, params).x == pytest.approx(np.full(len(z), means[-1]), rel=1e-9)


# --- laws -----------------------------------------------------------------------------------------------


@each("start", [(None, None), (100.0, None), (0.0, 0.0), (1.0, -5.0)])
@each("missing", [0.0, 0.2])
@each("irregular", [False, True])
def test_filter_equals_the_five_lines_bit_for_bit(start, missing, irregular):
    z = noisy_walk(3000, missing=missing, seed=3)
    if missing:
        z[:4] = np.nan
    dt = np.random.default_rng(4).integers(0, 4, len(z)).astype(float) if irregular else None
    p0, x0 = start
    result = kalman_filter(z, FilterParams(0.01, 1.0, p0, x0), dt)
    p, x = (math.inf if p0 is None else p0), (math.nan if x0 is None else x0)
    expected = five_lines(z, 0.01, 1.0, p, x, dt)
    for seen, wanted in zip((result.x, result.p, result.k, result.innovation, result.s), expected, strict=True):
        assert_same_bits(seen, wanted)


def test_log_likelihood_is_the_sum_of_gaussian_log_densities():
    z = noisy_walk(500, missing=0.1)
    result = kalman_filter(z, FilterParams(0.02, 0.9))
    v, s = result.innovation, result.s
    scored = np.isfinite(v) & np.isfinite(s)
    expected = -0.5 * np.sum(np.log(2 * np.pi * s[scored]) + v[scored] ** 2 / s[scored])
    assert result.loglik == pytest.approx(expected, rel=1e-12)
    assert result.m == scored.sum()


@given(
    z=st.lists(st.floats(-1e6, 1e6) | st.just(math.nan), min_size=1, max_size=60),
    q=st.floats(0, 1e6),
    r=st.floats(1e-9, 1e6),
    p0=st.none() | st.floats(0, 1e6),
    gate=st.none() | st.floats(0.1, 100),
    data=st.data(),
)
def test_streaming_equals_batch_bit_for_bit(z, q, r, p0, gate, data):
    params = FilterParams(q, r, p0, gate=gate)
    dt = data.draw(st.none() | st.lists(st.floats(0, 9), min_size=len(z), max_size=len(z)))
    result = kalman_filter(z, params, dt)
    stream = KalmanFilter(params)
    states = []
    for i, sample in enumerate(z):
        returned = stream.update(sample, None if dt is None else dt[i])
        states.append((returned, stream.x, stream.p, stream.k))
    returned, x, p, k = zip(*states, strict=True)
    assert_same_bits(result.x, returned)
    assert_same_bits(result.x, x)
    assert_same_bits(result.p, p)
    assert_same_bits(result.k, k)


def test_streaming_equals_batch_bit_for_bit_over_a_long_settled_record():
    z = noisy_walk(5000, missing=0.001, seed=9)
    stream = KalmanFilter(FilterParams(0.3, 1.0))
    assert_same_bits(kalman_filter(z, FilterParams(0.3, 1.0)).x, [stream.update(s) for s in z])


@each("ratio", [1e-8, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 1e4])
@each("missing", [0.0, 0.01])
def test_denoise_is_within_1e_12_of_the_filter(ratio, missing):
    z = 100.0 + noisy_walk(60_000, q=ratio, missing=missing, seed=5)
    params = FilterParams(ratio, 1.0)
    error = np.nanmax(np.abs(denoise(z, params) - kalman_filter(z, params).x))
    assert error <= 1e-12 * np.nanmax(np.abs(z))


def test_denoise_with_dt_or_gate_equals_the_filter():
    z = noisy_walk(3000, missing=0.05, seed=6)
    dt = np.random.default_rng(1).random(len(z)) * 3
    for params in (FilterParams(0.05, 1.0), FilterParams(0.05, 1.0, gate=4.0)):
        assert_same_bits(denoise(z, params, dt), kalman_filter(z, params, dt).x)
        assert_same_bits(
            denoise(z, params.__class__(0.05, 1.0, gate=4.0)),
            kalman_filter(z, FilterParams(0.05, 1.0, gate=4.0)).x,
        )


def test_denoise_writes_into_out_and_may_work_in_place():
    z = noisy_walk(1000)
    params = FilterParams(0.1, 1.0)
    expected = denoise(z, params)
    out = np.empty_like(z)
    assert denoise(z, params, out=out) is out
    assert_same_bits(out, expected)
    in_place = z.copy()
    denoise(in_place, params, out=in_place)
    assert_same_bits(in_place, expected)
    overlapping = np.concatenate([z, [0.0]])
    denoise(overlapping[:-1], params, out=overlapping[1:])
    assert_same_bits(overlapping[1:], expected)


def test_channels_are_independent_filters():
    z = np.column_stack([noisy_walk(800, seed=s, missing=0.05) for s in range(3)])
    params = FilterParams([0.1, 0.01, 1.0], 1.0, p0=2.0, x0=[0.0, 1.0, 2.0])
    both = kalman_filter(z, params)
    fast = denoise(z, params)
    stream = KalmanFilter(params)
    rows = np.array([stream.update(row) for row in z])
    for c, q in enumerate((0.1, 0.01, 1.0)):
        alone = kalman_filter(z[:, c], FilterParams(q, 1.0, 2.0, float(c)))
        assert_same_bits(both.x[:, c], alone.x)
        assert_same_bits(rows[:, c], alone.x)
        assert both.loglik[c] == alone.loglik
        assert both.m[c] == alone.m
        assert np.nanmax(np.abs(fast[:, c] - alone.x)) < 1e-12 * np.nanmax(np.abs(z))


def test_a_gap_of_three_periods_equals_three_missing_samples():
    z = np.array([1.0, 2.0, math.nan, math.nan, 5.0, 4.0])
    with_nan = kalman_filter(z, FilterParams(0.5, 2.0))
    with_dt = kalman_filter([1.0, 2.0, 5.0, 4.0], FilterParams(0.5, 2.0), dt=[1, 1, 3, 1])
    assert with_dt.x[2:] == pytest.approx(with_nan.x[4:], rel=1e-15)
    assert with_dt.loglik == pytest.approx(with_nan.loglik, rel=1e-15)


def test_before_the_first_sample_of_a_diffuse_start_nothing_is_known():
    result = kalman_filter([math.nan, math.nan, 7.0], FilterParams(1.0, 2.0))
    assert np.isnan(result.x[:2]).all()
    assert np.isinf(result.p[:2]).all()
    assert result.k.tolist() == [0.0, 0.0, 1.0]
    assert (result.x[2], result.p[2], result.m) == (7.0, 2.0, 0)


def test_a_given_p0_without_x0_starts_at_the_first_sample_unscored():
    result = kalman_filter([7.0, 8.0], FilterParams(1.0, 2.0, p0=3.0))
    assert result.x[0] == 7.0
    assert result.p[0] == pytest.approx(4.0 * 2.0 / 6.0)
    assert result.m == 1


def test_scaling_q_r_and_p0_together_leaves_the_estimate_unchanged():
    z = noisy_walk(400)
    one = kalman_filter(z, FilterParams(0.1, 1.0, 5.0, 0.0))
    four = kalman_filter(z, FilterParams(0.4, 4.0, 20.0, 0.0))
    assert_same_bits(one.x, four.x)


def test_a_large_p0_approaches_the_diffuse_start():
    z = noisy_walk(400)
    diffuse = kalman_filter(z, FilterParams(0.1, 1.0))
    vague = kalman_filter(z, FilterParams(0.1, 1.0, p0=1e9, x0=0.0))
    assert vague.x == pytest.approx(diffuse.x, abs=1e-6)


def test_predicting_never_lowers_and_updating_never_raises_the_variance():
    z = noisy_walk(300, missing=0.2)
    result = kalman_filter(z, FilterParams(0.1, 1.0, p0=0.5))
    predicted = result.s - 1.0
    before = np.concatenate([[0.5], result.p[:-1]])
    assert (predicted >= before).all()
    assert (result.p <= predicted + 1e-15).all()
    assert (result.p[np.isfinite(z)] < predicted[np.isfinite(z)]).all()


def test_dt_zero_puts_the_prior_at_the_first_sample(nile):
    """MARSS user guide, KFAS columns Cs206…: a1 = 0, P1 = 1000, q = 15210.195, r = 33874.59."""
    dt = np.ones(len(nile))
    dt[0] = 0.0
    result = kalman_filter(nile, FilterParams(15210.195, 33874.59, p0=1000.0, x0=0.0), dt)
    assert result.x[:5] == pytest.approx([32.11507, 396.72378, 643.48197, 909.42338, 1029.38565], abs=1e-5)
    assert result.innovation[:5] == pytest.approx([1120, 1127.8849, 566.2762, 566.5180, 250.5766], abs=5e-5)
    assert result.loglik == pytest.approx(-697.8576, abs=5e-5)


# --- the gate -------------------------------------------------------------------------------------------


def test_the_gate_skips_a_spike_and_counts_it():
    z = noisy_walk(400, seed=8)
    z[200] += 50.0
    open_, gated = (kalman_filter(z, FilterParams(0.01, 1.0, gate=g)) for g in (None, 25.0))
    assert (open_.rejected, gated.rejected) == (0, 1)
    assert gated.k[200] == 0.0
    assert gated.x[200] == gated.x[199]
    assert abs(gated.x[200] - open_.x[200]) > 1.0
    assert gated.m == open_.m - 1


def test_the_gate_cannot_lock_out_a_step():
    z = np.concatenate([np.zeros(50), np.full(50, 1e6)])
    result = kalman_filter(z, FilterParams(1e-6, 1.0, gate=9.0))
    refused = np.flatnonzero(result.k[50:] == 0.0)
    assert refused[:GATE_LIMIT].tolist() == list(range(GATE_LIMIT))
    assert result.k[50 + GATE_LIMIT] > 0.0


def test_a_masked_sample_is_missing():
    masked, plain = np.ma.array([1, 2, 5, 4], mask=[False, True, False, False]), [1, math.nan, 5, 4]
    params = FilterParams(1, 1)
    np.testing.assert_array_equal(kalman_filter(masked, params).x, kalman_filter(plain, params).x)
    np.testing.assert_array_equal(KalmanFilter(params).update(masked), KalmanFilter(params).update(plain))
    assert starting_params(masked).r == starting_params(plain).r


# --- what is refused ------------------------------------------------------------------------------------


@each(
    ("call", "message"),
    [
        (
            lambda: kalman_filter([1.0, math.inf], FilterParams(1, 1)),
            "finite, or NaN where missing (got inf at sample 1)",
        ),
        (lambda: denoise([1.0] * 99 + [-math.inf], FilterParams(1, 1)), "(got -inf at sample 99)"),
        (lambda: kalman_filter([[[1.0]]], FilterParams(1, 1)), "shape (n,) or (n, channels) (got (1, 1, 1))"),
        (lambda: kalman_filter(["a"], FilterParams(1, 1)), "z must be an array of numbers"),
        (lambda: denoise(np.array([1.0 + 2.0j]), FilterParams(1, 1)), "z must be an array of real numbers"),
        (lambda: kalman_filter([1.0, 2.0], FilterParams(1, 1), dt=[1.0]), "shape (2,) (got (1,))"),
        (lambda: kalman_filter([1.0, 2.0], FilterParams(1, 1), dt=[1.0, -1.0]), "not negative"),
        (lambda: kalman_filter([1.0], FilterParams([1, 1], 1)), "they hold 2 channels (got z with 1)"),
        (lambda: denoise([1.0], FilterParams(1, 1), out=np.empty(2)), "out must be a float64 array"),
        (lambda: KalmanFilter(FilterParams(1, 1)).update(math.inf), "finite, or NaN where missing (got inf)"),
        (lambda: KalmanFilter(FilterParams(1, 1)).update(1.0, dt=-1), "dt must be finite and not negative"),
        (lambda: KalmanFilter(FilterParams(1, 1)).update(1.0, dt="a"), "dt must be finite and not negative"),
        (lambda: KalmanFilter(FilterParams(1, [1, 1])).update([1.0, 1.0], dt="a"), "dt must be finite"),
        (lambda: kalman_filter([1.0], FilterParams(1, 1), dt=["a"]), "dt must be an array of numbers"),
    ],
)
def test_what_cannot_be_filtered_is_refused_with_its_reason(call, message):
    with pytest.raises(BadSetting) as refused:
        call()
    assert message in str(refused.value)


def test_a_refused_sample_leaves_the_stream_as_it_was():
    stream = KalmanFilter(FilterParams(1, 1))
    stream.update(3.0)
    with pytest.raises(BadSetting):
        stream.update(math.inf)
    assert stream.update(2.0) == kalman_filter([3.0, 2.0], FilterParams(1, 1)).x[-1]


@each(("q", "r"), [(0, 1), (1, 0), (1e300, 1e-300), (1e-300, 1e300), (1e300, 1e300), (1e-300, 1e-300)])
def test_extreme_variances_give_finite_answers(q, r):
    z = noisy_walk(500, missing=0.1)
    for start in ((None, None), (0.0, 1.0), (1e300, 1.0)):
        params = FilterParams(q, r, *start)
        result = kalman_filter(z, params)
        assert np.isfinite(result.x).all()
        assert ((result.k >= 0) & (result.k <= 1)).all()
        assert np.abs(denoise(z, params) - result.x).max() <= 1e-12 * np.nanmax(np.abs(z))


def test_empty_and_single_records_are_fine():
    assert kalman_filter([], FilterParams(1, 1)).x.shape == (0,)
    assert denoise([], FilterParams(1, 1)).shape == (0,)
    assert denoise([4.0], FilterParams(1, 1)).tolist() == [4.0]
