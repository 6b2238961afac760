"""Memory of a program that reads a board for long: how much the samples that it keeps explain, and the rest."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

KEPT = 1_000_000
"""Samples that the program keeps at least; a quarter more before the oldest leave at once."""
BYTES_OF_A_SAMPLE = 8
SETTLED = 0.2
"""Part of the time after which memory is held against the end: libraries are loaded, caches filled."""
FULL_LOOKS = 8
"""Looks with a full memory from which on it is judged by them alone: nothing is then left that may grow."""


@dataclass(frozen=True)
class MemoryLook:
    """Memory at one moment."""

    minute: float
    """When, from the start of the stream."""
    rss_mb: float
    """Resident memory of the program."""
    kept_mb: float
    """What the kept samples and the filter's run over them take, by their number."""


def kept_mb(sent: int, arrays: int) -> float:
    """Memory of what is kept after `sent` samples, in this many arrays, at most."""
    kept = sent if sent <= KEPT else KEPT + (sent - KEPT) % (KEPT // 4)
    return kept * BYTES_OF_A_SAMPLE * arrays / 1e6


def settled_at(looks: Sequence[object]) -> int:
    """Index of the look from which on memory is watched."""
    return min(int(SETTLED * len(looks)), len(looks) - 1)


def memory_of(looks: Sequence[MemoryLook]) -> dict[str, float]:
    """Growth of the resident memory in MB, and what of it the kept samples do not explain.

    Once old samples leave, the medians of the two halves since then are compared; before, the settled look and the
    last one, less the samples received between them.
    """
    leave = next((i for i in range(1, len(looks)) if looks[i].kept_mb < looks[i - 1].kept_mb), len(looks))
    full = looks[leave:]
    if len(full) < FULL_LOOKS:
        start, end = looks[settled_at(looks)], looks[-1]
        growth, kept = end.rss_mb - start.rss_mb, end.kept_mb - start.kept_mb
        return {"rss_start_mb": start.rss_mb, "rss_end_mb": end.rss_mb, "unexplained_mb": growth - kept}
    half = len(full) // 2
    start_mb, end_mb = (statistics.median(one.rss_mb for one in part) for part in (full[:half], full[half:]))
    return {
        "rss_start_mb": looks[0].rss_mb,
        "rss_end_mb": looks[-1].rss_mb,
        "rss_full_first_half_mb": start_mb,
        "rss_full_second_half_mb": end_mb,
        "unexplained_mb": end_mb - start_mb,
    }
