"""When the samples of a stream were taken: by the stamps of the board if it sends any, else by their arrival.

A board restarts and its counter with it, a counter wraps, a stamp is damaged on the wire: the time that
comes out never steps back, and after a pause it is the true time again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.sources.grammar.time_units import SECONDS_PER_UNIT
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.times.seconds import unit_by_magnitude

_LOOK = 0.2
"""Seconds of host time after which the unit of a stamp is judged, if the board does not name it."""
_SOON = 64
"""Rows after which it is judged anyway: a replay may come much faster than it was sampled."""
_TICK = 1e-6
"""Least step of host time, s."""
_COUNTERS = (2.0**16, 2.0**32)
_STEPS = 4096
"""Steps from which period and jitter are judged."""
_PAUSE = 0.5
"""Seconds without a line that are a pause and not a step, unless the lines come that slowly."""


@dataclass(frozen=True)
class ArrivedRow:
    """A row whose time is to be found."""

    host: float
    """Monotonic time of its arrival, s."""
    stamp: float
    """Stamp of the board as it was parsed; NaN where there is none."""
    values: tuple[float, ...]
    """The channels."""


class LiveTime:
    """Time of each row, from 0 at the first one."""

    def __init__(self, column: TimeColumn | None) -> None:
        """Begin with the first row; `column` describes the board's stamps, None where it sends none."""
        self._column = column
        self._scale = _scale_of(column)
        self._decided = column is None or self._scale is not None
        self._pending: list[ArrivedRow] = []
        self._time: float | None = None  # of the last row
        self._host = 0.0
        self._stamp = math.nan  # in s, of the last row whose stamp was accepted
        self._offset = 0.0  # time of a row is its stamp plus this
        self._doubted = False
        self._broken = 0.0
        self._steps = np.empty(_STEPS)
        self._count = 0

    @property
    def by_device(self) -> bool:
        """True where the board's own stamps are the time."""
        return self._scale is not None

    def interrupt(self, slept: float = 0.0) -> None:
        """Note an interruption; the `slept` s for which the machine slept are missing in monotonic time."""
        self._broken += max(slept, _TICK)

    def place(self, rows: Sequence[ArrivedRow]) -> tuple[list[float], list[tuple[float, ...]]]:
        """Times and values of the rows, with one row of NaN for each interruption.

        The first rows are kept until the unit of their stamps is known.
        """
        times: list[float] = []
        values: list[tuple[float, ...]] = []
        if not self._decided:
            self._pending += rows
            if not self._decide():
                return times, values
            rows, self._pending = self._pending, []
        for row in rows:
            last = self._time
            time = self._next(row)
            if self._broken and last is not None:
                times.append(last + min(self.period or (time - last) / 2, (time - last) / 2))
                values.append((math.nan,) * len(row.values))
            elif last is not None:
                self._steps[self._count % _STEPS] = time - last
                self._count += 1
            self._broken = 0.0
            times.append(time)
            values.append(row.values)
        return times, values

    @property
    def period(self) -> float | None:
        """Median step of the last 4096 in s; None before there is one that is not 0.

        Where the stamps are so coarse that the steps are only 0, 1 and 2 of their unit, and where lines are stamped
        as they arrive, in bursts, it is the mean step without pauses.
        """
        steps = self._steps[: min(self._count, _STEPS)]
        if not steps.size or not steps.any():
            return None
        if self._scale is None:
            return float(steps[steps <= max(_PAUSE, 20 * steps.mean())].mean())
        median = float(np.median(steps))
        if median > 10 * self._scale:
            return median or float(steps.mean())
        ordinary = steps[steps <= max(5 * median, 5 * self._scale)]
        return float(ordinary.mean()) or median or None

    @property
    def jitter(self) -> float | None:
        """Half the width that holds nine of ten steps, in s; None before there are ten."""
        steps = self._steps[: min(self._count, _STEPS)]
        if steps.size < 10:
            return None
        low, high = np.percentile(steps, (5, 95))
        return round(float(high - low) / 2, 9)  # less is only the rounding of the stamps

    def _decide(self) -> bool:
        """Find the unit of the stamps by the clock of the host, or find that they are not a time."""
        first, last = self._pending[0], self._pending[-1]
        host, stamp = last.host - first.host, last.stamp - first.stamp
        if len(self._pending) < 2 or (host < _LOOK and len(self._pending) < _SOON):
            return False
        self._decided = True
        if stamp > 0:
            self._scale = self._scale_by(host, np.array([row.stamp for row in self._pending]))
        return True

    def _scale_by(self, host: float, stamps: Array) -> float | None:
        """Seconds in one unit of stamps that came within `host` s; None if they are not a time."""
        units = [SECONDS_PER_UNIT[unit] for unit in ("s", "ms", "us", "ns")]
        stamp = stamps[-1] - stamps[0]
        return min(units, key=lambda scale: abs(math.log(stamp * scale / host))) if host > 0 else None

    def _untimed(self, waited: float) -> float:
        """Time from the last row to one without a stamp that came `waited` s after it."""
        return max(waited, _TICK)

    def _next(self, row: ArrivedRow) -> float:
        """Time of the next row."""
        if self._time is None:
            self._time, self._host = 0.0, row.host
            if self._scale is not None and math.isfinite(row.stamp):
                self._stamp = row.stamp * self._scale
                self._offset = -self._stamp
            return 0.0
        waited = max(row.host - self._host, 0.0) + (self._broken if self._broken > _TICK else 0.0)
        self._host = row.host
        time = self._by_stamp(row, waited) if self._scale is not None else self._time + self._untimed(waited)
        self._time = max(time, self._time)
        return self._time

    def _by_stamp(self, row: ArrivedRow, waited: float) -> float:
        """Time by the stamp where it can be trusted, else by the host's time since the last row."""
        last = self._time or 0.0
        if not math.isfinite(row.stamp):
            return last + waited
        stamp = row.stamp * (self._scale or 1.0)
        turn = self._turn(row.stamp, stamp - self._stamp, waited)
        step = stamp - self._stamp + turn
        # An interruption must last as long by both clocks, else the board has restarted.
        alike = not self._broken or abs(step - waited) <= 0.25 + 0.05 * waited
        if 0 <= step <= 30 * waited + 10 and alike:
            self._offset += turn
        elif self._broken or self._doubted:
            # From here on the stamps count from this row, whatever they were before.
            self._offset = last + max(waited, _TICK) - stamp
        else:
            self._doubted = True  # damaged, unless the next one agrees
            return last + waited
        self._stamp, self._doubted = stamp, False
        return stamp + self._offset

    def _clock_turn(self, step: float) -> float:
        """Seconds of a day, or of whatever period the clock of the stamps has, where it wrapped; else 0."""
        column = self._column
        is_clock = column is not None and column.kind == "clock" and step < -column.turn_s / 2
        return column.turn_s if column is not None and is_clock else 0.0

    def _turn(self, raw: float, step: float, waited: float) -> float:
        """Seconds of a full turn of the counter, where a step back is a wrap; else 0."""
        if not step < 0:
            return 0.0
        scale = self._scale or 1.0
        if self._column is not None and self._column.kind == "clock":
            return self._clock_turn(step)
        for size in _COUNTERS:
            turn = size * scale
            if self._stamp < turn and raw >= 0 and abs(step + turn - waited) <= 1.0 + 0.5 * waited:
                return turn
        return 0.0


