"""What every filter can do: the standard one, of q and r, and others beside it.

A filter is a frozen, hashable value of its parameters: filters that are equal give equal results.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.filtering.filter import FilterResult, KalmanFilter, denoise, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SteadyState, steady_state


class StreamingFilter(Protocol):
    """One `update` per sample; `x`, `p` and `k` are the state after it."""

    @property
    def x(self) -> float: ...  # noqa: D102

    @property
    def p(self) -> float: ...  # noqa: D102

    @property
    def k(self) -> float | Array: ...  # noqa: D102

    def update(self, z: ArrayLike, dt: float | None = None) -> float:
        """Take one sample and return the filtered value."""
        ...


class Filter(Protocol):
    """A filter with its parameters."""

    @property
    def is_standard(self) -> bool:
        """Whether it is the Kalman filter of q and r alone: only that can be searched for, judged and mapped."""
        ...

    def run(self, z: ArrayLike, dt: ArrayLike | None = None) -> FilterResult:
        """Filter a record; arguments and errors as `kalman_filter`."""
        ...

    def denoise(self, z: ArrayLike, dt: ArrayLike | None = None) -> Array:
        """The filtered signal only; arguments and errors as `denoise`."""
        ...

    def stream(self) -> StreamingFilter:
        """The same filter, sample by sample."""
        ...

    def settled(self, result: FilterResult, sample_period: float | None = None) -> SteadyState:
        """Gain, lag and noise reduction once the start is forgotten.

        Args:
            result: a run of this filter over one channel, for filters whose gain depends on the signal.
            sample_period: nominal sample period in s, > 0.
        """
        ...


@dataclass(frozen=True)
class StandardFilter:
    """The scalar Kalman filter of q and r as a `Filter`."""

    params: FilterParams

    @property
    def is_standard(self) -> bool:
        """True."""
        return True

    def run(self, z: ArrayLike, dt: ArrayLike | None = None) -> FilterResult:
        """`kalman_filter`."""
        return kalman_filter(z, self.params, dt)

    def denoise(self, z: ArrayLike, dt: ArrayLike | None = None) -> Array:
        """`denoise`: faster than `run`, and within 1e-12 · max|z| of it."""
        return denoise(z, self.params, dt)

    def stream(self) -> KalmanFilter:
        """A `KalmanFilter`."""
        return KalmanFilter(self.params)

    def settled(self, result: FilterResult, sample_period: float | None = None) -> SteadyState:  # noqa: ARG002
        """`steady_state`: q and r alone decide it."""
        return steady_state(self.params, sample_period)
