"""The compiled loop of the filter with two speeds, nothing else: calm at rest, quick while the signal moves.

The signal rests, with process noise q, or moves, with fast q; or the reading is a spike, with noise SPIKE r, which
says nothing about the motion. From one x and p each of the three hypotheses predicts and updates; then they are
merged into one x and p again, weighted by their probabilities: generalised pseudo-Bayes of first order (Ackerson &
Fu 1970, IEEE Trans. Autom. Control 15(1); Bar-Shalom, Li & Kirubarajan 2001, section 11.6.4). What is carried on is
the probability of moving, by a Markov chain; spikes come one by one.

A device must compute the same digits, so nothing here is left to a library's exponential function.
"""

from __future__ import annotations

import math

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import MISSING, START, UPDATED, Array, Readings, State, States

START_MOVING, STOP_MOVING = 0.01, 0.1
"""Probabilities, per nominal sample period, that a signal at rest begins to move, and that a moving one rests."""

SHARE = START_MOVING / (START_MOVING + STOP_MOVING)
"""Of the time that the chain moves: the probability of moving at a start, and after a long gap."""

LASTING = 1.0 - START_MOVING - STOP_MOVING
"""What a sample period leaves of a difference from SHARE."""

SPIKE = 100.0
"""Noise variance of a spike in units of r."""

NEVER = 32.0
"""An exponent of which nothing is left: e^-32 is 1e-14."""


@compiled(plain=True, inner=True, inline="always")
def exp_minus(u: float) -> float:
    """Exp(-u) of u ≥ 0 by arithmetic alone, to 1e-3 where u ≤ 8: the 16th power of Padé's (2, 2) of u/16."""
    if u >= NEVER:
        return 0.0
    even, odd = 1.0 + u * u * (1.0 / 3072.0), u * 0.03125
    power = (even - odd) / (even + odd)
    power *= power
    power *= power
    power *= power
    return power * power


@compiled(plain=True, forceinline=True)
def step_two_speeds(
    y: float, grown: float, lasting: float, fast: float, r: float, spikes: float, state: State
) -> tuple[State, float, float, float, float, float, int]:
    """One reading after a step that adds the variance `grown` at rest and leaves `lasting` of the chain's memory.

    `state` holds x, the probability of moving, and p. Returns the state, the gain, the innovation, its variance,
    `total` and `least`, and what was done, as `filtering.kernels.step`. An infinite p is the exact diffuse start.
    The log-likelihood is ln `total` - `least` - ½ ln 2π.
    """
    x, moving, p = state[0], SHARE + lasting * (state[1] - SHARE), state[2]
    grown_fast = fast * grown
    ahead = p + grown + moving * (grown_fast - grown)
    s = ahead + r * (1.0 + spikes * (SPIKE - 1.0))
    if math.isnan(y):
        return (x, moving, ahead, 0.0, 0.0), 0.0, math.nan, s, 1.0, 0.0, MISSING
    if math.isinf(p):
        return (y, moving, r, 0.0, 0.0), 1.0, math.nan, math.inf, 1.0, 0.0, START
    if math.isnan(x):  # p0 is given, x0 is this first reading
        return (y, moving, ahead / s * r, 0.0, 0.0), ahead / s, math.nan, s, 1.0, 0.0, START
    v = y - x
    square, slow, quick, good = v * v, p + grown, p + grown_fast, 1.0 - spikes
    half, wide = 0.5 * square, quick + r
    c0, c1, c2, w0 = 0.0, 1.0 / wide, 1.0 / (slow + r), 0.0
    least = half * c1  # the smallest exponent: one weight always stays
    if spikes > 0.0:
        c0 = 1.0 / (ahead + SPIKE * r)
        least = min(least, half * c0)
        w0 = spikes * math.sqrt(c0 * wide) * exp_minus(half * c0 - least)
    w1 = good * moving * exp_minus(half * c1 - least)
    w2 = good * (1.0 - moving) * math.sqrt(c2 * wide) * exp_minus(half * c2 - least)
    total = w0 + w1 + w2
    whole = 1.0 / total
    w0, w1, w2 = w0 * whole, w1 * whole, w2 * whole
    k0, k1, k2 = ahead * c0, quick * c1, slow * c2
    a0, a1, a2 = w0 * k0, w1 * k1, w2 * k2
    k = a0 + a1 + a2
    spread = max(a0 * k0 + a1 * k1 + a2 * k2 - k * k, 0.0)  # of the gains, and so of the hypotheses' x
    state = (x + k * v, w1 + w0 * moving, (SPIKE * a0 + a1 + a2) * r + spread * square, 0.0, 0.0)
    total *= math.sqrt(c1)
    return state, k, v, s, total, least, UPDATED


@compiled(plain=True)
def filter_two_speeds(
    z: Array,
    dt: Array,
    q: float,
    fast: float,
    r: float,
    spikes: float,
    state: State,
    states: States,
    readings: Readings,
    keep: bool | None,
) -> tuple[State, int, float]:
    """Filter z, shape (n, 1), into `states` = (x, probability of moving, p) and `readings` = (k, innovation, s).

    `dt` empty means regular sampling. `keep` None writes x alone, and leaves out the likelihood. Returns the last
    state, the readings scored and their log-likelihood.
    """
    scored, loglik, regular = 0, 0.0, dt.shape[0] == 0
    for i in range(z.shape[0]):
        grown, lasting = (q, LASTING) if regular else (q * dt[i], LASTING ** dt[i])
        state, k, v, s, total, least, done = step_two_speeds(z[i, 0], grown, lasting, fast, r, spikes, state)
        states[0][i] = state[0]
        if keep is not None:
            states[1][i], states[2][i] = state[1], state[2]
            readings[0][i, 0], readings[1][i, 0], readings[2][i, 0] = k, v, s
            if done == UPDATED:
                scored += 1
                loglik += math.log(total) - least
    return state, scored, loglik - 0.5 * scored * math.log(2.0 * math.pi)
