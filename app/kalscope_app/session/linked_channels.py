"""Tuning several channels at once: what the others become when one changes. Pure."""

from __future__ import annotations

import math
from dataclasses import replace

from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.stages import OneEuro
from kalscope.filtering.params import MAX_VARIANCE
from kalscope.tuning.paper_tuning import with_kalman_filter
from kalscope.tuning.tuning import ChannelTuning

UNLINKED, SAME_NUMBERS, SAME_LAG = "this channel alone", "all: same q and r", "all: same lag, own noise"

LINKS: tuple[str, ...] = (UNLINKED, SAME_NUMBERS, SAME_LAG)
"""How channels are linked, in the words on screen. Axes of one sensor share their numbers; a pressure and a
temperature share at most the lag: then q, r and p0 are scaled by each channel's own noise. Momentum, a number of
samples, is the same for all."""

Tunings = tuple[ChannelTuning, ...]


def apply_to_linked(tunings: Tunings, starts: Tunings, leader: int, link: str) -> Tunings:
    """All tunings once the others follow the leading one; unchanged where each is tuned alone.

    Args:
        tunings: of all channels.
        starts: what they began with; their r is each channel's own noise.
        leader: index of the channel that was changed.
        link: one of LINKS.
    """
    if link == UNLINKED:
        return tunings
    return tuple(
        own if i == leader else scaled_copy(tunings[leader], own, _factor(starts, leader, i, link))
        for i, own in enumerate(tunings)
    )


def scaled_copy(leader: ChannelTuning, own: ChannelTuning, factor: float = 1.0) -> ChannelTuning:
    """Another channel's setting, its variances `factor` times as large.

    The start value x0 is taken over as it is, or, where the scale of the channels differs, left to the channel.
    """
    p0 = None if leader.p0 is None else _scaled(leader.p0, factor)
    x0 = leader.x0 if factor == 1.0 else own.x0
    return replace(
        with_kalman_filter(own),
        q=_scaled(leader.q, factor),
        r=_scaled(leader.r, factor),
        p0=p0,
        x0=None if p0 is None else x0,
        gate=leader.gate,
        momentum=leader.momentum,
        how=leader.how,
        chain=_scaled_chain(leader.chain, factor),
    )


def _scaled_chain(chain: Chain | None, factor: float) -> Chain | None:
    """The same chain at `factor` times the variances: only the one-euro filter has a setting with a unit."""
    if chain is None or not isinstance(chain.then, OneEuro):
        return chain
    return replace(chain, then=replace(chain.then, beta=chain.then.beta / math.sqrt(factor)))


def _factor(starts: Tunings, leader: int, i: int, link: str) -> float:
    return starts[i].r / starts[leader].r if link == SAME_LAG and starts[leader].r > 0.0 else 1.0


def _scaled(variance: float, factor: float) -> float:
    """The product; 0 stays 0 and nothing else becomes 0."""
    if variance == 0.0 or factor == 1.0:
        return variance
    return min(max(variance * factor, 1e-300), MAX_VARIANCE)
