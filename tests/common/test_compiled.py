"""Compiled loops: what runs as plain Python at first gives the same bits, and the compiler waits until it pays."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from functools import partial

import numpy as np
import pytest

from kalscope.common import compiled
from kalscope.common.compiled import Compiling
from kalscope.filtering import kernels


def plainly(loop, *args):
    """What the loop gives as plain Python."""
    return loop.py_func(*map(compiled._plain, args))


def bits(value):
    """A value with its type, by which two are equal only to the last bit."""
    if isinstance(value, tuple):
        return tuple(map(bits, value))
    return type(value), value.hex() if isinstance(value, float) else value


def records():
    """Records of all kinds: gaps, steps of any length, jumps for the gate, values of any size."""
    for seed in range(60):
        random = np.random.default_rng(seed)
        n = int(random.integers(0, 400))
        z = random.normal(size=n).cumsum() * 10.0 ** random.integers(-160, 150)
        z[random.random(n) < random.choice([0.0, 0.02, 0.5])] = np.nan
        z[random.random(n) < 0.01] *= 50.0
        dt = random.choice([0.0, 0.5, 1.0, 3.0], size=n) if seed % 3 == 0 else np.empty(0)
        scale = max(float(np.nanvar(z)) if n and np.isfinite(z).any() else 1.0, 1e-300)
        q, r = scale * random.choice([0.0, 1e-6, 0.1, 1.0]), scale * random.choice([1e-3, 1.0])
        gate = random.choice([np.inf, 9.0, 1.0])
        x, p = (np.nan, np.inf) if seed % 2 else (float(random.choice([np.nan, 0.0])), random.choice([0.0, scale]))
        yield z, dt, float(q), float(r if seed % 7 else 0.0 if q else r), float(gate), x, float(p)


def filtered(loop):
    """The bits of everything that a loop over rows gives."""
    for i, (z, dt, q, r, gate, x, p) in enumerate(records()):
        tau, sensors = (None, 7.0)[i % 2], 1 + i // 2 % 2
        scales = None if sensors == 1 else (np.array([0.0, 1.0]), np.array([1.0, -2.0]))
        rows, sizes = np.column_stack([z, 1.0 - 2.0 * z[::-1]])[:, :sensors].copy(), (len(z), (len(z), sensors))
        state = x, 0.0, p, 0.0, 0.0 if tau is None else 0.5 * q / tau
        tally = tuple(np.zeros(sensors, dtype=np.int64) for _ in range(3))
        out, read = (tuple(np.full(sizes[j], -7.0) for _ in range(5 - 2 * j)) for j in range(2))
        ells, noise = np.zeros(sensors), np.full(sensors, r if sensors == 1 else max(r, 1e-300))
        found = loop(rows, dt, q, tau, scales, noise, gate, state, tally, out, read, ells, True)
        yield (i, len(z), bits(found), *(array.tobytes() for array in (*tally, *out, *read)))


@pytest.mark.filterwarnings("error")
def test_the_filter_gives_the_same_bits_plain_and_compiled(monkeypatch):
    whole = list(filtered(kernels.filter_rows.dispatcher))
    for name in ("step", "predict", "transition"):  # as plain Python it calls the plain ones
        monkeypatch.setattr(kernels, name, getattr(kernels, name).py_func)
    assert list(filtered(partial(plainly, kernels.filter_rows))) == whole
    assert sum(samples for _, samples, *_ in whole) > 5000
    assert pickle.loads(pickle.dumps(kernels.filter_rows)) is kernels.filter_rows  # by name, to another process


FEW = """
import sys, numpy as np
from kalscope.common.compiled import MAX_PLAIN
from kalscope import FilterParams, KalmanFilter, kalman_filter
z = np.sin(np.arange(MAX_PLAIN / 2))
few = kalman_filter(z, FilterParams(0.1, 1.0))
assert "numba" not in sys.modules
more = kalman_filter(np.r_[z, z], FilterParams(0.1, 1.0))
assert "numba" in sys.modules
assert few.x.tobytes() == more.x[: len(z)].tobytes()
print(few.x[-1])
"""


def test_a_short_record_is_filtered_without_the_compiler_and_a_long_one_with_it():
    assert subprocess.run([sys.executable, "-c", FEW], check=True, capture_output=True).stdout


CALLED = """
import numpy as np
from kalscope.common import compiled
from kalscope.estimation.kernels import set_step
from kalscope.filtering.kernels import step, transition
set_step.dispatcher(1.0, np.ones(16), 0, np.ones(400))
compiled.watch_compiling(print)
step.dispatcher(1.0, (1.0, 0.0, 0.1, 0.0, 0.0), 1.0, 9.0, (0.0, 0.0, 1.0, 0.0, 0.0), 0, None)
steps = np.geomspace(1e-3, 1.0, 5000).tolist()
assert [transition.dispatcher(dt, 3.0, 7.0) for dt in steps] == [transition.py_func(dt, 3.0, 7.0) for dt in steps]
"""
"""Compiles `transition` for a loop with fast-math flags, then looks at others."""


@pytest.mark.slow
def test_a_loop_compiled_for_another_one_gives_the_same_bits_and_only_what_the_cache_lacks_is_compiled(tmp_path):
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    first, second = (subprocess.check_output([sys.executable, "-c", CALLED], env=env, text=True) for _ in range(2))
    beginning = "compiling for this computer, only at the first start: "
    assert first.splitlines() == [f"{beginning}0 done", f"{beginning}1 done"]
    assert second == ""


@pytest.mark.slow
def test_loops_run_where_no_folder_takes_their_cache(monkeypatch):
    from numba.core import caching

    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    monkeypatch.setattr(compiled, "_no_folder", threading.Event())
    loop = compiled.compiled()(doubled)
    assert loop(np.ones(3)) == 6.0
    assert "at each start, because no cache folder is writable" in str(Compiling(1, is_busy=True))


def doubled(z):
    return 2.0 * z.sum()


def test_a_wrong_number_of_threads_is_explained():
    code = "import kalscope; kalscope.denoise([1.0] * 100_000, kalscope.FilterParams(1.0, 1.0))"
    env = {**os.environ, "NUMBA_NUM_THREADS": "0"}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert "BadSetting: the environment must let numba start (got: Number of threads" in done.stderr
