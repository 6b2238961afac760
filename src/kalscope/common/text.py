"""How numbers, units, durations, counts, lags and decibels are written."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from kalscope.errors import BadSetting

# How numbers, units, durations, counts, lags and decibels are written: on screen, in the console and in reports.
#
# Values have three significant digits unless the caller asks for others, thousands are separated by a narrow
# no-break space, and a minus is "−"; nothing is ever written as "−0". Files that programs read (tuning files,
# exports, CSV, JSON) do not use this: they need every digit and plain ASCII.


THIN_SPACE = "\u202f"
"""Narrow no-break space."""

TIME_UNITS = (("ms", 1e-3), ("s", 1.0), ("min", 60.0), ("h", 3600.0), ("days", 86400.0), ("years", 31557600.0))
"""Units of a time axis and their length in s."""

DURATIONS = (("µs", 1e-6), *TIME_UNITS)
"""Units of a duration and their length in s."""

SHORTEST, LONGEST = 1e-9, 1000 * DURATIONS[-1][1]
"""Durations, s, that are written as a number: no filter of a sensor has others."""

MIN_NUMBER = 5e-324
"""The smallest number above 0 that a computer holds."""

CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""What moves the cursor, changes colours or turns the direction of a terminal, except tabs and line ends."""

FREQUENCIES = (("Hz", 1.0), ("kHz", 1e3), ("MHz", 1e6))
"""Units of a frequency in Hz."""


def number(value: float, digits: int = 3) -> str:
    """A number to `digits` significant digits: 0.0951, 15 100, 1.20e-9; "∞" and "none" for inf and NaN."""
    if math.isnan(value):
        return "none"
    sign = "−" if value < 0.0 else ""
    if math.isinf(value):
        return f"{sign}∞"
    if value == 0.0:
        return "0"
    rounded = f"{abs(value):.{digits - 1}e}"
    mantissa, exponent = rounded.split("e")
    power = int(exponent)
    if not -4 <= power < 6:
        return f"{sign}{mantissa}e{power}"
    return sign + f"{float(rounded):,.{max(0, digits - 1 - power)}f}".replace(",", THIN_SPACE)


def trimmed(value: float, digits: int = 3) -> str:
    """The same without trailing zeros after the decimal point: 2, 1.5, 1e-9."""
    return re.sub(r"(\.\d*?)0+(?=e|$)", r"\1", number(value, digits)).replace(".e", "e").rstrip(".")


def count(n: int) -> str:
    """A whole number in groups of three digits: 1 000 000."""
    return f"{n:,}".replace(",", THIN_SPACE).replace("-", "−")


def plural(n: float, noun: str) -> str:
    """A number with its noun: 1 sample, 4.1 samples."""
    written = trimmed(n)
    return f"{written} {noun}{'' if written == '1' else 's'}"


def percent(share: float, digits: int = 2) -> str:
    """A share of 1 in percent: 12 %, 0.42 %."""
    return f"{number(100.0 * share, digits)} %"


def correlation(value: float) -> str:
    """A correlation to three decimals: 0.123, −0.045."""
    return f"{round(value, 3) + 0.0:.3f}".replace("-", "−")


def p_value(p: float) -> str:
    """The p-value of a test, without a line break inside."""
    return "p\u00a0<\u00a01e\u20116" if p < 1e-6 else f"p\u00a0=\u00a0{number(p, 2)}"


def _in_unit(value: float, units: Sequence[tuple[str, float]]) -> tuple[float, str]:
    """The value in its unit, chosen after rounding to three digits: 59.97 s is 1 min, as 60 s is."""
    unit, size = units[0]
    for larger_unit, larger in units[1:]:
        if abs(value) < larger:
            if float(f"{abs(value) / size:.2e}") * size < larger:
                break
            value = math.copysign(larger, value)
        unit, size = larger_unit, larger
    return value / size, unit


def duration(seconds: float | None) -> str:
    """A length of time in the unit that suits it: 95.1 ms, 1 day, 2.69 years; "" where it is not known."""
    if seconds is None or math.isnan(seconds):
        return ""
    if seconds == 0.0 or math.isinf(seconds):
        return "0 s" if seconds == 0.0 else trimmed(seconds)
    if not SHORTEST <= abs(seconds) <= LONGEST:
        return "less than 1 ns" if abs(seconds) < SHORTEST else "more than 1,000 years"
    value, unit = _in_unit(seconds, DURATIONS)
    written = trimmed(value)
    return f"{written} {unit.rstrip('s') if written == '1' and len(unit) > 3 else unit}"


def goal_delay(seconds: float) -> str:
    """A delay as a goal names it, in ASCII digits that can be read back: 50 ms, 2000 ms, 25 min, 1 day."""
    value, unit = (seconds * 1e3, "ms") if 1e-3 <= seconds < 10.0 else _in_unit(seconds, DURATIONS)
    written = f"{value:.4g}"
    return f"{written} {unit.rstrip('s') if written == '1' and len(unit) > 3 else unit}"


def lag_text(samples: float, period: float | None) -> str:
    """A delay: a time where the sample period (s) is known, else samples."""
    return plural(samples, "sample") if period is None else duration(samples * period)


