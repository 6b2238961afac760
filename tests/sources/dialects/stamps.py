"""Time columns in every common form: the cells, and the seconds that they mean."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from random import Random

import numpy as np

MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
DAYS = ["Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"]


Columns = tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]
"""(names, cells) of time columns."""


@dataclass(frozen=True)
class Stamps:
    """The time columns of one log."""

    shape: str
    """"even", "jitter", "pause", "burst" or "coarse"."""
    names: tuple[str, ...]
    """Names of the columns."""
    cells: tuple[tuple[str, ...], ...]
    """One row of cells a sample."""
    seconds: np.ndarray
    """s from the first sample, as the stamps say."""
    period: float
    """s between samples, pauses left aside."""

    @property
    def only_rate(self) -> bool:
        """Whether the stamps are too coarse to place a sample."""
        return self.shape in ("burst", "coarse")


FORMS = {
    "seconds": 1000, "millis": 1000, "micros": 1, "epoch s": 1000, "epoch ms": 1000, "epoch us": 1, "iso": 1000,
    "iso whole": 1_000_000, "day first": 1_000_000, "month first": 1_000_000, "am pm": 1_000_000,
    "month name": 1000, "ctime": 1_000_000, "compact": 1_000_000, "clock": 1000, "two columns": 1_000_000,
    "six columns": 1_000_000, "minutes": 1000,
}  # fmt: skip
WITHOUT_BLANKS = {"seconds", "millis", "micros", "epoch s", "epoch ms", "epoch us"}
WITHOUT_BLANKS |= {"clock", "two columns", "compact", "six columns"}
WITHOUT_NAME = set(FORMS) - {"millis", "micros", "six columns", "minutes"}
"""What a human knows as a time without a name above it."""
MIN_COARSE_ROWS = 70
WHOLE = {form for form, resolution in FORMS.items() if resolution == 1_000_000}


def make_stamps(rng: Random, n: int, delimiter: str, decimal: str, *, named: bool) -> Stamps:
    """Time columns of n samples that suit a table with this delimiter."""
    forms = set(FORMS) if named else WITHOUT_NAME
    form = rng.choice(sorted(forms & WITHOUT_BLANKS if delimiter == " " else forms))
    resolution = FORMS[form]
    shapes = ["even"] * 4 + ["jitter", "pause"]
    # A clock of whole seconds needs many of them to say its rate; numbers that repeat need a name to be a time.
    if n >= MIN_COARSE_ROWS and (named or form != "seconds"):
        shapes.append("coarse" if form in WHOLE else "burst")
    shape = rng.choice(shapes)
    micros, period = sample_times(rng, n, resolution, shape, daily=form != "minutes")
    start = datetime(rng.randint(2015, 2025), rng.randint(1, 12), rng.randint(13, 27), rng.randint(0, 20), 3, 7)
    if form == "minutes":
        start = start.replace(minute=0)
    names, cells = written(rng, form, start, micros, decimal, delimiter)
    return Stamps(shape, names, cells, (micros - micros[0]) / 1e6, period)


def sample_times(rng: Random, n: int, resolution: int, shape: str, *, daily: bool) -> tuple[np.ndarray, float]:
    """(µs of each stamp, nominal period in s)."""
    if shape == "coarse":
        rate = rng.uniform(2.5, max(3.0, n / 25))
        return (np.arange(n) / rate).astype(np.int64) * 1_000_000, 1 / rate
    is_whole = resolution == 1_000_000
    steps = (4, 5, 10, 20, 40, 50, 100) if not is_whole else (1, 2, 5, 10, 30, 60, 300, 600) if daily else (1,)
    step = rng.choice(steps) * (1_000_000 if is_whole else 1000)
    micros = np.arange(n) * step
    if shape == "burst":
        size = rng.randint(3, 8)
        return micros // (size * step) * (size * step), step / 1e6
    if shape == "jitter" and resolution < 1_000_000:
        noise = np.array([rng.uniform(-0.1, 0.1) * step for _ in range(n)])
        micros = np.sort(((micros + noise) // resolution * resolution).astype(np.int64))
    if shape == "pause":
        micros = micros + (np.arange(n) >= rng.randint(n // 3, 2 * n // 3)) * step * rng.randint(20, 90)
    return micros - micros[0], step / 1e6


def written(rng: Random, form: str, start: datetime, micros: np.ndarray, decimal: str, delimiter: str) -> Columns:
    """(names, cells) of a form."""
    when = [start + timedelta(microseconds=int(at)) for at in micros]
    if form in _NUMBERS:
        return _numbers(rng, form, start, micros, decimal, delimiter)
    if form == "two columns":
        date = rng.choice(["%Y-%m-%d", "%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y"])
        names = rng.choice([("Date", "Time"), ("date", "time"), ("DATE", "CLOCK")])
        return names, tuple((at.strftime(date), at.strftime("%H:%M:%S")) for at in when)
    if form == "six columns":
        names = ("Year", "Month", "Day", "Hour", "Minute", "Second")
        return names, tuple(tuple(map(str, at.timetuple()[:6])) for at in when)
    name = rng.choice(["Time", "timestamp", "Timestamp", "datetime", "Date/Time", "time"])
    return (name,), tuple((text,) for text in _texts(rng, form, when))


def _texts(rng: Random, form: str, when: list[datetime]) -> list[str]:
    if form == "iso":
        between, zone = rng.choice("T "), rng.choice(["", "", "Z", "+02:00", " UTC"])
        return [at.isoformat(between, "milliseconds") + zone for at in when]
    if form == "month name":
        pattern = rng.choice(["%d-{}-%Y %H:%M:%S", "%d.{}.%Y %H:%M:%S", "%d {} %Y %H:%M:%S"])
        return [at.strftime(pattern.format(MONTHS[at.month - 1])) + f".{at.microsecond // 1000:03}" for at in when]
    if form == "ctime":
        zone = rng.choice(["", " GMT+08:00", " UTC"])
        return [f"{DAYS[at.weekday()]} {MONTHS[at.month - 1]} {at:%d %H:%M:%S}{zone} {at:%Y}" for at in when]
    if form in ("minutes", "clock"):
        return [f"{at:{'%M:%S' if form == 'minutes' else '%H:%M:%S'}}.{at.microsecond // 1000:03}" for at in when]
    pattern = rng.choice(_PATTERNS[form])
    return [at.strftime(pattern) for at in when]


_PATTERNS = {
    "iso whole": ("%Y-%m-%d %H:%M:%S", "%Y-%m-%dT%H:%M:%SZ", "%Y/%m/%d %H:%M:%S"),
    "day first": ("%d.%m.%Y %H:%M:%S", "%d/%m/%Y %H:%M:%S", "%d-%m-%Y %H:%M:%S"),
    "month first": ("%m/%d/%Y %H:%M:%S",),
    "am pm": ("%m/%d/%Y %I:%M:%S %p", "%d.%m.%Y %I:%M:%S %p"),
    "compact": ("%Y%m%d_%H%M%S",),
}
_NUMBERS = {  # µs in one unit, names
    "seconds": (1e6, ("t", "time", "Time (s)", "time [s]", "t_s", "seconds", "elapsed [s]")),
    "millis": (1e3, ("millis", "time_ms", "t [ms]", "Time (ms)", "timestamp_ms")),
    "micros": (1, ("micros", "time_us", "t [us]", "Time (µs)")),
    "epoch s": (1e6, ("timestamp", "time", "epoch", "unix_time")),
    "epoch ms": (1e3, ("timestamp", "time", "epoch_ms", "Timestamp")),
    "epoch us": (1, ("timestamp", "time", "epoch")),
}


def _numbers(rng: Random, form: str, start: datetime, micros: np.ndarray, decimal: str, delimiter: str) -> Columns:
    unit, names = _NUMBERS[form]
    epoch = (start - datetime(1970, 1, 1)) // timedelta(microseconds=1) if form.startswith("epoch") else 0
    counts = [int(at) + epoch for at in micros]
    if unit == 1e6:
        cells = [f"{count // 1_000_000}{decimal}{count % 1_000_000 // 1000:03}" for count in counts]
    else:
        cells = [str(count // int(unit)) for count in counts]
    names = tuple(name for name in names if delimiter != " " or " " not in name)
    return (rng.choice(names),), tuple((cell,) for cell in cells)
