"""How well each momentum explains the channel on screen, with the best q and r of each. Computed on request."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.estimation.estimate import estimate
from kalscope.filtering.params import MAX_MOMENTUM
from kalscope_app.session.state import State

MIN_DRAWN = 0.3
"""Samples: a shorter momentum cannot be distinguished from none."""

POINTS = 25
"""Values of the momentum, evenly spaced in its logarithm."""


@dataclass(frozen=True, eq=False)
class MomentumProfile:
    """The likelihood over the momentum; compared by identity, because arrays have no single truth value."""

    state: State
    """The choices that it belongs to."""
    momentum: Array
    """Samples, rising, shape (k,)."""
    loglik: Array
    """Log-likelihood with the best q and r of each, shape (k,)."""
    plain: float
    """The same without momentum."""

    def belongs_to(self, state: State) -> bool:
        """Whether it is still about the channel on screen."""
        mine = self.state
        return (mine.record_key, mine.channel, mine.recording.gaps) == (
            state.record_key,
            state.channel,
            state.recording.gaps,
        )


def momentum_profile(
    state: State, progress: Callable[[float, str], None], cancelled: Callable[[], bool]
) -> MomentumProfile:
    """The profile of the channel on screen: one search for q and r at each momentum.

    Raises:
        BadSetting: the channel has too little information for a search.
        Cancelled: `cancelled()` was true.
    """
    z, dt = state.z, state.dt
    longest = min(MAX_MOMENTUM, 10.0 * max(len(z), 10))  # longer ones are a constant velocity over the whole record
    momentum = np.geomspace(MIN_DRAWN, longest, POINTS)
    found: list[float] = []
    for i, tau in enumerate((0.0, *momentum.tolist())):
        progress(i / (POINTS + 1), "likelihood over the momentum")
        best = estimate(z, "ml", dt=dt, momentum=tau, cancelled=cancelled)
        if best.verdict in ("too_few", "constant", "bad_unit"):
            raise BadSetting(f"there is no momentum profile, because q and r cannot be found: {best.message}")
        found.append(float(best.loglik))
    return MomentumProfile(state, momentum, np.array(found[1:]), found[0])
