"""What does `kalscope tune` say of records whose truth is known? To be judged by eye, one after the other.

    python benchmarks/true_sentences.py [--data FOLDER] [--only WORD] [--details]

Twenty-seven records are simulated with fixed seeds. Each is printed with what is known to be true of it and the
lines that the command prints, with --details all others too. The default channels of recordings of real sensors
follow (FOLDER, or `../shared/data` beside the project, where it is there).
"""

from __future__ import annotations

import argparse
import math
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kalscope import Recording, read_recording
from kalscope.analysis.channel_kinds import default_channel
from kalscope.cli.tune_answer import answer_for, details_of, summary_of
from kalscope.common.progress import Progress
from kalscope.errors import KalscopeError
from kalscope.estimation.request import Request

Samples = NDArray[np.float64]
Rng = np.random.Generator

N = 3000
SHARED = Path(__file__).parents[2] / "shared" / "data"

REAL = {
    "nile/nile.csv": "annual flow, one fall in 1899; q/r about 0.1 (Durbin & Koopman)",
    "ck_state_space/logUKpetrolprice.txt": "log price, steps in 1974 and 1979; ML has no noise",
    "hcsr04_short/*": "ultrasonic ranging with echoes that are missed",
    "flex_arm/flex_sensor_data.csv": "flex sensor: stretches of rest and of bending",
    "putty_pressure/putty.log": "a pressure in steps of 0.0016",
    "tmp36_serial_monitor/*": "22 readings of a temperature that rises",
    "tof_mcu_kalman/E1_run04.csv": "time-of-flight distance, the target moves",
    "nab_ambient_temperature/*": "room temperature by the hour, daily waves, gaps",
    "sea_surface_temp/*": "sea temperature, rounded",
    "cgm_glucose/*": "glucose, smoothed by the sensor",
    "co2_weekly/*": "CO2, trend and seasons",
    "oscillators/ocxo_frequency.txt": "oscillator frequency: white noise and drift",
    "ppg_arduino/*": "pulse: a wave that repeats, smooth",
}
"""Recordings by their place in the folder, with what is known of them."""


def walk(rng: Rng, n: int = N, q: float = 0.01, r: float = 1.0) -> Samples:
    return np.cumsum(rng.normal(0.0, math.sqrt(q), n)) + rng.normal(0.0, math.sqrt(r), n)


def spiked(rng: Rng, share: float, size: float, run: int = 1) -> Samples:
    z = walk(rng)
    for at in np.flatnonzero(rng.random(N - run) < share / run):
        z[at : at + run] += size
    return z


