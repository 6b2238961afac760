"""The recording of a device of a fleet again, and the tunings that it can be opened at."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from typing import Any

from kalscope.common.progress import OnProgress
from kalscope.errors import BadFile
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.readers.recording_file import read_recording
from kalscope.tuning.fleet.recordings.unit import Piece, Unit
from kalscope.tuning.fleet.results.fleet import Fleet
from kalscope.tuning.fleet.work.row_groups import one_recording
from kalscope.tuning.tuning import ChannelTuning, Tuning

MAX_GROUPS = 100_000
"""Row groups of a file, at most."""


@dataclass(frozen=True)
class Kept:
    """Where the recording of a row is and how the fleet read it."""

    id: str
    """Name of the device."""
    source: str
    """See `Row.source`."""
    reading: ReadOptions
    """How the fleet read it."""
    sample_period: float | None
    """Sample period in s that the fleet was given; None = by its stamps."""


def kept_at(fleet: Fleet, i: int) -> Kept:
    """Where the recording of row `i` is."""
    return Kept(fleet.devices.ids[i], fleet.sources[i], fleet.begun.reading, fleet.begun.sample_period)


def reopen(kept: Kept, options: ReadOptions | None = None, *, progress: OnProgress | None = None) -> Recording:
    """Read the recording of a row as the fleet read it.

    Args:
        kept: Where it is.
        options: How to read it; None = as the fleet did.
        progress: See `read_recording`; a data set has none.

    Raises:
        BadFile: it is no longer where the fleet found it, or cannot be read.
        BadSetting: an option does not suit it.
    """
    reading, period = kept.reading if options is None else options, kept.sample_period
    if not kept.source.startswith("["):
        return read_recording(_existing(kept.source), reading, sample_period=period, progress=progress)
    return one_recording(_unit(kept.id, kept.source), reading, period)


def own_tuning(fleet: Fleet, i: int) -> Tuning:
    """The filter that the fleet found for this device.

    Raises:
        BadSetting: it has none.
    """
    devices, momentum = fleet.devices, float(fleet.devices.momentum[i])
    return _tuning(
        fleet,
        i,
        q=float(devices.q[i]),
        r=float(devices.r[i]),
        how="its own fit in the fleet",
        gate=None if math.isnan(fleet.gates[i]) else float(fleet.gates[i]),
        momentum=0.0 if math.isnan(momentum) else momentum,
        period=1.0 / float(devices.rate_hz[i]) if devices.rate_hz[i] > 0.0 else None,
    )


def shared_tuning(fleet: Fleet, i: int) -> Tuning | None:
    """The filter for all on the channel of this device; None where there is none."""
    shared = fleet.shared
    if shared is None:
        return None
    params = shared.params
    q, r, momentum = params.q, float(params.r), params.momentum
    return _tuning(fleet, i, q=q, r=r, how=shared.how, momentum=momentum, period=fleet.devices.sample_period)


def _tuning(fleet: Fleet, i: int, *, period: float | None, **values: Any) -> Tuning:
    channel = ChannelTuning(fleet.devices.channels[i], fleet.devices.units[i], **values)
    return Tuning((channel,), sample_period=period)


def _existing(path: str) -> str:
    """A path, checked to be that of a file."""
    if not (os.path.isabs(path) and os.path.isfile(path)):
        raise BadFile(f"the recording must be where the fleet found it (got no file at {path[:300]!r})")
    return path


def _unit(name: str, source: str) -> Unit:
    """The row groups that a source names."""
    try:
        data_set, found = json.loads(source)
        pieces = tuple(Piece(_existing(str(path)), groups=_groups(runs)) for path, runs in found)
        if not (pieces and all(piece.groups for piece in pieces)):
            raise ValueError("no row group")
    except (ValueError, TypeError, RecursionError) as error:
        if isinstance(error, BadFile):
            raise
        raise BadFile(f"the source of {name[:80]!r} must name row groups (got {source[:80]!r})") from None
    whole = data_set is None
    return Unit(name, pieces, span=None if whole else (None, None), data_set="" if whole else str(data_set))


def _groups(runs: Any) -> tuple[int, ...]:
    """The numbers in some runs, each with its first and its last; above those of the run before."""
    found: list[int] = []
    for first, last in runs:
        least = found[-1] + 1 if found else 0
        if not (isinstance(first, int) and isinstance(last, int) and least <= first <= last < MAX_GROUPS):
            raise ValueError("row groups must be ascending whole numbers")
        found += range(first, last + 1)
    return tuple(found)
