"""Libraries whose filter is called Kalman but is a different one: refused, with the nearest fixed gain instead."""

from __future__ import annotations

from dataclasses import dataclass

from kalscope.errors import BadSetting
from kalscope.export.job import ExportJob
from kalscope.export.names import comment_text, number_text
from kalscope.export.targets.libraries.nearest import nearest_without_momentum

MAX_CHANNELS_SHOWN = 4
"""Channels whose code the message gives: it is one line."""


@dataclass(frozen=True)
class RefusedLibrary:
    """A library in which q and r mean something else."""

    filter_name: str
    """Its filter, as the message calls it."""
    nearest: str
    """Code for exponential smoothing with α = K, which our filter settles into; {name} and {gain} are filled in."""

    def files(self, job: ExportJob) -> dict[str, str]:
        """Always raises BadSetting; the message gives the nearest code for each channel."""
        lines: list[str] = []
        for name, channel in job.named_channels[:MAX_CHANNELS_SHOWN]:
            gain = float(job.steady(nearest_without_momentum(channel)).gain)
            code = self.nearest.format(name=name, gain=number_text(float(f"{gain:.6g}")))
            lines.append(f"{comment_text(channel.name)}: {code if gain > 0.0 else 'none, because q is 0 (a mean)'}")
        more = len(job.channels) - MAX_CHANNELS_SHOWN
        raise BadSetting(
            f"target must use q and r as Kalscope does (got {self.filter_name}: its q multiplies the size of the"
            " last step, |x - x before|, and it starts at 0, so these values would give a different filter)."
            f" Export arduino or c, or use the nearest fixed gain: {'; '.join(lines)}"
            f"{f'; and {more} more channels' if more > 0 else ''}"
        )


SIMPLE_KALMAN_FILTER = RefusedLibrary("SimpleKalmanFilter", "{name} += {gain} * (z - {name})")
"""denyssene/SimpleKalmanFilter."""
GYVER_FILTERS = RefusedLibrary("GKalman of GyverFilters", "GFilterRA {name}({gain}) (starts at 0)")
"""Its other filter, GFilterRA, is the nearest."""
