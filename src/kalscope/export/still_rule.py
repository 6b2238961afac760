"""The noise variance r as a sketch exported with calibration measures it: sample by sample, in float32.

It is the rule of `noise_from_still` for a board that cannot keep the samples: the variance about a straight line,
at least Δ²/12, spikes left out, and the tests of `find_still_stretch` that only noise shows. The median distance by
which a spike is known comes from the first readings and is then corrected at each reading, by ever less: so the
board's figure is that of the host on the same samples within 1 %, not to the last bit. `measure_on_board` gives the
bits that a board prints: one rounding an operation, in the order of `KalscopeCalibration.h`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from kalscope.estimation.noise import SPIKE
from kalscope.estimation.still import MAX_DRIFT, MIN_SAMPLES, SURE
from kalscope.export.float32 import float32_text

LEARNING = 16
"""Readings that only show the level and the spread of the others; so does the first group after them."""
GROUPS = 8
"""Groups of equally many samples that are measured, and whose means and variances are compared."""
MIN_EACH, MAX_EACH = 8, 8000
"""Samples of a group."""
MIN_READINGS = MIN_SAMPLES
"""Readings that must be left at the end."""
MIN_CHANGES = 16
"""Changes of the reading that an unknown step must show, where the noise is smaller than the step."""
MAX_MISSING, MAX_SPIKES, MAX_AT_END = 10, 20, 100
"""One sample in this many may be missing, a spike, at an end of the range; more are refused."""
DEPENDENT, UNEVEN, WANDER = 0.1, 0.4, 100
"""What is allowed for any number of samples: a correlation of neighbours, a range of the groups' variances over r,
one part in this many of r in the means of the groups."""

F = np.float32
WANDER_SURE = F(GROUPS - 2 + SURE * math.sqrt(2.0 * (GROUPS - 2)) + 3.0)
"""As in `find_still_stretch`: squared distance of the means from their line, over what chance makes it."""
UNEVEN_SURE = F(GROUPS * (2.0 * SURE) ** 2)
"""Squared range of the variances, as there: times (2 + excess) / n, the variance of a variance of n samples."""
_SLOPE_WEIGHT = F(GROUPS * (GROUPS**2 - 1) / 12)
_NORMAL, _CORRECTION, _EARLY, _FOLLOW = F(1.4826), F(1.2), F(64), F(0.0625)
"""Standard deviation over median distance; the n-th reading corrects that distance by 1.2/n of itself, the step
that forgets the start soonest; a spike is farther by 64/n at first, while the distance is uncertain; the centre
follows by a sixteenth."""


@dataclass(frozen=True)
class BoardNoise:
    """What a board found; each float is a float32 value."""

    r: np.float32
    """Measurement-noise variance, unit²: `variance`, but at least step²/12."""
    variance: np.float32
    """Variance about the straight line, unit²."""
    step: np.float32
    """Resolution of the readings, unit; 0 where none was seen."""
    used: int
    """Readings used."""
    spikes: int
    """Readings left out."""
    missing: int
    """Samples without a reading."""


@dataclass(frozen=True)
class BoardRange:
    """What the sketch knows of its readings beforehand: READING_STEP, LOWEST_READING, HIGHEST_READING."""

    step: float = 0.0
    """Resolution, unit; 0 = not known."""
    lowest: float = -np.inf
    """Smallest reading, unit."""
    highest: float = np.inf
    """Largest reading, unit."""


def rows_of(seconds: float, period: float) -> int:
    """Rows that a calibration of `seconds` takes, period in s."""
    return LEARNING + (GROUPS + 1) * ((round(seconds / period) - LEARNING) // (GROUPS + 1))


def measure_on_board(z: ArrayLike, known: BoardRange | None = None) -> BoardNoise | str:
    """The answer of the board to these rows: what it found, or the reason why it keeps its old values.

    Args:
        z: The rows from the one after the command on, shape (n,), n as `rows_of` gives it; NaN is a missing sample.
        known: What the sketch knows of the readings.
    """
    samples = np.asarray(z, dtype=np.float32)
    one = _Measurement(known or BoardRange(), (len(samples) - LEARNING) // (GROUPS + 1))
    with np.errstate(all="ignore"):
        for value in samples:
            if (said := one.take(value)) is not None:
                return said
    return "unfinished"


@dataclass
class _Measurement:
    """`KalscopeCalibration` of the exported code, statement by statement."""

    known: BoardRange
    """What the sketch knows of the readings."""
    each: int
    """Samples of a group."""
    first: list[np.float32] = field(default_factory=list[np.float32])
    """The first readings, sorted."""
    means: list[np.float32] = field(default_factory=list[np.float32])
    """Mean of each group, from `level`, unit."""
    variances: list[np.float32] = field(default_factory=list[np.float32])
    """Variance of each group, unit²."""
    sums: list[np.float32] = field(default_factory=lambda: [F(0)] * 5)
    """Sums of t, t², e, t e and e² in this group; e is the distance from `level`, t the time in groups."""
    total: list[np.float32] = field(default_factory=lambda: [F(0)] * 5)
    """The same of all groups before it."""
    level = centre = spread = step = jumps = F(0)
    before = F(np.nan)
    judged = place = group = counted = used = pairs = spikes = missing = cut_off = changes = 0

    def take(self, z: np.float32) -> BoardNoise | str | None:
        """Take one sample; returns the answer at the end, else None."""
        came = bool(np.isfinite(z))
        measured = GROUPS * self.each
        if not came:
            self.before = F(np.nan)
            self.missing += 1
            if self.missing > measured // MAX_MISSING:
                return f"no reading in {self.missing} of {measured} samples"
        if len(self.first) < LEARNING:
            if came:
                self._learn(z)
            return None
        if came:
            self._judge(z)
        if self.spikes > measured // MAX_SPIKES:
            return f"spikes in {self.spikes} of {measured} samples"
        self.place += 1
        if self.place < self.each:
            return None
        self.place = 0
        return self._end_group()

    def _learn(self, z: np.float32) -> None:
        self.first = sorted([*self.first, z])
        if len(self.first) < LEARNING:
            return
        self.step = F(self.known.step)
        self.level = self.centre = _middle(self.first)
        for low, high in pairwise(self.first):
            self._saw_step(high - low)
        self.spread = _middle(sorted(abs(one - self.level) for one in self.first))

    def _saw_step(self, distance: np.float32) -> None:
        if distance != 0 and (self.step == 0 or abs(distance) < self.step):
            self.step = abs(distance)

    def _judge(self, z: np.float32) -> None:
        off = z - self.centre
        away = abs(off)
        if self.step == 0:
            self.step = away
        self.spread = max(self.spread, F(0.25) * self.step)
        self.judged += 1
        share = F(1) / F(LEARNING + self.judged)
        limit = (F(SPIKE) + _EARLY * share) * max(_NORMAL * self.spread, self.step)
        change = self.spread * (_CORRECTION * share)
        self.spread = self.spread + change if away > self.spread else self.spread - change
        if away > limit:
            self.before = F(np.nan)
            self.spikes += 1
            return
        self.centre = self.centre + _FOLLOW * off
        if not np.isnan(self.before):
            jump = z - self.before
            self._saw_step(jump)
            self.changes += bool(jump != 0)
            self.jumps = self.jumps + jump * jump
            self.pairs += 1
        self.before = z
        self.cut_off += bool(z <= F(self.known.lowest) or z >= F(self.known.highest))
        e, t = z - self.level, (F(self.place) + F(0.5)) / F(self.each) + F(self.group - (GROUPS // 2 + 1))
        self.sums = [old + new for old, new in zip(self.sums, (t, t * t, e, t * e, e * e), strict=True)]
        self.counted += 1

    def _end_group(self) -> BoardNoise | str | None:
        if self.group == 0:  # it has only shown how far the readings spread
            self.spikes = self.missing = self.cut_off = self.pairs = self.changes = 0
            self.jumps = F(0)
        elif self.counted < 2:
            return "too few readings"
        else:
            n, (_, _, e, _, ee) = F(self.counted), self.sums
            self.means.append(e / n)
            self.variances.append((ee - e * e / n) / (n - F(1)))
            self.total = [old + new for old, new in zip(self.total, self.sums, strict=True)]
            self.used += self.counted
        self.sums, self.counted = [F(0)] * 5, 0
        self.group += 1
        return self._finish() if self.group > GROUPS else None

    def _finish(self) -> BoardNoise | str:
        n, (t, tt, e, te, ee) = F(self.used), self.total
        mean_t, mean_e = t / n, e / n
        tt, te, ee = tt - t * mean_t, te - t * mean_e, ee - e * mean_e
        variance = (ee - te / tt * te) / (n - F(2))
        floor = self.step * self.step / F(12)
        r = variance if variance > floor else floor
        rounding = variance <= floor and self.known.step == 0
        reasons = (
            (self.used < MIN_READINGS, "too few readings"),
            (
                self.cut_off > self.used // MAX_AT_END,
                f"{self.cut_off} of {self.used} readings at an end of the range",
            ),
            (not np.isfinite(r) or np.isnan(variance), "float32 cannot hold r and q"),
            (r == 0 or (rounding and self.changes < MIN_CHANGES), "nearly all readings are equal"),
            (self._is_moving(n, r), "the level moves"),
            (variance > floor and self._is_uneven(n, variance), "the noise is uneven"),
            (variance > floor and self._is_dependent(n, variance), "neighbouring readings depend on each other"),
        )
        found = BoardNoise(r, variance, self.step, self.used, self.spikes, self.missing)
        return next((words for is_so, words in reasons if is_so), found)

    def _is_moving(self, n: np.float32, r: np.float32) -> bool:
        places = [F(i) - F(0.5) * F(GROUPS - 1) for i in range(GROUPS)]
        mean = slope = squared = F(0)
        for place, one in zip(places, self.means, strict=True):
            mean, slope = mean + one, slope + place * one
        mean, slope = mean / F(GROUPS), slope / _SLOPE_WEIGHT
        for place, one in zip(places, self.means, strict=True):
            off = one - mean - slope * place
            squared = squared + off * off
        if squared * n / F(GROUPS) / r > max(WANDER_SURE, n / F(WANDER)):
            return True
        return bool(slope * slope * F(GROUPS**2) > F(MAX_DRIFT**2) * r)

    def _is_uneven(self, n: np.float32, variance: np.float32) -> bool:
        apart = (max(self.variances) - min(self.variances)) / variance
        return bool(apart * apart > max(F(UNEVEN**2), UNEVEN_SURE * (F(2) + self.step * self.step / variance) / n))

    def _is_dependent(self, n: np.float32, variance: np.float32) -> bool:
        off = self.jumps / F(self.pairs) / (F(2) * variance) - F(1)
        return bool(off * off > max(F(DEPENDENT**2), F(SURE**2) / n))


def _middle(rising: list[np.float32]) -> np.float32:
    return F(0.5) * (rising[LEARNING // 2 - 1] + rising[LEARNING // 2])


def template_texts() -> dict[str, str]:
    """The constants of the rule as the exported code writes them."""
    counts = {
        "learning": LEARNING,
        "groups": GROUPS,
        "min_each": MIN_EACH,
        "max_each": MAX_EACH,
        "min_readings": MIN_READINGS,
        "min_changes": MIN_CHANGES,
        "most_missing": MAX_MISSING,
        "most_spikes": MAX_SPIKES,
        "most_cut_off": MAX_AT_END,
    }
    sizes = {
        "normal": _NORMAL,
        "spike": F(SPIKE),
        "early": _EARLY,
        "correction": _CORRECTION,
        "follow": _FOLLOW,
        "slope_weight": _SLOPE_WEIGHT,
        "wander_sure": WANDER_SURE,
        "wander": F(WANDER),
        "drift_squared": F(MAX_DRIFT**2),
        "uneven_squared": F(UNEVEN**2),
        "uneven_sure": UNEVEN_SURE,
        "dependent_squared": F(DEPENDENT**2),
        "sure_squared": F(SURE**2),
    }
    return {name: str(n) for name, n in counts.items()} | {name: float32_text(x) for name, x in sizes.items()}
