"""The filter of "Single Dimensional Generalized Kalman Filter" (Khan et al.), in two readings.

Both begin with K = σE/(σE + σM) and E ← E + K (M − E), equations (1) and (2). Then

    "printed"        σE ← (1 − K) E(t−1)    equation (3) as it stands: the estimate itself becomes the error
    "without_slip"   σE ← (1 − K) σE        what was evidently meant

The first is a filter whose gain follows the level of the signal; the second is the five-line filter with q = 0,
r = σM and p0 = σE, whose gain falls like 1/n until it no longer moves. Neither depends on time steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.compiled import compiled
from kalscope.common.numbers import Array, above_zero
from kalscope.errors import BadSetting
from kalscope.filtering.filter import Filter, FilterResult, KalmanFilter, kalman_filter
from kalscope.filtering.params import MAX_VARIANCE, FilterParams, one_record, one_sample, step_of
from kalscope.filtering.steady import SteadyState, params_of_gain, steady_state


@compiled(inner=True, inline="always")
def _step_printed(m: float, sigma_m: float, e: float, sigma_e: float) -> tuple[float, float, float, float, float]:
    """One sample: returns E, σE, K, M − E and σE + σM. NaN for e or inf for sigma_e means "not started".

    Khan et al., equations (1)-(3); (3) multiplies by the estimate before the update, as printed.
    """
    if math.isnan(m):
        return e, sigma_e, 0.0, math.nan, sigma_e + sigma_m
    v = m - e
    if math.isnan(e):  # the first sample is the estimate
        e = m
    if math.isinf(sigma_e):  # what (3) leaves of an estimate that was not corrected, K = 0
        sigma_e = e
    s = sigma_e + sigma_m
    k = sigma_e / s
    before = e
    if not math.isnan(v):
        e = e + k * v
    return e, (1.0 - k) * before, k, v, s


@compiled()
def _run_printed(
    z: Array, sigma_m: float, e: float, sigma_e: float, out: tuple[Array, Array, Array, Array, Array]
) -> int:
    """Filter one channel into `out` = (E, σE, K, M − E, σE + σM).

    Returns -1, or the index of the first estimate that is not above 0, where the recursion breaks.
    """
    out_e, out_sigma, out_k, out_v, out_s = out
    for i in range(z.shape[0]):
        e, sigma_e, k, v, s = _step_printed(z[i], sigma_m, e, sigma_e)
        if e <= 0.0:
            return i
        out_e[i], out_sigma[i], out_k[i], out_v[i], out_s[i] = e, sigma_e, k, v, s
    return -1


READINGS = ("printed", "without_slip")
"""How equation (3) is read."""


@dataclass(frozen=True)
class GeneralizedParams(Filter):
    """Parameters of the generalized filter, the same for every channel.

    Raises:
        BadSetting: a value is not a finite number in its range, or the reading is unknown.
    """

    sigma_m: float
    """Measured error σM, above 0: in the printed reading an amount in the unit of the signal, in the other
    one a variance, unit²."""
    sigma_e0: float | None = None
    """First estimated error σE, above 0, measured like σM; None = the first estimate itself ("printed"), or an
    exact diffuse start ("without_slip")."""
    e0: float | None = None
    """First estimate E, unit; above 0 in the printed reading; None = the first finite sample."""
    reading: str = "printed"
    """Equation (3) as "printed", or "without_slip"."""

    def __post_init__(self) -> None:
        if self.reading not in READINGS:
            raise BadSetting(f"reading must be one of {', '.join(READINGS)} (got {self.reading!r})")
        e0 = self.e0 if self.reading == "printed" else None
        for name, value in (("sigma_m", self.sigma_m), ("sigma_e0", self.sigma_e0), ("e0", e0)):
            if value is not None:
                above_zero(name, value, MAX_VARIANCE)
        if self.e0 is not None and self.sigma_e0 is None and self.reading == "without_slip":
            raise BadSetting(f"e0 needs sigma_e0, the error of that first estimate (got e0 = {self.e0} alone)")

    @property
    def five_line_params(self) -> FilterParams:
        """The five-line filter that the reading without the slip is: q = 0, r = σM, p0 = σE, x0 = E."""
        return FilterParams(q=0.0, r=self.sigma_m, p0=self.sigma_e0, x0=self.e0)

    def run(self, z: ArrayLike, dt: ArrayLike | None = None) -> FilterResult:
        """Filter a record; called like `kalman_filter`, with a result of the same kind.

        Args:
            z: measurements, shape (n,); NaN is a missing sample, in which nothing changes.
            dt: checked as everywhere, shape (n,), ≥ 0, but without effect: the filter has no process noise.

        Returns:
            `x` is E, `p` is σE, `k` is K, `innovation` is M − E, `s` is σE + σM. In the printed reading σE is not a
            variance, so `loglik` is NaN and `m` is 0.

        Raises:
            BadSetting: z holds inf or has another shape; dt does not fit z; in the printed reading an estimate
                that is not above 0.

        Source: Khan et al., equations (1)–(3).
        """
        if self.reading == "without_slip":
            return kalman_filter(z, self.five_line_params, dt)
        samples, _ = one_record(z, dt)
        x, p, k, innovation, s = (np.empty_like(samples) for _ in range(5))
        stopped = _run_printed(samples, self.sigma_m, *_start(self), (x, p, k, innovation, s))
        if stopped >= 0:
            raise _not_above_zero(f"at sample {stopped}", float(samples[stopped]))
        return FilterResult(x, p, k, innovation, s, math.nan, 0, 0)

    def stream(self) -> KalmanFilter | PrintedStream:
        """The same filter, sample by sample, equal to `run` bit for bit."""
        return KalmanFilter(self.five_line_params) if self.reading == "without_slip" else PrintedStream(self)

    def settled(self, result: FilterResult, sample_period: float | None = None) -> SteadyState:
        """The Kalman filter that settles at the last gain of a run: its own gain follows the level."""
        return steady_state(params_of_gain(float(result.k[-1])), sample_period)


def printed_gain(level: float, sigma_m: float) -> float:
    """The gain at which equation (3) as printed settles on a signal of constant `level` E.

    σE = (1 − K) E with K = σE/(σE + σM) gives σE² + σM σE − σM E = 0, so
    σE = (−σM + √(σM² + 4 E σM))/2. The map's slope there is −K, so it is reached with alternating sign, and more
    slowly the closer K is to 1.

    Args:
        level: the estimate E, unit, > 0.
        sigma_m: measured error σM, unit, > 0.

    Raises:
        BadSetting: a value is not above 0: then there is no fixed point with a gain between 0 and 1.

    Source: derived from Khan et al., equations (1) and (3).
    """
    above_zero("level", level, MAX_VARIANCE)
    above_zero("sigma_m", sigma_m, MAX_VARIANCE)
    # s = σE/σM solves s² + s = E/σM; this form loses no digits where E is small against σM.
    u = level / sigma_m
    s = 2.0 * u / (1.0 + math.sqrt(1.0 + 4.0 * u))
    return s / (1.0 + s)


class PrintedStream:
    """The filter of the printed reading with its state."""

    def __init__(self, params: GeneralizedParams) -> None:
        self._params, self._state = params, _start(params)

    def update(self, z: ArrayLike, dt: float | None = None) -> float:
        """Take one sample and return the filtered value.

        Args:
            z: the sample; NaN is a missing one.
            dt: checked, ≥ 0, but without effect.

        Raises:
            BadSetting: z is infinite or not one number; dt is negative; an estimate that would not
                be above 0. The state stays.
        """
        step_of(dt)
        sample = one_sample(z)
        e, sigma_e, _, _, _ = _step_printed(sample, self._params.sigma_m, *self._state)
        if e <= 0.0:
            raise _not_above_zero("now", sample)
        self._state = e, sigma_e
        return e


def _start(params: GeneralizedParams) -> tuple[float, float]:
    """E and σE as the kernel starts with them: NaN and inf mean "automatic"."""
    e = math.nan if params.e0 is None else float(params.e0)
    return e, math.inf if params.sigma_e0 is None else float(params.sigma_e0)


def _not_above_zero(when: str, sample: float) -> BadSetting:
    return BadSetting(
        "equation (3) as printed needs estimates above 0, because it takes the estimate for an error"
        f" (got an estimate of 0 or less {when}, where the sample is {sample:g}); add an offset to the signal,"
        ' start from an e0 above 0, or choose the reading "without_slip"'
    )
