"""The documents: their programs as oracles, published numbers, and both readings of equation (3) of Khan et al.

The MATLAB appendix runs in Octave, the C listing and the Arduino appendix through a compiler. They stand here as
printed; only their input and output are replaced.
"""

from __future__ import annotations

import math
import shutil
import subprocess

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.required import not_here

from kalscope.errors import BadSetting
from kalscope.filtering.filter import denoise, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.papers import interactive_matter_2009 as lis302dl
from kalscope.papers import maarif_2019 as noise_reducer
from kalscope.papers.generalized import GeneralizedParams, printed_gain
from kalscope.papers.reproduction import list_experiments, open_experiment

# Appendix a of Ma'arif et al. (2019), with zk = (rand-rand)*100 read from Z and without the plot.
MATLAB = """
xk = 0; Pk = 0; R = {r}; Q = {q};
Z = [{z}];
for kk=1:100
    zk = Z(kk);
    Pk = Pk + Q;
    Kk = Pk / ( Pk + R );
    xk = xk + (Kk * (zk - xk) );
    Pk = (1-Kk)*Pk;
    buff_xk(kk) = xk;
    buff_zk(kk) = zk;
end
printf('%.17g\\n', buff_xk)
"""

# The listing of interactive matter (2009).
C_LISTING = """
#include <stdio.h>
#include <stdlib.h>
typedef struct {
  double q; //process noise covariance
  double r; //measurement noise covariance
  double x; //value
  double p; //estimation error covariance
  double k; //kalman gain
} kalman_state;

kalman_state
kalman_init(double q, double r, double p, double intial_value)
{
   kalman_state result;
   result.q = q;
   result.r = r;
   result.p = p;
   result.x = intial_value;
   return result;
}

void
kalman_update(kalman_state* state, double measurement)
{
   //prediction update
   //omit x = x
   state->p = state->p + state->q;

   //measurement update
   state->k = state->p / (state->p + state->r);
   state->x = state->x + state->k * (measurement - state->x);
   state->p = (1 - state->k) * state->p;
}

int main(int argc, char** argv)
{
   kalman_state s = kalman_init(atof(argv[1]), atof(argv[2]), atof(argv[3]), atof(argv[4]));
   double z;
   while (fread(&z, sizeof z, 1, stdin) == 1) {
      kalman_update(&s, z);
      fwrite(&s.x, sizeof s.x, 1, stdout);
      fwrite(&s.p, sizeof s.p, 1, stdout);
      fwrite(&s.k, sizeof s.k, 1, stdout);
   }
   return argc - 5;
}
"""

# Appendix b of Ma'arif et al. (2019), between a board made of stdio and its main().
ARDUINO = """
#include <cstdio>
static double reading;
static int A0 = 0;
static bool more() { return std::fread(&reading, sizeof reading, 1, stdin) == 1; }
static double analogRead(int) { return reading; }
static void delayMicroseconds(int) {}
static struct {
  int column;
  void begin(int) {}
  void print(double value, int) { if (column++ == 1) std::fwrite(&value, sizeof value, 1, stdout); }
  void print(const char*) {}
  void println() { column = 0; }
} Serial;
#define float NUMBER

float SensorData, KalmanFilterData;
float Xt, Xt_update, Xt_prev;
float Pt, Pt_update, Pt_prev;
float Kt, R, Q;

void setup() {
    Serial.begin(9600);
    R=100; Q=1; Pt_prev=1;
}

void loop() {
    SensorData = analogRead(A0);
    Xt_update = Xt_prev;
    Pt_update = Pt_prev + Q;

    Kt = Pt_update / (Pt_update + R);
    Xt = Xt_update + ( Kt * (SensorData - Xt_update));
    Pt = (1 - Kt) * Pt_update;

    Xt_prev = Xt;
    Pt_prev = Pt;

    KalmanFilterData=Xt;

    Serial.print (SensorData,3);
    Serial.print (",");
    Serial.print (KalmanFilterData,3);
    Serial.println();

    delayMicroseconds (100);
}

#undef float
int main() { setup(); while (more()) loop(); }
"""


def tool(*names):
    """The first of these programs that is installed; without one the test is skipped, or fails where CI asks."""
    for name in names:
        if path := shutil.which(name):
            return path
    return not_here(f"{' or '.join(names)} is not installed")