def stepped(rng: Rng, steps: int) -> Samples:
    z = walk(rng)
    for i in range(1, steps + 1):
        z[i * N // (steps + 1) :] += 30.0 * (-1.0) ** i
    return z


def gapped(rng: Rng) -> Samples:
    z = walk(rng)
    z[rng.random(N) < 0.3] = math.nan
    return z


def burst(rng: Rng, first: int, last: int, sigma: float) -> Samples:
    z = walk(rng)
    z[first:last] += rng.normal(0.0, sigma, last - first)
    return z


def moving(rng: Rng, tau: float) -> Samples:
    fade, v, z = math.exp(-1.0 / tau), 0.0, np.empty(N)
    for i in range(N):
        v = fade * v + rng.normal() * math.sqrt(0.5 / tau * (1.0 - fade * fade))
        z[i] = v
    return np.cumsum(z) + rng.normal(size=N)


def coloured(rng: Rng) -> Samples:
    noise = np.zeros(N)
    for i in range(1, N):
        noise[i] = 0.9 * noise[i - 1] + rng.normal()
    return noise + walk(rng, q=1e-4, r=0.1)


def long_clock(rng: Rng) -> Samples:
    z = walk(rng, 500_000)
    z[:20_000] += rng.normal(0.0, 3.0, 20_000)
    return z


T = np.arange(float(N))
SIMULATED: dict[str, tuple[str, Callable[[Rng], Samples]]] = {
    "walk": ("random walk q 0.01 in white noise r 1", walk),
    "20 samples": ("the same, too short", lambda g: walk(g, 20)),
    "60 samples": ("the same, short", lambda g: walk(g, 60)),
    "half a million": ("the same, long; the first 20,000 samples ten times as noisy", long_clock),
    "constant": ("one value", lambda _: np.full(300, 20.1)),
    "white noise": ("r 1, no movement", lambda g: g.normal(size=N)),
    "walk without noise": ("q 1, r 0", lambda g: np.cumsum(g.normal(size=N))),
    "ramp": ("0.2 a sample, no noise", lambda _: 0.2 * T),
    "noisy ramp": ("0.2 a sample, r 1", lambda g: 0.2 * T + g.normal(size=N)),
    "noisy sine": ("amplitude 8, 126 samples, r 1", lambda g: 8.0 * np.sin(T / 20.0) + g.normal(size=N)),
    "hum": ("walk with a tone of amplitude 2 at 0.21 of the rate", lambda g: walk(g) + 2.0 * np.sin(1.3 * T)),
    "one step": ("walk with one step of 30 σ", lambda g: stepped(g, 1)),
    "ten steps": ("walk with ten steps of 30 σ", lambda g: stepped(g, 10)),
    "spikes 0.2 %": ("walk with spikes of 20 σ, 0.2 %", lambda g: spiked(g, 0.002, 20.0)),
    "spikes 1 %": ("walk with spikes of 20 σ, 1 %", lambda g: spiked(g, 0.01, 20.0)),
    "spikes 5 %": ("walk with spikes of 100 σ, 5 %", lambda g: spiked(g, 0.05, 100.0)),
    "spikes 30 %": ("walk with spikes of 20 σ, 30 %", lambda g: spiked(g, 0.3, 20.0)),
    "pairs": ("walk with pairs of spikes of 10 σ, 1 %", lambda g: spiked(g, 0.01, 10.0, 2)),
    "heavy tails": ("walk with noise of Student's t, 3 degrees", lambda g: walk(g, r=0.0) + g.standard_t(3, N)),
    "burst": ("walk, 40 samples with 8 σ more noise", lambda g: burst(g, 1000, 1040, 8.0)),
    "noisy start": ("walk, the first 300 samples with 10 σ more noise", lambda g: burst(g, 0, 300, 10.0)),
    "louder half": ("walk, the second half with twice the noise", lambda g: burst(g, N // 2, N, math.sqrt(3.0))),
    "coarse steps": ("walk rounded to steps of 10, σ 1", lambda g: 10.0 * np.round(walk(g) / 10.0)),
    "fine steps": ("walk rounded to steps of 0.5, σ 1", lambda g: 0.5 * np.round(walk(g) / 0.5)),
    "gaps": ("walk, 30 % of the samples missing", gapped),
    "momentum": ("a signal that keeps its direction for 30 samples, r 1", lambda g: moving(g, 30.0)),
    "coloured noise": ("noise that fades over 10 samples, hardly any walk", coloured),
}
"""Records by name: the true state of affairs, and what makes them."""


@dataclass(frozen=True)
class Record:
    """One record to be judged."""

    name: str
    truth: str
    recording: Recording


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=SHARED, metavar="FOLDER")
    parser.add_argument("--only", default="", metavar="WORD")
    parser.add_argument("--details", action="store_true")
    options = parser.parse_args()
    records = [*simulated(options.only), *real(options.data, options.only)]
    for i, one in enumerate(records, 1):
        show(i, one, details=options.details)
    return 0 if records else 1


def simulated(only: str) -> list[Record]:
    found: list[Record] = []
    for seed, (name, (truth, make)) in enumerate(SIMULATED.items()):
        if only in name:
            z = make(np.random.default_rng(seed))
            recording = Recording(
                0.01 * np.arange(len(z), dtype=np.float64), ("z",), ("",), z[:, None], 0.01, source=f"{name}.csv"
            )
            found.append(Record(name, truth, recording))
    return found


def real(folder: Path, only: str) -> list[Record]:
    found: list[Record] = []
    for place, truth in REAL.items():
        paths = sorted(path for path in folder.glob(place) if path.suffix != ".md")
        if paths and only in place:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                try:
                    found.append(Record(str(paths[0].relative_to(folder)), truth, read_recording(paths[0])))
                except KalscopeError as error:
                    print(f"{place}: {error}", file=sys.stderr)
    return found


def show(number: int, one: Record, *, details: bool) -> None:
    print(f"{number}. {one.name}: {one.truth}")
    channel = default_channel(one.recording)
    answer = answer_for(one.recording, channel, Request(), Progress(None))
    lines = summary_of(answer)
    print("\n".join(f"    {line}" for line in lines))
    if details:
        print("\n".join(f"    | {line}" for line in details_of(answer)))
    print(f"    [{answer.judgement.status}] held out: {answer.judgement.held_out or 'not possible'}\n", flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
