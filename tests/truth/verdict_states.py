"""States of (signal, q, r, p0, gate, momentum, start) whose verdicts must not contradict the data."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope import FilterParams, kalman_filter
from kalscope.analysis.diagnostics import Diagnostics, diagnose, diagnose_held_out
from kalscope.analysis.judge import Judgement, judge

N = 1600
T = np.arange(float(N))


def white(n=N, seed=1):
    return np.random.default_rng(seed).normal(size=n)


def walk(q=0.01, r=1.0, seed=5):
    g = np.random.default_rng(seed)
    return np.cumsum(g.normal(0, math.sqrt(q), N)) + g.normal(0, math.sqrt(r), N)


def coloured(fade=0.9, seed=7):
    g, z = np.random.default_rng(seed), np.zeros(N)
    for i in range(1, N):
        z[i] = fade * z[i - 1] + g.normal()
    return z


def spiked(size=20.0, every=160):
    z = walk()
    z[80::every] += size
    return z


def stepped():
    z = walk(1e-4)
    for at in range(200, N, 200):
        z[at:] += 30.0 * (-1.0) ** (at // 200)
    return z


SIGNALS = {
    "white": white(),
    "walk": walk(),
    "pure walk": walk(1.0, 0.0),
    "ramp": 0.2 * T,
    "noisy ramp": 0.2 * T + white(),
    "sine": 8.0 * np.sin(T / 20.0) + white(),
    "slow sine": 8.0 * np.sin(T / 250.0) + white(),
    "steps": stepped(),
    "constant": np.full(N, 20.1),
    "rounded 0.5": 0.5 * np.round(walk() / 0.5),
    "rounded 10": 10.0 * np.round(walk() / 10.0),
    "spikes": spiked(),
    "coloured": coloured(),
    "anti": np.diff(white(N + 1)),
    "hum": walk() + 2.0 * np.sin(1.3 * T),
    "loud half": np.where(T < N // 2, 1.0, 2.0) * white(seed=9) + walk(r=0.0),
    "gaps": np.where(np.random.default_rng(3).random(N) < 0.3, np.nan, walk()),
    "short": walk()[:60],
}
"""Records by name; noise of variance 1 where nothing else is said."""


@dataclass(frozen=True)
class VerdictState:
    """A filter on a record."""

    signal: str
    """One of SIGNALS."""
    params: FilterParams
    """The filter, with gate, momentum and start."""

    @property
    def z(self):
        return SIGNALS[self.signal]

    def name(self):
        p = self.params
        rest = [f"{name}={getattr(p, name):g}" for name in ("p0", "x0", "gate") if getattr(p, name) is not None]
        tau = [f"tau={float(p.momentum):g}"] if float(p.momentum) else []
        return " ".join([self.signal, f"q={float(p.q):g} r={float(p.r):g}", *rest, *tau])


def of(signals, *pairs, **others):
    return [VerdictState(one, FilterParams(q, r, **others)) for one in signals.split(", ") for q, r in pairs]


STATES = [
    *of("white", *((0.0, r) for r in (0.01, 0.1, 0.5, 0.8, 1.0, 1.3, 2.0, 10.0, 100.0))),
    *of("white", *((q, r) for q in (1e-13, 1e-11, 1e-9) for r in (0.01, 1.0, 100.0))),
    *of("white", (1e-6, 1.0), (1e-4, 1.0), (0.01, 1.0), (1.0, 1.0), (1.0, 0.0)),
    *of("white", (1e-8, 1e4), p0=1e-6, x0=0.0),
    *of("walk", (0.01, 1.0), (0.02, 1.0), (5e-3, 1.0), (0.01, 1.3), (0.01, 0.8)),
    *of("walk", (1e-8, 1e4), (1e-8, 1.0), (0.0, 1.0), (1e3, 1e-5), (1.0, 0.0), (0.1, 10.0), (1e-3, 0.1)),
    *of("walk", (1e-8, 1e4), (1e-8, 1.0), p0=1e-6, x0=float(walk()[0])),
    *of("walk", (0.01, 1.0), p0=1e-6, x0=50.0),
    *of("walk", (0.01, 1.0), (1e-8, 1.0), (1e-4, 0.01), gate=9.0),
    *of("walk", (0.01, 1.0), (1e-4, 1.0), momentum=10.0),
    *of("pure walk", (1.0, 0.0), (1e-4, 1.0), (1e-8, 1e4)),
    *of("ramp, rounded 0.5, rounded 10, spikes, coloured, gaps, short, hum, anti", (0.01, 1.0), (1e-8, 1e4)),
    *of("spikes, short", (1.0, 1.0)),
    *of("noisy ramp", (1e-4, 1.0), (0.04, 1.0), (1.0, 1.0)),
    *of("sine", (1e-8, 1e4), (1e-3, 1.0), (0.1, 1.0), (1.0, 0.1)),
    *of("sine", (0.1, 1.0), momentum=30.0),
    *of("slow sine", (1e-8, 1e4), (1e-8, 1.0), (1e-3, 1.0), (0.1, 1.0)),
    *of("steps", (1e-4, 1.0), (1.0, 1.0), (100.0, 1.0), (1e-8, 1e4)),
    *of("steps", (1e-4, 1.0), gate=9.0),
    *of("constant", (0.01, 1.0), (0.0, 1.0)),
    *of("rounded 10", (10.0, 1e-4)),
    *of("spikes", (0.01, 1.0), gate=16.0),
    *of("coloured", (1.0, 0.01)),
    *of("anti", (1e-8, 2.0)),
    *of("hum", (0.01, 3.0)),
    *of("loud half", (0.01, 1.0), (0.01, 2.5)),
]
"""What is judged."""


@dataclass(frozen=True)
class Row:
    """A state with its tests and its verdict."""

    state: VerdictState
    whole: Diagnostics
    half: Diagnostics
    said: Judgement


def row_of(state: VerdictState) -> Row:
    """Judge one state as the dashboard does, on the whole record and on its second half."""
    whole = diagnose(kalman_filter(state.z, state.params))
    half = diagnose_held_out(state.z, state.params)
    return Row(state, whole, half, judge(whole, half))