def run(command, data=b""):
    return subprocess.run([str(part) for part in command], input=data, check=True, capture_output=True).stdout


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Compile a program without fused multiply-add, which would round differently."""
    folder = tmp_path_factory.mktemp("originals")

    def build(name, text, compiler, *flags):
        source = folder / name
        source.write_text(text)
        program = source.with_suffix(".exe")
        run([tool(compiler), "-O2", "-ffp-contract=off", *flags, source, "-o", program])
        return program

    return build


def test_the_matlab_appendix_in_octave_is_our_filter():
    rng = np.random.default_rng(2019)
    z = (rng.random(100) - rng.random(100)) * 100.0
    pairs = [(100.0, 1.0), *((r, q) for _, r, q in noise_reducer.SIMULATED_FIGURES)]
    scripts = (MATLAB.format(r=repr(r), q=repr(q), z=" ".join(map(repr, z.tolist()))) for r, q in pairs)
    octave = tool("octave-cli", "octave"), "--norc", "--quiet", "--eval"
    theirs = np.array(run([*octave, "".join(scripts)]).split(), dtype=np.float64).reshape(-1, 100)
    for (r, q), x in zip(pairs, theirs, strict=True):
        params = FilterParams(q=q, r=r, p0=0.0, x0=0.0)
        np.testing.assert_allclose(kalman_filter(z, params).x, x, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("name", "q", "r"), lis302dl.WALK)
def test_the_c_listing_compiled_by_gcc_is_our_filter(compiled, name, q, r):
    program = compiled("listing.c", C_LISTING, "gcc")
    z = lis302dl.moved_board().values
    params = lis302dl.walk_params(q, r)
    ours = kalman_filter(z, params)
    for axis in range(3):
        out = run([program, repr(q), repr(r), lis302dl.P0, lis302dl.X0], z[:, axis].tobytes())
        x, p, k = np.frombuffer(out).reshape(-1, 3).T
        np.testing.assert_allclose(ours.x[:, axis], x, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(ours.p[:, axis], p, rtol=1e-12)
        np.testing.assert_allclose(ours.k[:, axis], k, rtol=1e-12)


@pytest.mark.parametrize(("number", "tolerance"), [("double", 1e-10), ("float", 1e-3)])
def test_the_arduino_appendix_is_our_filter(compiled, number, tolerance):
    """In double but for rounding; in the board's float within 0.001 counts of readings up to 387."""
    program = compiled(f"arduino_{number}.cpp", ARDUINO, "g++", f"-DNUMBER={number}")
    counts = noise_reducer.robot_recording().values[:, 0]
    theirs = np.frombuffer(run([program], counts.tobytes()))
    ours = kalman_filter(counts, FilterParams(q=1.0, r=100.0, p0=1.0, x0=0.0)).x
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance)


# ---- published numbers, and the laws behind them


@pytest.mark.parametrize("ratio", [10.0, 1.0, 0.1, 0.01, 0.001])
def test_the_mean_error_formula_holds_on_a_long_record(ratio):
    """c σ (1 − K) √(2/(2 − K)) within 1.5 % on 200,000 samples."""
    z = noise_reducer.white_noise(1, samples=200_000, seed=8)[:, 0]
    x = denoise(z, FilterParams(q=ratio, r=1.0))
    formula = noise_reducer.theoretical_mean_error(ratio, noise_reducer.SIGMA)
    gain = steady_state(FilterParams(q=ratio, r=1.0)).gain
    assert formula == pytest.approx(math.sqrt(2 / math.pi) * 72 * (1 - gain) * math.sqrt(2 / (2 - gain)))
    assert noise_reducer.mean_error(z, x) == pytest.approx(formula, rel=0.015)
    assert np.sqrt(np.mean(x * x)) == pytest.approx(noise_reducer.theoretical_rmse(ratio, 72.0), rel=0.03)


def test_mean_error_rewards_no_filter_and_rmse_does_not():
    z, table = noise_reducer.white_noise(1)[:, 0], noise_reducer.simulate_table(200)
    assert noise_reducer.mean_error(z, denoise(z, FilterParams(q=1.0, r=0.0))) < 1e-12
    assert (np.diff([row["simulated"] for row in table]) > -1e-9).all()  # rows 3 and 4 are equal
    assert (np.diff([row["rmse"] for row in table]) < 1e-9).all()


@pytest.mark.slow
def test_experiments_open_with_settings_for_every_channel_and_others_are_refused():
    names = [experiment.name for experiment in list_experiments()]
    assert len(set(names)) == len(names) == 20
    for experiment in list_experiments():
        recording, filters = open_experiment(experiment.name)
        assert recording.source == f"experiment:{experiment.name}"
        assert recording.title == experiment.title
        assert tuple(filters) == recording.names
        again, _ = open_experiment(recording.source)
        np.testing.assert_array_equal(again.values, recording.values)
    with pytest.raises(BadSetting, match=r"experiment must be one of noise_reducer_figure_3.*got 'x'"):
        open_experiment("experiment:x")


