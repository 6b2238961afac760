"""A chain of two filters: a median, and what follows it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

from kalscope.errors import BadSetting
from kalscope.filtering.classic.checks import odd_window
from kalscope.filtering.classic.stages import Median, Stage


@dataclass(frozen=True)
class Chain:
    """A median, then a classic filter or the channel's own Kalman filter.

    Raises:
        BadSetting: The median is not an odd number of samples; or there is neither a median nor a classic filter:
            then there is no chain, and the Kalman filter runs alone.
    """

    median: int = 1
    """Window of the median in samples, an odd number; 1 = none."""
    then: Stage | None = None
    """The filter behind it; None = the Kalman filter of the channel's q, r, p0, x0, gate and momentum."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "median", odd_window("median", self.median))
        if self.then is not None and type(self.then) not in get_args(Stage):
            raise BadSetting(f"then must be a classic filter, or None for the Kalman filter (got {self.then!r})")
        if self.median == 1 and self.then is None:
            raise BadSetting(
                "a chain must have a median of at least 3 samples, or a filter in place of Kalman's (got neither); "
                "for the Kalman filter alone leave the chain out"
            )

    @property
    def stages(self) -> tuple[Stage, ...]:
        """The classic filters, in order; where `then` is None the Kalman filter follows them."""
        first = (Median(self.median),) if self.median > 1 else ()
        return first if self.then is None else (*first, self.then)

    @property
    def words(self) -> str:
        """The chain for the user, within a sentence: "median of 5, then one-euro (cut-off 0.02, β 0.1)"."""
        last = "Kalman" if self.then is None else f"{_lower(self.then.name)} ({self.then.words})"
        return last if self.median == 1 else f"median of {self.median}, then {last}"


def _lower(name: str) -> str:
    return name[:1].lower() + name[1:]
