"""One row at a time, all at once, or in pieces: the same bits; at chosen rows only: the same but for rounding."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, KalmanFilter, denoise, kalman_filter, smooth
from kalscope.filtering.filter import FIRST_CAPACITY, PIECE, GrowingRun, filter_at, filter_pieces

N, STREAMED = PIECE + 1137, 700
SENSORS = {
    "one": {"r": 1.0},
    "one, scaled": {"r": 1.0, "offset": 3.0, "gain": -2.0},
    "list of one": {"r": [1.0]},
    "two": {"r": [1.0, 4.0]},
    "three": {"r": [1.0, 4.0, 0.3], "offset": [0.0, 1.0, -2.0], "gain": [1.0, 2.0, -0.5]},
}
WAYS = [(0.01, {}, None, 0.0, False), (0.3, {"p0": 4.0}, 9.0, 0.05, False)]
WAYS += [(0.0, {"p0": 0.5, "x0": 2.0}, 9.0, 0.0, True), (1e-4, {"p0": 0.0, "x0": -3.0}, None, 0.05, True)]
ROWS = ("x", "p", "k", "innovation", "s", "velocity", "velocity_p")


def record(params, missing=0.0, n=N):
    """A walk with spikes and, over two pieces, a jump that lasts longer than the gate may reject."""
    rng = np.random.default_rng(1)
    x = np.cumsum(rng.normal(0.0, 0.1, n))
    x[PIECE - 3 : PIECE + 6] += 50.0
    x[500:509] += 50.0
    z = params.offset + params.gain * x[:, None] + rng.normal(size=(n, params.sensors))
    z[rng.random(z.shape) < 0.02] += 30.0
    z[rng.random(z.shape) < missing] = np.nan
    z[: 3 if missing else 0] = np.nan
    return z if params.fuses else z[:, 0]


def assert_same(found, whole, rows=slice(None), atol=0.0):
    for name in ROWS:
        one, other = getattr(found, name), getattr(whole, name)
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_allclose(one, other[rows], rtol=0, atol=atol, err_msg=name)
    assert (found.m, np.sum(found.rejected)) == (whole.m, np.sum(whole.rejected))
    assert found.loglik == pytest.approx(whole.loglik, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("sensors", SENSORS)
@pytest.mark.parametrize("momentum", [0.0, 20.0])
def test_streaming_equals_batch_equals_growing_equals_chosen(sensors, momentum):
    for q, start, gate, missing, timed in WAYS:
        params = FilterParams(q, **SENSORS[sensors], **start, momentum=momentum, gate=gate)
        z = record(params, missing)
        dt = np.random.default_rng(2).choice([0.0, 0.5, 1.0, 1.0, 3.0], N) if timed else None
        whole = kalman_filter(z, params, dt)

        stream, seen = KalmanFilter(params), []
        for i in range(STREAMED):
            x = stream.update(z[i], None if dt is None else dt[i])
            seen.append((x, stream.x, stream.p, *np.atleast_1d(stream.k), *[stream.velocity] * (momentum > 0.0)))
        velocity = [] if whole.velocity is None else [whole.velocity]
        expected = np.column_stack([whole.x, whole.x, whole.p, whole.k, *velocity])
        np.testing.assert_array_equal(seen, expected[:STREAMED])

        growing = GrowingRun(KalmanFilter(params))
        for first, last in pairwise((0, 0, 1, 504, 506, FIRST_CAPACITY + 9, N)):
            growing.extend(z[first:last], None if dt is None else dt[first:last])
        assert_same(growing.result, whole)
        growing.forget(300)
        assert_same(growing.result, whole, slice(300, None))

        for first, piece in filter_pieces(z, params, dt):
            np.testing.assert_array_equal(piece.x, whole.x[first : first + PIECE])
        for at in (np.arange(N), np.array([0, 5, PIECE - 1, PIECE, N - 1]), np.empty(0, dtype=np.intp)):
            assert_same(filter_at(z, params, at, dt), whole, at, atol=1e-12 * np.nanmax(np.abs(z)))
        np.testing.assert_allclose(denoise(z, params, dt), whole.x, rtol=0, atol=1e-11 * np.nanmax(np.abs(z)))


@pytest.mark.parametrize("momentum", [0.0, 12.0])
def test_channels_of_a_table_are_filtered_one_by_one(momentum):
    params = FilterParams(0.1, 1.0, p0=2.0, x0=1.0, gate=9.0, momentum=momentum)
    z = np.column_stack([record(params, 0.05, 800), record(params, 0.3, 800)])
    both, smoothed, fast = kalman_filter(z, params), smooth(z, params), denoise(z, params)
    for c in range(2):
        alone, back = kalman_filter(z[:, c], params), smooth(z[:, c], params)
        for name, row in alone.rows.items():
            np.testing.assert_array_equal(getattr(both, name)[:, c], row)
        for name in ("loglik", "m", "rejected"):
            assert getattr(both, name)[c] == getattr(alone, name)
        found = smoothed.x[:, c], smoothed.p[:, c], fast[:, c]
        np.testing.assert_array_equal(found, [back.x, back.p, denoise(z[:, c], params)])


def test_denoise_writes_into_out_and_may_work_in_place():
    params = FilterParams(0.1, 1.0)
    z = record(params)
    expected = denoise(z, params)
    for given, out in ((z, np.empty(2 * N)[::2]), (in_place := z.copy(), in_place)):
        assert denoise(given, params, out=out) is out
        np.testing.assert_array_equal(out, expected)
    table = np.column_stack([z, z])
    np.testing.assert_array_equal(denoise(table, params, out=table)[:, 1], expected)


# --- chosen rows, in chunks once the gain has settled ----------------------------------------------------

LONG = 5 * PIECE + 1234
RNG = np.random.default_rng(5)
RECORD = np.cumsum(RNG.normal(size=LONG)) + RNG.normal(size=LONG)
DRAWN = np.unique(RNG.integers(0, LONG, 3000))


@pytest.mark.parametrize("q", [1e4, 0.01, 1e-5, 1e-7, 1e-12, 0])
@pytest.mark.parametrize(("offset", "missing"), [(0.0, []), (-1e9, []), (0.0, [0, 7, PIECE, LONG - 1])])
def test_chosen_rows_of_a_long_record_are_those_of_the_whole(q, offset, missing):
    z = RECORD + offset
    z[missing] = np.nan
    found, whole = filter_at(z, FilterParams(q, 0.25), DRAWN), kalman_filter(z, FilterParams(q, 0.25))
    for name in ("p", "k", "s"):
        np.testing.assert_allclose(getattr(found, name), getattr(whole, name)[DRAWN], rtol=1e-11)
    for name in ("x", "innovation"):
        near = {"rtol": 0, "atol": 1e-12 * np.nanmax(np.abs(z))}
        np.testing.assert_allclose(getattr(found, name), getattr(whole, name)[DRAWN], **near)
    assert (found.m, found.loglik) == (whole.m, pytest.approx(whole.loglik, rel=1e-7))


@pytest.mark.parametrize(
    ("at", "rows", "message"), [([], [-1, 3], "indices must be of z"), (9000, [3], "-inf at sample 9000")]
)
def test_rows_outside_and_infinite_samples_are_refused(at, rows, message):
    z = RECORD.copy()
    z[at] = -np.inf
    with pytest.raises(BadSetting, match=message):
        filter_at(z, FilterParams(1.0, 0.25), np.array(rows))