SIGNAL = 50.0 + np.random.default_rng(3).normal(0.0, 4.0, 400)


def test_the_printed_reading_is_the_three_printed_equations_and_a_missing_sample_changes_nothing():
    e, sigma_e, sigma_m, rows = 20.0, 7.0, 100.0, []
    for m in SIGNAL.tolist():
        k = sigma_e / (sigma_e + sigma_m)
        e, sigma_e = e + k * (m - e), (1 - k) * e
        rows.append((e, sigma_e, k))
    gappy = np.insert(SIGNAL, [4, 4, 9], np.nan)
    result, kept = GeneralizedParams(100.0, sigma_e0=7.0, e0=20.0).run(gappy), np.isfinite(gappy)
    np.testing.assert_array_equal(np.stack([result.x, result.p, result.k])[:, kept], np.array(rows).T)
    assert (result.k[~kept] == 0.0).all()
    assert np.isnan(result.innovation[~kept]).all()


@pytest.mark.parametrize("start", [{}, {"sigma_e0": 3.0}, {"sigma_e0": 3.0, "e0": 10.0}])
def test_without_the_slip_it_is_the_five_line_filter_with_q_0(start):
    z = SIGNAL.copy()
    z[[0, 5, 6]] = np.nan
    ours = GeneralizedParams(16.0, reading="without_slip", **start).run(z)
    five = kalman_filter(z, FilterParams(q=0.0, r=16.0, p0=start.get("sigma_e0"), x0=start.get("e0")))
    for field in ("x", "p", "k", "innovation", "s"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(five, field))
    assert (ours.loglik, ours.m) == (five.loglik, five.m)


@given(st.floats(1e-3, 1e6), st.floats(1e-3, 1e6))
def test_the_fixed_point_solves_its_quadratic(level, sigma_m):
    gain = printed_gain(level, sigma_m)
    s = (1 - gain) * level  # equation (3) at rest
    assert s * s + sigma_m * s == pytest.approx(sigma_m * level, rel=1e-9)


@pytest.mark.parametrize("z", [[0.0], [-3.0], [3.0, -50.0], [np.nan, 3.0, np.nan, -50.0]])
def test_at_zero_and_below_the_printed_reading_says_what_must_hold(z):
    params = GeneralizedParams(4.0)
    with pytest.raises(BadSetting, match=r"needs estimates above 0.*without_slip"):
        params.run([*z, 1.0])
    stream = params.stream()
    for sample in z[:-1]:
        stream.update(sample)
    with pytest.raises(BadSetting, match="needs estimates above 0"):
        stream.update(z[-1])


@pytest.mark.parametrize("reading", ["printed", "without_slip"])
@pytest.mark.parametrize("start", [{}, {"sigma_e0": 2.0, "e0": 90.0}])
def test_batch_and_stream_agree_bit_for_bit_whatever_was_refused(reading, start):
    z = np.array(SIGNAL)
    z[[0, 3]] = np.nan
    params = GeneralizedParams(30.0, reading=reading, **start)
    stream, x = params.stream(), params.run(z).x
    for i, sample in enumerate(z):
        np.testing.assert_array_equal(stream.update(sample), x[i])
        for bad, dt in ((math.inf, None), (1.0, -1.0), ([1.0], None)):
            with pytest.raises(BadSetting, match="must be"):
                stream.update(bad, dt)


def test_bad_settings_and_data_are_named():
    for settings, says in (
        ({"sigma_m": 0.0}, "sigma_m must be"),
        ({"sigma_m": math.nan}, "sigma_m must be"),
        ({"sigma_m": "a"}, "sigma_m must be"),
        ({"sigma_e0": -1.0}, "sigma_e0 must be"),
        ({"e0": 0.0}, "e0 must be"),
        ({"e0": 0.0, "reading": "without_slip"}, "e0 needs sigma_e0"),
        ({"reading": "slip"}, "reading must be one of"),
    ):
        with pytest.raises(BadSetting, match=says):
            GeneralizedParams(**{"sigma_m": 1.0, **settings})
    for z, dt, says in (([1.0, math.inf], None, "z must be finite"), ([1.0], [-1.0], "dt must be finite")):
        with pytest.raises(BadSetting, match=says):
            GeneralizedParams(1.0).run(z, dt)
