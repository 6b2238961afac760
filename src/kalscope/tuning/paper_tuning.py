"""A channel that runs the filter of Khan et al. in place of the Kalman filter: shown, and in no tuning file."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from kalscope.filtering.protocol import Filter
from kalscope.papers.generalized import GeneralizedParams
from kalscope.tuning.tuning import ChannelTuning


@dataclass(frozen=True)
class PaperTuning(ChannelTuning):
    """The setting of such a channel; its q and r are kept for a return to the Kalman filter."""

    paper: GeneralizedParams = field(kw_only=True)
    """The filter that it runs."""

    @property
    def filter(self) -> Filter:
        """The same."""
        return self.paper


def with_paper_filter(tuning: ChannelTuning, paper: GeneralizedParams) -> PaperTuning:
    """The setting with this filter in place of its own."""
    return PaperTuning(**_values(tuning), paper=paper)


def with_kalman_filter(tuning: ChannelTuning) -> ChannelTuning:
    """The setting with the Kalman filter alone, at the q and r that it has."""
    return ChannelTuning(**_values(tuning))


def _values(tuning: ChannelTuning) -> dict[str, Any]:
    values: dict[str, Any] = {one.name: getattr(tuning, one.name) for one in fields(ChannelTuning)}
    return {**values, "chain": None}
