"""Which samples of a long record are drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from tsdownsample import MinMaxLTTBDownsampler

from kalscope.common.array import Array
from kalscope.recording import Recording
from kalscope_app.engine.record_facts import Facts, facts_of

MAX_POINTS = 4000
"""Points that a line is drawn with, at most."""


DENSE = 2000
"""Samples in the window from which a raw line is drawn as a band: about two to each pixel of a wide chart."""

REACH = 2
"""Drawn points to each side whose lowest and highest value the band holds: about one pixel."""


@dataclass(frozen=True)
class DrawnSamples:
    """Which samples of a recording are drawn; chosen on the raw signal, so that tuning changes only y."""

    first: int
    """Index of the first sample in the window."""
    last: int
    """One past the last sample in the window."""
    indices: NDArray[np.intp]
    """Samples drawn, ascending, shape (m,)."""
    time: Array
    """Their times, s, never descending, shape (m,)."""
    raw: Array
    """Their measurements, unit; NaN where missing, shape (m,)."""
    truth: Array | None
    """The noise-free signal there, where it is known, shape (m,)."""
    missing: int
    """Missing samples of the channel, drawn or not."""
    time_range: tuple[float, float]
    """First and last time of the recording, s."""
    band: tuple[Array, Array] | None = None
    """Lowest and highest measurement about each time, unit, two of shape (m,); None where a line is readable."""

    @property
    def decimated(self) -> bool:
        """Whether some samples of the window are not drawn."""
        return len(self.indices) < self.last - self.first


def choose_samples(
    recording: Recording,
    channel: str,
    window: tuple[float, float] | None,
    limit: int = MAX_POINTS,
    facts: Facts | None = None,
    others: tuple[str, ...] = (),
) -> DrawnSamples:
    """The samples to draw of one channel in a window (s, both ends inside); at least two if there are two.

    Args:
        recording: what is open.
        channel: the channel to draw.
        window: first and last time, s; None = all of it.
        limit: most points a line may have.
        facts: what is already known about the recording and the channel; None = read all samples.
        others: channels that are drawn at the same samples, as lines: then nothing is drawn as a band.
    """
    n = len(recording)
    facts = facts or facts_of(recording, channel)
    clock = facts.clock(recording)
    first, last = 0, n
    if window is not None:
        first = max(0, min(int(np.searchsorted(clock, window[0], side="left")), n - 2))
        last = min(n, max(int(np.searchsorted(clock, window[1], side="right")), first + 2))
    column = recording.index(channel)
    z = recording.values[:, column]
    truth = None if recording.truth is None else recording.truth[:, column]
    if others:
        at = first + choose_together(
            recording.values[first:last, list(map(recording.index, (channel, *others)))], limit
        )
    else:
        at = first + choose_indices(z[first:last], None if truth is None else truth[first:last], limit)
    dense = last - first > DENSE and not facts.missing and not others
    return DrawnSamples(
        first=first,
        last=last,
        indices=at,
        time=clock[at],
        raw=z[at],
        truth=None if truth is None else truth[at],
        missing=0 if others else facts.missing,
        time_range=(float(clock[0]), float(clock[-1])),
        band=band_around(z[first:last], at - first) if dense else None,
    )


def band_around(z: Array, at: NDArray[np.intp]) -> tuple[Array, Array]:
    """Lowest and highest value of z, shape (n,), about each of the samples `at`, ascending, shape (m,); no NaN."""
    ends = np.zeros(REACH, dtype=np.intp), np.full(REACH, len(at) - 1)
    near = np.concatenate((ends[0], np.arange(len(at)), ends[1]))
    starts = np.concatenate(([0], at[1:]))  # each sample belongs to the last drawn one, leading ones to the first
    low, high = (
        np.lib.stride_tricks.sliding_window_view(extreme.reduceat(z, starts)[near], 2 * REACH + 1)
        for extreme in (np.minimum, np.maximum)
    )
    return low.min(axis=1), high.max(axis=1)


def choose_indices(z: Array, truth: Array | None = None, limit: int = MAX_POINTS) -> NDArray[np.intp]:
    """Ascending indices of at most `limit` samples that preserve the shape of z, (n,), and of the truth."""
    n = len(z)
    if n <= limit:
        return np.arange(n, dtype=np.intp)
    if truth is None:
        return _downsample(z, limit)
    share = limit // 4
    return np.union1d(_downsample(z, limit - share), _downsample(truth, share)).astype(np.intp)


def choose_together(values: Array, limit: int) -> NDArray[np.intp]:
    """Ascending indices of at most `limit` rows that keep the shape of each column of `values`, (n, channels)."""
    n, channels = values.shape
    if n <= limit:
        return np.arange(n, dtype=np.intp)
    chosen = [_downsample(column, limit // channels) for column in values.T]
    return np.unique(np.concatenate(chosen)).astype(np.intp)


def _downsample(y: Array, points: int) -> NDArray[np.intp]:
    """MinMaxLTTB; missing samples are held at their last value for the choice."""
    if np.isnan(y).any():
        known = np.where(np.isnan(y), 0, np.arange(len(y)))
        y = np.nan_to_num(y[np.maximum.accumulate(known)])
    downsampler = cast("Any", MinMaxLTTBDownsampler())  # its stubs leave the types of the arguments open
    chosen: NDArray[np.uint64] = downsampler.downsample(np.ascontiguousarray(y), n_out=points)
    return np.unique(chosen).astype(np.intp)
