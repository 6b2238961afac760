"""`estimate_many`: q and r of many series in one compiled call, without Python code per series."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.array import Array, Mask
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation.estimate import checked_momentum, estimate
from kalscope.estimation.fleet.many import fit_kernels as kernels
from kalscope.estimation.fleet.many.plain import fit_plain, pair_intervals
from kalscope.estimation.fleet.many.series import Series, above_zero_each, series_of
from kalscope.estimation.fleet.many.spike_free import spike_free
from kalscope.estimation.fleet.many.table import VERDICTS, EstimateTable
from kalscope.estimation.known import estimate_fixed_r, estimate_fixed_ratio, may_be_below_resolution
from kalscope.estimation.result import Estimate
from kalscope.estimation.robust.fit import checked_robust
from kalscope.estimation.robust.kernels import suspect_each

_AT_ONCE = 4_000_000
"""Samples of one compiled call, a fraction of a second; progress and cancellation are handled between two."""


def estimate_many(
    series: Series | ArrayLike | Sequence[ArrayLike],
    dt: ArrayLike | Sequence[ArrayLike] | None = None,
    *,
    momentum: float | Literal["auto"] = 0.0,
    robust: bool | Literal["auto"] = "auto",
    r: ArrayLike | None = None,
    ratio: ArrayLike | None = None,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> EstimateTable:
    """Find q and r by maximum likelihood in many series: the numbers of `estimate`, thousands of series a second.

    A series that cannot be fitted is a row with its verdict, never an error. Without momentum, the default, the
    table holds what `estimate(z, momentum=0)` finds. With it, or where a series has spikes (which the compiled call
    detects), a series takes as long as in `estimate`.

    Args:
        series: a list of 1-D arrays of any lengths, a 2-D array with one series a row, or a Series (all samples in
            one array, such as the buffer of an Arrow list column); NaN is a missing sample.
        dt: nominal sample periods before each sample, ≥ 0, shaped like `series`; None = 1 each.
        momentum: τ in nominal sample periods or "auto", as in `estimate`.
        robust: whether spikes are set aside, as in `estimate`.
        r: measurement-noise variance where it is known, unit², > 0, one or shape (series,): as `estimate_fixed_r`.
        ratio: λ = q/r where it is chosen, > 0, one or shape (series,): as `estimate_fixed_ratio`.
        progress: called with the fraction done and a few words; None = not reported.
        cancelled: whether to stop; None = never.

    Returns:
        An EstimateTable, arrays of shape (series,).

    Raises:
        BadSetting: the series or dt have another shape; momentum, robust, r or ratio is out of range, or r and
            ratio are both given, or one of them with momentum.
        Cancelled: `cancelled()` was true.

    Source: as `estimate`.
    """
    many = series_of(series, dt)
    asked = _Asked.of(len(many), momentum, robust, r, ratio)
    report = Progress(progress, cancelled)
    table = _Columns(len(many))
    report(0.0, "fit")
    compiled = asked.tau == 0.0 and asked.robust is not True
    for first, stop in many.parts(_AT_ONCE if compiled else 1):
        part = Series(many.values, many.starts[first : stop + 1], many.steps)
        table.fit(part, asked, slice(first, stop))
        again = range(first, stop) if not compiled else first + np.flatnonzero(table.again[first:stop])
        for i in again:
            if asked.kind == kernels.FREE or asked.robust is not False:
                table.refine(int(i), many, asked)
        report(stop / max(len(many), 1), "fit")
    return table.as_table()


@dataclass(frozen=True)
class _Asked:
    """What the caller asked for, checked."""

    tau: float | None
    """Momentum; None = to be found."""
    robust: bool | None
    """Whether spikes are set aside; None = where there are any."""
    kind: int
    """What is known, as the kernels name it."""
    known: Array
    """r or λ of each series, shape (k,)."""

    @staticmethod
    def of(count: int, momentum: Any, robust: Any, r: Any, ratio: Any) -> _Asked:
        if r is not None and ratio is not None:
            raise BadSetting("r and ratio must not both be given: together they leave nothing to find (got both)")
        tau = checked_momentum(momentum, "ml")
        kind = kernels.KNOWN_R if r is not None else kernels.KNOWN_RATIO if ratio is not None else kernels.FREE
        if kind != kernels.FREE and tau != 0.0:
            raise BadSetting(f"momentum must be 0 where r or ratio is given (got {momentum!r})")
        known = above_zero_each("r", r, count) if r is not None else above_zero_each("ratio", ratio, count)
        return _Asked(tau, checked_robust(robust), kind, known)

    def of_one(self, index: int, z: Array, dt: Array | None) -> Estimate:
        """The estimate of one series, as the library finds it for a single one."""
        robust = "auto" if self.robust is None else self.robust
        if self.kind == kernels.KNOWN_R:
            return estimate_fixed_r(z, float(self.known[index]), dt, robust)
        if self.kind == kernels.KNOWN_RATIO:
            return estimate_fixed_ratio(z, float(self.known[index]), dt, robust)
        return estimate(z, dt=dt, momentum="auto" if self.tau is None else self.tau, robust=robust)


class _Columns:
    """The table while it is filled."""

    def __init__(self, count: int) -> None:
        self.numbers = np.empty((count, kernels.NUMBERS))
        self.codes = np.empty(count, np.uint8)
        self.samples = np.empty(count, np.int64)
        self.again = np.empty(count, np.bool_)
        self.momentum = np.zeros((3, count))
        self.spikes = np.zeros(count, np.int64)
        self.gate = np.full(count, math.inf)
        self.set_aside: list[NDArray[np.int64]] = []

    def fit(self, many: Series, asked: _Asked, rows: slice) -> None:
        """Fit some series, in one compiled call."""
        found = fit_plain(many, asked.kind, asked.known[rows], many.starts[1:])
        self.numbers[rows], self.codes[rows], self.samples[rows], self.again[rows] = found
        if asked.robust is None:
            q, r = np.ascontiguousarray(self.numbers[rows, [kernels.Q, kernels.R]].T)
            suspect = np.empty(len(many), np.bool_)
            suspect_each(many.values, many.steps, many.starts[:-1], many.starts[1:], q, r, suspect)
            self._clear(many, asked, rows, suspect)
            self.again[rows] |= suspect

    def _clear(self, many: Series, asked: _Asked, rows: slice, suspect: Mask) -> None:
        """Unmark the suspect series that have no spikes after all."""
        chosen = np.flatnonzero(suspect & ~self.again[rows])
        if not len(chosen):
            return
        known = asked.known[rows][chosen]

        def fit(some: Series, at: NDArray[np.intp]) -> tuple[Array, Array, Mask]:
            numbers, codes, _, stepped = fit_plain(some, asked.kind, known[at], some.starts[1:])
            q, r = np.ascontiguousarray(numbers[:, [kernels.Q, kernels.R]].T)
            return q, r, (codes <= kernels.NO_MOVEMENT) & ~stepped

        suspect[chosen] = ~spike_free(many.some(chosen), fit)

    def refine(self, i: int, many: Series, asked: _Asked) -> None:
        """Fit one series as `estimate` does, unless nothing in it can be fitted or its numbers would stay."""
        if self.codes[i] in (kernels.HOLDS_INF, kernels.BAD_STEPS, kernels.TOO_FEW, kernels.CONSTANT):
            return
        (z, steps), start = many.one(i), int(many.starts[i])
        plain = asked.tau == 0.0 and asked.robust is False
        if plain and not may_be_below_resolution(z, float(self.numbers[i, kernels.R])):
            return
        one = asked.of_one(i, z, steps if len(steps) else None)
        ends = pair_intervals(one, z, steps)
        self.numbers[i] = (one.q, one.r, one.q_se, one.r_se, one.loglik, *one.ratio_interval, *ends)
        self.codes[i] = VERDICTS.index(str(one.verdict))
        self.momentum[:, i] = (one.momentum, *one.momentum_interval)
        if one.outliers is not None:
            away = np.flatnonzero(one.outliers)
            self.spikes[i] = len(away)
            self.set_aside.append(start + away)
        self.gate[i] = math.inf if one.gate is None else float(one.gate)

    def as_table(self) -> EstimateTable:
        q, r, q_se, r_se, loglik, *ends = np.ascontiguousarray(self.numbers.T)
        tau, tau_low, tau_high = self.momentum
        away = np.concatenate([np.empty(0, np.int64), *self.set_aside])
        return EstimateTable(
            q, r, q_se, r_se, loglik, (ends[0], ends[1]), (ends[2], ends[3]), (ends[4], ends[5]),
            self.codes, self.samples, tau, (tau_low, tau_high), self.spikes, self.gate, away,
        )  # fmt: skip