class FileTime(LiveTime):
    """Time of each row of a file, whose lines may come much later, or faster, than they were written."""

    def __init__(self, column: TimeColumn | None, period: float) -> None:
        """Begin with the first row; `period` is the time from row to row where the file has none, s."""
        super().__init__(column)
        self._file_period = period

    def _scale_by(self, host: float, stamps: Array) -> float:
        del host
        return SECONDS_PER_UNIT[unit_by_magnitude(stamps[np.isfinite(stamps)])]

    def _untimed(self, waited: float) -> float:
        del waited
        return self._file_period

    def _by_stamp(self, row: ArrivedRow, waited: float) -> float:
        """Time by the stamp; a step back is the beginning of another record, which follows at once."""
        del waited
        last, stamp = self._time or 0.0, row.stamp * (self._scale or 1.0)
        if not math.isfinite(stamp):
            return last
        turn = self._clock_turn(stamp - self._stamp)
        if stamp + turn < self._stamp:
            self._offset = last + (self.period or _TICK) - stamp
        self._offset += turn
        self._stamp = stamp
        return stamp + self._offset


def _scale_of(column: TimeColumn | None) -> float | None:
    """Seconds in one unit of the stamps as they are parsed; None if the board does not name it."""
    if column is None:
        return None
    if column.kind != "number":
        return 1e-6  # calendar stamps and clocks are parsed to µs
    return SECONDS_PER_UNIT[column.unit] if column.unit else None
