"""A simulated device: true times of its samples, and the stamps that a log of it holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Device:
    """How samples are taken, delivered and stamped."""

    rate: float = 100.0
    """Hz."""
    stamp_jitter: float = 0.0
    """Noise of each stamp, standard deviation in periods."""
    loop_jitter: float = 0.0
    """Noise of each step between two samples, standard deviation in periods."""
    buffer: int = 1
    """Samples that are delivered at once, stamped as they arrive."""
    drain: float = 0.0
    """Seconds between two rows of one delivery."""
    clock: float = 1e-6
    """Resolution of the stamps in s."""
    pauses: int = 0
    pause: float = 0.0
    """Seconds of the shortest pause."""
    lost: float = 0.0
    """Share of samples that are lost at random."""

    def run(self, n, seed=0):
        """True times, stamps from 0, and the samples, from 0, after which samples are missing."""
        rng = np.random.default_rng(seed)
        steps = (1 + self.loop_jitter * rng.normal(size=n - 1).clip(-3, 3)) / self.rate
        at = np.sort(rng.choice(np.arange(n // 20, n - n // 20), self.pauses, replace=False))
        steps[at] += self.pause * rng.uniform(1, 3, size=self.pauses)
        true = np.concatenate(([0.0], np.cumsum(steps))) + rng.uniform(0, 1)
        kept = np.flatnonzero(rng.random(n) >= self.lost)
        true, missing = true[kept], np.flatnonzero((np.diff(kept) > 1) | np.isin(kept[:-1], at))
        stamps = true + self.stamp_jitter / self.rate * rng.normal(size=len(true))
        if self.buffer > 1:
            delivery = np.arange(len(true)) // self.buffer
            last = np.append(np.flatnonzero(np.diff(delivery)), len(true) - 1)
            within = np.arange(len(true)) - delivery * self.buffer
            stamps = stamps[last[delivery]] + self.drain * within * rng.uniform(0.5, 1.5, len(true))
            stamps = np.maximum.accumulate(stamps)
        stamps = np.round(np.floor(stamps / self.clock) * self.clock, 9)
        return true - stamps[0], stamps - stamps[0], missing


DEVICES = {
    "even": (Device(), "even"),
    "even, pauses": (Device(pauses=3, pause=2.0), "even"),
    "64 Hz in whole ms": (Device(64, clock=1e-3), "uneven"),
    "490 Hz in whole ms": (Device(490, clock=1e-3), "uneven"),
    "900 Hz in whole ms": (Device(900, clock=1e-3), "uneven"),
    "1100 Hz in whole ms": (Device(1100, clock=1e-3), "coarse"),
    "3 kHz in whole ms": (Device(3000, clock=1e-3), "coarse"),
    "noisy stamps": (Device(stamp_jitter=0.1), "uneven"),
    "noisy loop": (Device(loop_jitter=0.2), "uneven"),
    "noisy loop, pauses": (Device(loop_jitter=0.2, pauses=4, pause=0.5), "uneven"),
    "5 at once": (Device(buffer=5, drain=1e-3), "bursts"),
    "20 at once in whole ms": (Device(250, buffer=20, drain=2e-4, clock=1e-3), "bursts"),
    "250 at once, drained within a ms": (Device(250, buffer=250, drain=1e-6, clock=1e-3), "bursts or coarse"),
    "20 at once, pauses": (Device(250, buffer=20, drain=2e-4, clock=1e-3, pauses=3, pause=2.0), "bursts"),
    "480 Hz in whole ms, noisy loop": (Device(480, clock=1e-3, loop_jitter=0.3), "uneven"),
    "400 Hz in whole s, few of them, pauses": (Device(400, clock=1.0, pauses=4, pause=20.0), "coarse"),
    "48 Hz by a clock of 15.6 ms, pauses": (Device(48, clock=0.015625, pauses=4, pause=1.0), "uneven"),
    "67 Hz in whole s": (Device(67, clock=1.0), "coarse"),
    "67 Hz in whole s, pauses": (Device(67, clock=1.0, pauses=3, pause=5.0), "coarse"),
    "13.4 Hz in whole s, noisy loop": (Device(13.4, clock=1.0, loop_jitter=0.2), "coarse"),
    "1.3 Hz in whole s": (Device(1.3, clock=1.0), "coarse"),
    "0.9 Hz in whole s": (Device(0.9, clock=1.0), "uneven"),
    "0.7 Hz in whole s, noisy": (Device(0.7, clock=1.0, stamp_jitter=0.3), "uneven"),
    "100 Hz by a clock of 15.6 ms": (Device(100.4, clock=0.015625, stamp_jitter=0.3), "coarse"),
    "0.5 Hz in whole minutes, pauses": (Device(0.5, clock=60.0, pauses=3, pause=3600.0), "coarse"),
}
"""Devices, and how their stamps lie."""
