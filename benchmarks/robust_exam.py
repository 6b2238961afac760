"""Does the spike-proof fit find q and r in spite of spikes, leave steps alone, and cost little?

    python benchmarks/robust_exam.py [--runs 50] [--only spikes clean steps coverage cost]
    python benchmarks/robust_exam.py --data FOLDER [--pictures FOLDER]

Simulated records are a level that moves at random (λ = 0.01) with noise of variance 1, n = 3,000, and spikes of
given height in σ; the targets: r within 10 % and λ within 25 % in the median. With --data every column of a folder
of recordings is fitted with and without; columns whose q or r differ by more than 20 % are marked, and drawn with
--pictures. Exit status 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from momentum_exam import columns
from numpy.typing import NDArray

from kalscope import Estimate, FilterParams, denoise, estimate
from kalscope.errors import KalscopeError

Samples = NDArray[np.float64]
N, LAMBDA = 3000, 0.01
SHARES, SIZES = (0.002, 0.01, 0.02, 0.05), (6.0, 10.0, 20.0, 100.0)
MAX_R, MAX_LAMBDA, MAX_CLEAN, MIN_STEPS, COVERAGE, MAX_COST = 0.10, 0.25, 0.01, 0.99, (0.92, 0.98), 5.0
MARKED = 1.2
"""Factor of q or r from which a column is marked."""


@dataclass(frozen=True)
class Record:
    """A simulated record and the truth about it."""

    level: Samples
    z: Samples
    spikes: NDArray[np.bool_]


def simulated(
    seed: int, share: float = 0.0, size: float = 0.0, pairs: bool = False, one_sign: bool = False
) -> Record:
    """A record with a share of its samples moved by `size` σ, alone or two side by side with the same sign."""
    g = np.random.default_rng(seed)
    level = np.cumsum(g.normal(0.0, np.sqrt(LAMBDA), N))
    z = level + g.normal(0.0, 1.0, N)
    first = g.random(N) < (share / 2.0 if pairs else share)
    push = np.where(first, 1.0 if one_sign else g.choice([-1.0, 1.0], N), 0.0)
    if pairs:
        push = np.where(push == 0.0, np.append(0.0, push[:-1]), push)
    return Record(level, z + size * push, push != 0.0)


def spikes(runs: int) -> bool:
    """The table of the issue, and what the gate is worth."""
    print(
        "spikes of    signs  share   r / true (5 % ... 95 %)  λ / true  missed  RMSE: plain  no gate   gate  oracle"
    )
    good = True
    for pairs, one_sign, share, size in itertools.product((False, True), (False, True), SHARES, SIZES):
        rows: list[list[float]] = []
        for seed in range(runs):
            record = simulated(seed, share, size, pairs, one_sign)
            found = estimate(record.z)
            away = np.zeros(N, bool) if found.outliers is None else found.outliers
            missed = float((record.spikes & ~away).sum() / max(record.spikes.sum(), 1))
            rows.append([float(found.r), found.ratio / LAMBDA, missed, *filter_errors(record, found)])
        table = np.array(rows)
        r, ratio, _, *errors = np.median(table, axis=0)
        low, high = np.quantile(table[:, 0], [0.05, 0.95])
        passed = abs(r - 1.0) <= MAX_R and abs(ratio - 1.0) <= MAX_LAMBDA
        good &= bool(passed)
        kind = (
            f"{size:3.0f} σ{' pairs' if pairs else '      '}  {'one ' if one_sign else 'both'} {100 * share:5.1f} %"
        )
        words = " ".join(f"{error:8.3f}" for error in errors)
        miss = 100.0 * table[:, 2].mean()
        print(f"{kind}   {r:6.3f} ({low:.3f} ... {high:.3f})      {ratio:6.3f} {miss:7.2f} % {words}{mark(passed)}")
    return good


def filter_errors(record: Record, found: Estimate) -> list[float]:
    """RMSE against the true level: the plain pair, this pair without and with its gate, and without spikes."""
    true, clean = FilterParams(q=LAMBDA, r=1.0), np.where(record.spikes, np.nan, record.z)
    plain = FilterParams(q=found.plain_q or found.q, r=found.plain_r or found.r)
    ungated = FilterParams(q=found.q, r=found.r)
    runs = ((record.z, plain), (record.z, ungated), (record.z, found.params or plain), (clean, true))
    return [float(np.sqrt(np.mean((denoise(z, params) - record.level)[50:] ** 2))) for z, params in runs]


def clean(runs: int) -> bool:
    """Records without spikes: the plain fit."""
    changed, worst, same = 0.0, 0.0, 0
    for seed in range(4 * runs):
        z = simulated(seed).z
        plain, auto, always = (estimate(z, robust=robust) for robust in (False, "auto", True))
        same += auto.outliers is None and (auto.q, auto.r) == (plain.q, plain.r)
        changed = max(changed, *(abs(a / b - 1.0) for a, b in ((auto.q, plain.q), (auto.r, plain.r))))
        worst = max(worst, *(abs(a / b - 1.0) for a, b in ((always.q, plain.q), (always.r, plain.r))))
    passed = bool(changed <= MAX_CLEAN)
    print(
        f"without spikes: {same} of {4 * runs} records as plain, bit for bit; always on, q and r differ by at",
        end="",
    )
    print(f" most {100 * worst:.3f} %{mark(passed)}")
    return passed


def steps(runs: int) -> bool:
    """Records with ten steps of 30 σ, none within two samples of another or an end: none may be set aside."""
    kept = 0
    for seed in range(4 * runs):
        record, g = simulated(seed), np.random.default_rng(seed + 1)
        z = record.z.copy()
        places = 3 * g.choice(np.arange(1, N // 3 - 1), 10, replace=False)
        for place in places:
            z[place:] += 30.0 * g.choice([-1.0, 1.0])
        away = estimate(z, robust=True).outliers
        kept += sum(away is None or not away[max(place - 5, 0) : place + 5].any() for place in places)
    passed = kept >= MIN_STEPS * 40 * runs
    print(f"steps: {kept} of {40 * runs} left alone{mark(passed)}")
    return passed


def coverage(runs: int) -> bool:
    """How often the intervals hold the truth, with 1 % spikes of 20 σ."""
    hits = np.zeros(3)
    for seed in range(8 * runs):
        found = estimate(simulated(seed, 0.01, 20.0).z, momentum=0.0)
        low, high = found.ratio_interval
        pairs = ((found.q, found.q_se, LAMBDA), (found.r, found.r_se, 1.0))
        near = [abs(np.log(value / true)) <= 1.96 * error / value for value, error, true in pairs]
        hits += [low <= LAMBDA <= high, *near]
    shares = hits / (8 * runs)
    passed = all(COVERAGE[0] <= share <= COVERAGE[1] for share in shares)
    named = ", ".join(f"{name} {100 * share:.1f} %" for name, share in zip(("λ", "q", "r"), shares, strict=True))
    print(f"coverage of the 95 % intervals: {named}{mark(passed)}")
    return passed


def cost(_: int) -> bool:
    """Seconds at 100,000 samples with 1 % spikes, over those of the plain fit, by turns."""
    g, n = np.random.default_rng(0), 100_000
    z = np.cumsum(g.normal(0.0, np.sqrt(LAMBDA), n)) + g.normal(0.0, 1.0, n)
    rough = z + np.where(g.random(n) < 0.01, 20.0, 0.0)
    names = ("with spikes", "without spikes")
    ratios: list[float] = []
    for name, record in zip(names, (rough, z), strict=True):
        seconds = np.array([[timed(record, False), timed(record, "auto")] for _ in range(7)]).min(axis=0)
        ratios.append(seconds[1] / seconds[0])
        print(f"cost {name}: {seconds[1]:.2f} s, {ratios[-1]:.2f} times the plain fit", end="; ")
    print(mark(ratios[0] <= MAX_COST).strip() or "within 5 times")
    return ratios[0] <= MAX_COST


def timed(z: Samples, robust: bool | str) -> float:
    start = time.perf_counter()
    estimate(z, robust=robust)  # pyright: ignore[reportArgumentType]
    return time.perf_counter() - start


def mark(passed: bool) -> str:
    return "" if passed else "   MISSED"


def recordings(folder: Path, pictures: Path | None) -> bool:
    """Plain against robust on every column of the recordings of a folder (the middle 4,000 samples)."""
    print(
        "      n  aside     r plain    robust  factor     λ plain    robust  factor  τ plain  robust  gate  column"
    )
    for index, (file, channel, z) in enumerate(columns(folder)):
        try:
            plain, robust = estimate(z, robust=False), estimate(z)
        except KalscopeError as refusal:
            print(f"{file}: {channel}: {refusal}")
            continue
        r, ratio, q = (factor(getattr(robust, name), getattr(plain, name)) for name in ("r", "ratio", "q"))
        marked = any(not 1.0 / MARKED <= one <= MARKED for one in (r, q))
        share = f"{100 * float(robust.outlier_share):6.2f} %" if robust.outliers is not None else "       -"
        print(
            f"{'*' if marked else ' '}{len(z):6}{share}  {plain.r:10.3g}{robust.r:10.3g}{r:8.2f}"
            f"  {plain.ratio:10.3g}{robust.ratio:10.3g}{ratio:8.2f}  {plain.momentum:7.3g}{robust.momentum:8.3g}"
            f"  {'4 σ' if robust.gate else ' - ':4} {index:3} {file}: {channel} ({plain.verdict}, {robust.verdict})"
        )
        if marked and pictures is not None and robust.outliers is not None:
            draw(pictures / f"{index:03}.png", f"{file}: {channel}", z, robust)
    return True


def factor(after: float, before: float) -> float:
    if after == before:
        return 1.0
    return after / before if before > 0.0 else np.inf


def draw(path: Path, title: str, z: Samples, found: Estimate) -> None:
    """The whole record, and the stretches around nine of the samples set aside, those marked."""
    from matplotlib.figure import Figure

    away = np.flatnonzero(np.zeros(len(z), dtype=bool) if found.outliers is None else found.outliers)
    figure = Figure(figsize=(14, 10), layout="constrained")
    whole, *rows = figure.subplot_mosaic([["all"] * 3, *[[f"{i}{j}" for j in range(3)] for i in range(3)]]).values()
    whole.plot(z, ".-", markersize=2, linewidth=0.5, color="0.4")
    whole.plot(away, z[away], "o", color="tab:red", markersize=4, fillstyle="none")
    whole.set_title(f"{title}   {len(away)} set aside   {found.verdict}, q {found.q:.3g}, r {found.r:.3g}")
    for axes, place in zip(rows, away[np.linspace(0, len(away) - 1, min(9, len(away))).astype(int)], strict=False):
        near = slice(max(place - 25, 0), place + 26)
        inside = away[(away >= near.start) & (away < near.stop)]
        axes.plot(np.arange(len(z))[near], z[near], ".-", color="0.4")
        axes.plot(inside, z[inside], "o", color="tab:red", fillstyle="none")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=60)


PARTS: dict[str, Callable[[int], bool]] = {
    "spikes": spikes,
    "clean": clean,
    "steps": steps,
    "coverage": coverage,
    "cost": cost,
}


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=50, help="records of each kind of spikes")
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--data", type=Path, help="folder of recordings, in place of simulated records")
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each marked column")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.data is not None:
        return int(not recordings(options.data, options.pictures))
    results = [PARTS[name](options.runs) for name in options.only]
    return int(not all(results))


if __name__ == "__main__":
    sys.exit(main())
