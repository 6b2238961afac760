"""Recording: the one value that every source produces, and the account of how it was read."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from html import escape
from typing import Any, Literal

import numpy as np

from kalscope.common.numbers import Array
from kalscope.errors import BadSetting

Gaps = Literal["rows", "missing", "dt"]
"""What a gap in time is to the filter: nothing, rows of missing samples, or elapsed time."""


Stamps = Literal["even", "uneven", "bursts", "coarse", "none"]
"""How the stamps of a recording are spaced: a step per sample, or several samples a step; "none" without stamps."""

RateSource = Literal["stamps", "file", "option", "none"]
"""Where a sample period comes from: the stamps, the text of the file, the user; "none" where it is unknown."""

MAX_ISSUES = 100
"""Rejected lines and bad cells that a report keeps word for word; all are counted."""

MAX_ISSUE_LENGTH = 200
"""Characters of each that are kept."""


@dataclass(frozen=True)
class Timing:
    """How the sample period was found and how sure it is."""

    stamps: Stamps
    """Even; uneven (jitter); in bursts (a buffer); of a clock coarser than the sample period; or none."""
    source: RateSource
    """Where `period` comes from."""
    period: float | None
    """Sample period in s, `Recording.sample_period`; None where it is unknown."""
    error: float | None = 0.0
    """Standard error of `stamps_period` as a share of it; 0 where the stamps are even, None where it is unknown."""
    stamps_period: float | None = None
    """The period in s by the stamps alone; None where they give none."""
    pauses: int = 0
    """Steps at which samples are missing: gaps in time."""
    summary: str = ""
    """The rate in a few words: "13.4 Hz from uneven stamps, standard error 0.20 %"; "" where it is unknown."""


class Assumption(str):
    """A note about something that the file does not show: it is shown at once, because it may be wrong."""

    __slots__ = ()


@dataclass(frozen=True)
class LineIssue:
    """One line, or one cell of a line, that could not be read as it is."""

    line: int
    """Line number in the decoded text, counted from 1."""
    reason: str
    """What must hold and what was found, in a few words."""
    text: str
    """The offending line or cell, cut at MAX_ISSUE_LENGTH characters."""
    column: str | None = None
    """Name of the column for a single cell; None where the whole line was rejected."""


@dataclass(frozen=True)
class ReadReport:
    """How a file was read: rows + rejected + blank + comments + headers = lines, always."""

    lines: int = 0
    """Lines in the file, a torn last one included."""
    rows: int = 0
    """Lines that became one row of `Recording.values`; several lines may make up one row."""
    rejected: int = 0
    """Lines of the wrong shape, left out."""
    blank: int = 0
    """Lines with nothing on them."""
    comments: int = 0
    """Comment lines, boot text above the header and prose between labelled lines included."""
    headers: int = 0
    """Header and unit lines, repeated ones included."""
    bad_cells: int = 0
    """Cells that are not numbers in lines that were kept: missing samples; and tokens that belong to no column."""
    clipped_times: int = 0
    """Time stamps that step backward; the step counts as 0 (dt = 0)."""
    inserted: int = 0
    """Rows of missing samples inserted into gaps in time; 0 unless requested."""
    issues: tuple[LineIssue, ...] = ()
    """The first MAX_ISSUES rejected lines and bad cells, in file order."""
    notes: tuple[str, ...] = ()
    """What the reader decided, each a sentence: delimiter, header, time column, renamed columns."""
    timing: Timing | None = None
    """How the sample period was found; None for synthetic signals and for a board."""
    options: tuple[str, ...] = ()
    """What the user decided about the reading, as words of the command line: ("--delimiter", "comma")."""
    read_as: str = ""
    """What was taken for what, in one sentence: rows and span, the time, the channels, the columns left out."""
    assumptions: tuple[str, ...] = ()
    """Those of the notes that the file does not show: any of them may be wrong."""


@dataclass(frozen=True, repr=False)
class Recording:
    """A recording of one or more channels, sampled together. Immutable."""

    time: Array
    """Time of each sample in s, shape (n,), as the source counts it (row numbers where it has no time)."""
    names: tuple[str, ...]
    """Channel names, distinct, as the source names them."""
    units: tuple[str, ...]
    """Unit of each channel, "" where unknown."""
    values: Array
    """Samples, shape (n, channels); NaN is a missing sample, never inf."""
    sample_period: float | None
    """Nominal sample period in s, see `ReadReport.timing`; None where the source has no time."""
    report: ReadReport = field(default_factory=ReadReport)
    """How the source was read; empty for synthetic signals."""
    truth: Array | None = None
    """The noise-free signal, shape (n, channels), where it is known."""
    source: str = ""
    """What reopens it: a path, "sample:NAME", "synthetic:SHAPE?…"."""
    title: str = ""
    """Name to display."""
    sha256: str = ""
    """SHA-256 of the bytes it was read from; "" where there are none."""
    gaps: Gaps = "rows"
    """How its gaps in time are to be filtered; "dt" asks for dt = `steps()`, the others for dt = None."""

    @classmethod
    def of_samples(cls, samples: Any) -> Recording:
        """A recording of samples, shape (n,) or (n, channels); of a Series or DataFrame with names and index.

        An index of time stamps or time differences is the time, from 0; other samples are numbered.
        """
        values = np.asarray(samples, dtype=float)
        if values.ndim not in (1, 2):
            raise BadSetting(f"z must have shape (n,) or (n, channels) (got {values.shape})")
        names = getattr(samples, "columns", [getattr(samples, "name", None)])
        names = (
            list(names) if len(names) == (values.shape[1] if values.ndim == 2 else 1) else [None] * values.shape[1]
        )
        index = np.asarray(samples.index) if hasattr(samples, "iloc") else np.arange(len(values))
        time, period = np.arange(len(values), dtype=float), None
        if index.dtype.kind in "mM" and len(index):
            second = np.timedelta64(1, "s")
            time = (index - index[0]) / second
            period = float(np.median(np.diff(index) / second)) if len(index) > 1 else None
        return cls(
            time,
            tuple(f"channel {i}" if name is None else str(name) for i, name in enumerate(names, 1)),
            ("",) * len(names),
            values.reshape(len(values), -1),
            period or None,
        )

    @classmethod
    def from_frame(cls, frame: Any, sample_period: float | None = None) -> Recording:
        """A recording of the columns of a DataFrame; an index of time stamps is the time.

        Args:
            frame: numbers; NaN is a missing sample.
            sample_period: nominal sample period in s; None = that of the index.
        """
        made = cls.of_samples(frame)
        return made if sample_period is None else replace(made, sample_period=sample_period)

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, name: str) -> Array:
        return self.channel(name)

    def __repr__(self) -> str:
        names = ", ".join(self.names[:8]) + (f" and {len(self.names) - 8} more" if len(self.names) > 8 else "")
        every = "" if self.sample_period is None else f" every {self.sample_period:.4g} s"
        return f"<Recording {self.title or self.source}: {len(self)} samples{every} of {names}>".replace(" :", ":")

    def _repr_html_(self) -> str:
        return f"<p><b>{escape(repr(self)[1:-1])}</b></p><p>{escape(self.report.read_as)}</p>"

    def index(self, name: str) -> int:
        """Column of the channel `name`; BadSetting names the choices."""
        try:
            return self.names.index(name)
        except ValueError:
            choices = ", ".join(self.names)
            raise BadSetting(f"channel must be one of {choices} (got {name!r})") from None

    def channel(self, name: str) -> Array:
        """Samples of one channel, shape (n,)."""
        return self.values[:, self.index(name)]

    def steps(self) -> Array:
        """Time before each sample in nominal sample periods, shape (n,): the filter's `dt`.

        The first is 1; a step back in time is 0. BadSetting where the recording has no time.
        """
        if self.sample_period is None:
            raise BadSetting("dt needs a recording with time or a sample period (got neither)")
        steps = np.diff(self.time) / self.sample_period
        return np.concatenate(([1.0], np.maximum(steps, 0.0)))[: len(self)]
