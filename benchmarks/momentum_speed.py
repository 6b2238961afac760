"""What momentum costs: the filter with τ against the filter without, and the fit against those of statsmodels.

    python benchmarks/momentum_speed.py [--samples 10000000] [--fitted 100000] [--turns 5] [--json]

`denoise` writes into an existing array, with and without momentum, in turns; the first samples, until the
gains have settled, are part of it. The fit over (q/r, τ) with its intervals is compared with three of statsmodels
on the same record: the damped trend as a state space and ARIMA(1, 1, 2), which is the same model, both by maximum
likelihood, and the damped trend by least squares with constant gains. `estimate(z)` also fits the random walk and
weighs the two by prediction. The times are processor times; the log-likelihood that each reaches is printed, and
as each scores the start in its own way, a few units mean nothing. Exit status 1 where `denoise` takes more than
3 times as long, or the fit is not 50 times as fast as the state space.
"""

from __future__ import annotations

import argparse
import importlib
import json
import statistics
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from momentum_coverage import fitted, simulate
from numpy.typing import NDArray

from kalscope import FilterParams, denoise, estimate
from kalscope.cli.bench.contest import take_turns

TRUTH = FilterParams(q=10.0, r=1.0, momentum=30.0)
MAX_SLOWER, MIN_FASTER = 3.0, 50.0
OWN, STATE_SPACE = "maximum likelihood, Kalscope", "damped trend, state space"
Samples = NDArray[np.float64]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--samples", type=int, default=10_000_000)
    parser.add_argument("--fitted", type=int, default=100_000)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    slower = filter_ratio(options.samples, options.turns)
    fits = fit_ratios(simulate(TRUTH, options.fitted, np.random.default_rng(1)))
    if options.json:
        print(json.dumps({"denoise": slower, "fits": fits}, indent=1))
    else:
        print(f"denoise of {options.samples:,} samples: {slower:.2f} × the time of no momentum")
        print(f"fit of q, r and momentum to {options.fitted:,} samples")
        for name, row in fits.items():
            print(f"  {name:32}{row['seconds']:8.3g} s {row['ratio']:8.3g} ×   log-likelihood {row['loglik']:.2f}")
    return int(slower > MAX_SLOWER or fits[STATE_SPACE]["ratio"] < MIN_FASTER)


def filter_ratio(n: int, turns: int) -> float:
    """Time of `denoise` with momentum over that without, median of the turns."""
    z = np.cumsum(np.random.default_rng(1).normal(0.0, 0.1, n))
    out = np.empty_like(z)
    plain, moving = (FilterParams(q=0.01, r=1.0, momentum=tau) for tau in (0.0, 20.0))
    runs = (lambda: denoise(z, moving, out=out)), (lambda: denoise(z, plain, out=out))
    for run in runs:
        run()
    slow, fast = take_turns(*runs, turns)
    return statistics.median(a / b for a, b in zip(slow, fast, strict=True))


def fit_ratios(z: Samples) -> dict[str, dict[str, float]]:
    """Seconds of each fit, over those of Kalscope's before and after it, and its log-likelihood."""
    own = {OWN: lambda: fitted(z).loglik, "estimate(z)": lambda: float(estimate(z).loglik)}
    rows: dict[str, dict[str, float]] = {}
    for fit in own.values():
        fit()  # compiles
    for name, fit in (own | peers(z)).items():
        before, (seconds, loglik), after = timed(own[OWN]), timed(fit), timed(own[OWN])
        rows[name] = {"seconds": seconds, "ratio": 2.0 * seconds / (before[0] + after[0]), "loglik": loglik}
    return rows


def timed(fit: Callable[[], float]) -> tuple[float, float]:
    """Seconds of the processor for a fit, and its log-likelihood."""
    start = time.process_time()
    loglik = fit()
    return time.process_time() - start, loglik


def peers(z: Samples) -> dict[str, Callable[[], float]]:
    """The fits of statsmodels as they come; each returns the log-likelihood that it reaches."""
    sm: Any = importlib.import_module("statsmodels.api")
    warnings.simplefilter("ignore")  # they warn where their search ends early
    trend = sm.tsa.statespace.ExponentialSmoothing
    return {
        STATE_SPACE: lambda: float(trend(z, trend=True, damped_trend=True).fit(disp=0).llf),
        "ARIMA(1, 1, 2)": lambda: float(sm.tsa.SARIMAX(z, order=(1, 1, 2)).fit(disp=0).llf),
        "damped trend, constant gains": lambda: float(
            sm.tsa.ETSModel(z, trend="add", damped_trend=True).fit(disp=0).llf
        ),
    }


if __name__ == "__main__":
    sys.exit(main())
