"""One sensor or several of one quantity as one Gaussian vector of all states: the oracle of the filter."""

from __future__ import annotations

import math

import numpy as np
from dense_momentum import dense_model


def states_of(params, dt):
    """Mean and covariance of (x, velocity) at every row; x is around the unknown first value if diffuse."""
    if params.momentum:
        return dense_model(params.q, 1.0, params.momentum, dt, params.x0, params.p0)
    moved = params.q * np.cumsum(dt)
    n = len(dt)
    mean, cov = np.zeros(2 * n), np.zeros((2 * n, 2 * n))
    mean[::2] = 0.0 if params.x0 is None else params.x0
    cov[::2, ::2] = np.minimum.outer(moved, moved) + (0.0 if params.p0 is None else params.p0)
    return mean, cov


def seen_readings(z, params, upto):
    """The finite readings before row `upto` in the order in which they are taken: rows of H, noise, z − offset."""
    row, sensor = np.nonzero(np.isfinite(z[:upto]))
    h = np.zeros((len(row), 2 * len(z)))
    h[np.arange(len(row)), 2 * row] = params.gain[sensor]
    return h, np.diag(params.sensor_r[sensor]), z[row, sensor] - params.offset[sensor]


def dense_posterior(z, params, states, upto):
    """Mean and covariance of all states, `states` before any reading, given the readings before row `upto`."""
    mean, cov = states
    h, noise, rest = seen_readings(z, params, upto)
    s = h @ cov @ h.T + noise
    gain = np.linalg.solve(s, h @ cov).T
    rest = rest - h @ mean
    posterior, moved = cov - gain @ h @ cov, mean + gain @ rest
    if params.p0 is not None:
        return moved, posterior
    level = np.tile([1.0, 0.0], len(z))
    weight = np.linalg.solve(s, h @ level)
    variance = 1.0 / (weight @ h @ level)
    unseen = level - gain @ h @ level
    return moved + variance * (weight @ rest) * unseen, posterior + variance * np.outer(unseen, unseen)


def dense_loglik(z, params, states):
    """Log-density of the readings; with a diffuse start given the first, whose own density is not known."""
    mean, cov = states
    h, noise, rest = seen_readings(z, params, len(z))
    s = h @ cov @ h.T + noise
    rest = rest - h @ mean
    if params.p0 is None:  # what the unknown level leaves out: z_i − (gain_i/gain_1) z_1
        level = h @ np.tile([1.0, 0.0], len(z))
        contrast = np.eye(len(rest))[1:] - np.outer(level[1:] / level[0], np.eye(len(rest))[0])
        s, rest = contrast @ s @ contrast.T, contrast @ rest
    return -0.5 * (len(rest) * math.log(2 * math.pi) + np.linalg.slogdet(s)[1] + rest @ np.linalg.solve(s, rest))
