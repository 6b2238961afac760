"""The documents' own programs as oracles: the MATLAB appendix in Octave, the C listing and the Arduino appendix
through a compiler. The programs stand here as printed; only their input and output are replaced.
"""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest
from tests.support.required import not_here

from kalscope.filtering.filter import KalmanFilter, denoise, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.papers import interactive_matter_2009 as lis302dl
from kalscope.papers import maarif_2019 as noise_reducer

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
        np.testing.assert_allclose(denoise(z, params), x, rtol=0, atol=1e-12 * np.abs(z).max())


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
        stream = KalmanFilter(params)
        np.testing.assert_array_equal([stream.update(float(value)) for value in z[:, axis]], ours.x[:, axis])


@pytest.mark.parametrize(("number", "tolerance"), [("double", 1e-10), ("float", 1e-3)])
def test_the_arduino_appendix_is_our_filter(compiled, number, tolerance):
    """In double but for rounding; in the board's float within 0.001 counts of readings up to 387."""
    program = compiled(f"arduino_{number}.cpp", ARDUINO, "g++", f"-DNUMBER={number}")
    counts = noise_reducer.robot_recording().values[:, 0]
    theirs = np.frombuffer(run([program], counts.tobytes()))
    ours = kalman_filter(counts, FilterParams(q=1.0, r=100.0, p0=1.0, x0=0.0)).x
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance)
