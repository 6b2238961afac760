"""Libraries that are called Kalman and are another filter: why they are refused, and what is nearest."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kalscope.errors import BadSetting
from kalscope.export.names import comment_text, number_text

if TYPE_CHECKING:
    from collections.abc import Callable

    from kalscope.export.job import ExportJob

MOST_LINES = 4
"""Channels that the message shows; a message is one line."""


def refusal(job: ExportJob, library: str, line: Callable[[str, str], str]) -> BadSetting:
    """The error of a target that is not this filter.

    Args:
        job: What was to be exported.
        library: Its name for a person.
        line: Code for a channel's identifier and its gain as text: the exponential smoothing that our filter
            settles into (α = K).
    """
    lines = []
    for word, channel in list(zip(job.identifiers, job.channels, strict=True))[:MOST_LINES]:
        gain = float(job.steady(channel).gain)
        said = line(word, number_text(float(f"{gain:.6g}"))) if gain > 0.0 else "none, because q is 0 (a mean)"
        lines.append(f"{comment_text(channel.name)}: {said}")
    more = "" if len(job.channels) <= MOST_LINES else f"; and {len(job.channels) - MOST_LINES} more channels"
    return BadSetting(
        f"target must be a filter that q and r mean the same to (got {library}: its q multiplies the size of the"
        " last step, |x - x before|, and it starts at 0, so the tuned numbers would give another filter)."
        f" Export arduino or c, or use the nearest fixed gain: {'; '.join(lines)}{more}"
    )
