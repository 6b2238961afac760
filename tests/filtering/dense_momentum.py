"""The model with momentum as one Gaussian vector of all states: the oracle of filter, smoother and likelihood."""

from __future__ import annotations

import math

import numpy as np


def van_loan(dt, q, tau):
    """F and Q of dx = v dt, dv = -v/τ dt + noise, by the exponential of a block matrix (Van Loan 1978)."""
    doublings = max(0, math.ceil(math.log2(max(dt / tau, dt, 1e-300)))) + 4
    drift = np.array([[0.0, 1.0], [0.0, -1.0 / tau]])
    noise = np.diag([0.0, q / tau**2])
    block = np.block([[-drift, noise], [np.zeros((2, 2)), drift.T]]) * dt / 2.0**doublings
    power = total = np.eye(4)
    for k in range(1, 20):
        power = power @ block / k
        total = total + power
    f = total[2:, 2:].T
    cov = f @ total[:2, 2:]
    for _ in range(doublings):
        f, cov = f @ f, f @ cov @ f.T + cov
    return f, cov


def constant_velocity(dt, acceleration):
    """F and Q of dx = v dt, dv = noise of density `acceleration` (Bar-Shalom et al. 2001, section 6.2.2)."""
    f = np.array([[1.0, dt], [0.0, 1.0]])
    return f, acceleration * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])


def all_states(moves, start):
    """Mean and covariance of (x1, v1, x2, v2, …): `moves` are F and Q of each step, `start` mean and covariance."""
    mean, cov = start
    n = len(moves)
    means, whole = np.empty(2 * n), np.empty((2 * n, 2 * n))
    for i, (f, noise) in enumerate(moves):
        mean, cov = f @ mean, f @ cov @ f.T + noise
        means[2 * i : 2 * i + 2] = mean
        whole[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = piece = cov
        for j in range(i + 1, n):
            piece = moves[j][0] @ piece
            whole[2 * j : 2 * j + 2, 2 * i : 2 * i + 2] = piece
            whole[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = piece.T
    return means, whole


def dense_model(q, r, tau, dt, x0=None, p0=None):
    """All states of the model with momentum; without x0 and p0, around the unknown first value."""
    start = np.array([0.0 if x0 is None else x0, 0.0]), np.diag([0.0 if p0 is None else p0, q / (2 * tau)])
    return all_states([van_loan(step, q, tau) for step in dt], start)