def lag_in_full(samples: float, period: float | None) -> str:
    """A delay as a time and in samples: 12.3 ms (4.1 samples)."""
    in_samples = plural(samples, "sample")
    return in_samples if period is None else f"{duration(samples * period)} ({in_samples})"


def decibels(value: float) -> str:
    """A level to 0.001 dB at most: −13.0 dB, 0 dB."""
    return f"{number(round(value, 3))} dB"


def share_left(reduction_db: float) -> str:
    """What a filter leaves of white noise, as a share of its standard deviation: 22 %."""
    return percent(10.0 ** (-0.05 * reduction_db))


def noise_left(reduction_db: float) -> str:
    """The same with its level: 22 % (−13.0 dB)."""
    return f"{share_left(reduction_db)} ({decibels(-reduction_db)})"


def frequency(hertz: float | None) -> str:
    """A frequency: 1.59 Hz, 2.10 kHz; slow ones as 1 / duration."""
    if hertz is None or math.isnan(hertz):
        return "none"
    if 0.0 < hertz < 1e-3:
        return f"1 / {duration(1.0 / hertz)}"
    value, unit = _in_unit(hertz, FREQUENCIES)
    return f"{number(value)} {unit}"


def sample_rate(period: float) -> str:
    """The rate of a recording from its sample period in s: 100 Hz, one every 15 min."""
    return frequency(1.0 / period) if period <= 10.0 else f"one every {duration(period)}"


def squared(unit: str) -> str:
    """The unit of a variance: counts², (m/s²)², "unit²" where the unit is not known."""
    if not unit:
        return "unit²"
    return f"{unit}²" if re.fullmatch(r"[^\W\d_]+|°C|°F|%", unit) else f"({unit})²"


def first_sentence(text: str) -> str:
    """The text up to its first full stop, without it."""
    return text.split(". ", 1)[0].rstrip(".")


def one_line(text: str) -> str:
    """Text from outside on one line, every unprintable character a space."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def plain(text: str) -> str:
    """Text that may hold names from outside, for a terminal: a control character is a space, lines stay lines."""
    return CONTROL.sub(" ", text)


def escaped(text: str) -> str:
    r"""JSON or TOML whose strings may hold names from outside: a control character is written as `\u009b`."""
    return CONTROL.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def without_blanks(text: str) -> str:
    """The text of a number without the blanks between thousands, and with "-" for a minus sign."""
    return re.sub(r"(?<=\d)[ \u202f](?=\d{3}(?!\d))", "", text.strip().replace("−", "-"))


def typed_number(name: str, text: str) -> float:
    """The number that a user typed for `name`; a decimal comma, "−" and thin spaces are allowed.

    Raises:
        BadSetting: it is not a finite number, or so small that it would become 0.
    """
    plain = without_blanks(text)
    if re.fullmatch(r"[-+]?[1-9]\d{0,2}(,\d{3})+", plain):
        raise BadSetting(f"{name} must be written without a comma for thousands: 1000 or 1.0 (got {text[:40]!r})")
    try:
        value = float(plain.replace(",", ".")) + 0.0  # -0 becomes 0
    except ValueError:
        raise BadSetting(f"{name} must be a number such as 0.01 or 1e-9 (got {text[:40]!r})") from None
    if not math.isfinite(value):
        raise BadSetting(f"{name} must be a finite number (got {text[:40]!r})")
    if value == 0.0 and re.match(r"[^e]*[1-9]", plain.lower()):
        raise BadSetting(f"{name} must be 0 or at least {MIN_NUMBER:.0e} in size (got {text[:40]!r})")
    return value


def gate_text(gate: float | None) -> str:
    """An outlier gate on v²/s in standard deviations, as a user says it: "4 σ", "off"."""
    return "off" if gate is None else f"{trimmed(math.sqrt(gate))} σ"


def gate_digits(gate: float | None) -> str:
    """The same for a text box: "4", "" where it is off; with the digits that `typed_gate` needs to give it back."""
    return "" if gate is None else f"{math.sqrt(gate):.14g}"


def typed_gate(text: str) -> float | None:
    """The outlier gate on v²/s that a user typed in standard deviations: "4", "4 σ"; "" and "off" are None.

    Raises:
        BadSetting: it is not a number above 0.
    """
    plain = text.strip().removesuffix("σ").strip()
    if plain.lower() in ("", "off"):
        return None
    sigma = typed_number("outlier gate", plain)
    if sigma <= 0.0:
        raise BadSetting(f"outlier gate must be above 0 σ, such as 4, or off (got {text[:40]!r})")
    return float(f"{sigma * sigma:.12g}")


def command_line(words: Sequence[str]) -> str:
    """Words as they are typed into the shell of this system."""
    import shlex
    import subprocess

    return subprocess.list2cmdline(words) if os.name == "nt" else shlex.join(words)


def unused_name(name: str, taken: set[str], joint: str) -> str:
    """`name`, or with a joint of " " `name 2`, `name 3`, … if it is taken; taken from now on."""
    candidate, count = name, 2
    while candidate in taken:
        candidate, count = f"{name}{joint}{count}", count + 1
    taken.add(candidate)
    return candidate


# The version of this program.


@cache  # half a millisecond, and each task of a fleet asks three times
def program() -> str:
    """Name and version; the name alone in a checkout that is not installed."""
    try:
        return f"kalscope {version('kalscope')}"
    except PackageNotFoundError:
        return "kalscope"
