"""Words that are units, in a header, in a row of their own or after a number."""

from __future__ import annotations

import re


def words(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


_UNITS = words(
    """
    s sec second seconds secs ms msec msecs millis us usec µs μs ns min mins minute minutes h hr hour hours
    d day days yr year years
    lb lbs oz kgf gf
    v volt volts mv uv µv kv a amp amps ampere amperes ma ua µa na g mg kg m mm cm km um µm meter meters
    metre metres
    m/s m/s2 m/s^2 m/s² m/s/s km/h kph mph mps knots kn ft in gal deg ° degree degrees rad deg/s °/s dps rad/s rpm
    degc °c c celsius f degf °f k kelvin fahrenheit % %rh rh percent pct
    pa hpa kpa mpa mbar bar psi mmhg inhg torr at atm hz khz mhz ghz lux lx ppm ppb count counts lsb adc raw ts rn
    w kw mw watt watts w/m2 w/m^2 w/m² kwh wh n newton newtons nm n·m joule joules j db dbm dbv ohm ohms kohm ω kω
    farad f/m t ut µt mt tesla gauss l ml liter liters litre litres l/min bpm no_units unitless
    """
)
MAX_UNIT = 24
"""Most characters of a unit that is recognised only by a sign such as / or °."""
_SIGNS = re.compile(r"[/^°²³%µ]")
# Suffixes of a channel's name that can hardly be anything else; one letter (a_g, a_x) could be.
_SUFFIX_UNITS = words(
    """
    mm cm km mv ma mg ms us degc degf hpa kpa mbar hz lux ppm ppb rpm dps kg
    """
)


def is_unit(text: str) -> bool:
    """True for a known unit, and for a text with a sign that only units have."""
    text = text.strip().lower()
    spaced = "deg" in text and text.replace(" ", "") in _UNITS
    marked = len(text) <= MAX_UNIT and ":" not in text and _SIGNS.search(text) is not None
    return text in _UNITS or spaced or marked


def _is_unit_alone(text: str) -> bool:
    """True for a unit with nothing around it: m/s is one, Date/Time and Load[%] are not."""
    parts = [part.strip("()^-+23 ") for part in text.lower().split("/")]
    marked = any(mark in text for mark in "°²³%µ") and "[" not in text and "(" not in text
    return marked or all(part in _UNITS for part in parts)


def is_measure(text: str) -> bool:
    """True for a unit that may follow each number of a column: the C of 26.69C, the % of 45%."""
    return text.removesuffix("DC").removesuffix("AC").rstrip().lower() in _UNITS  # a multimeter writes 3.3 V DC


def is_unit_suffix(text: str) -> bool:
    """True for a unit that may end a name: the cm of Distance_cm."""
    return text.lower() in _SUFFIX_UNITS


def bare_unit(unit: str) -> str:
    """The unit without its brackets; "" for "-"."""
    unit = unit[1:-1] if unit[:1] + unit[-1:] in ("[]", "()") and len(unit) > 1 else unit
    return "" if unit.strip() in ("-", "--", "no_units", "unitless") else unit.strip()


def are_units(cells: tuple[str, ...]) -> bool:
    """True for a row of units: half of its cells or more are known, the others are short or "-", none is long."""
    said = [cell for cell in cells if cell and cell != "-"]
    known = sum(cell != bare_unit(cell) or _is_unit_alone(cell) for cell in said)
    return known > 0 and 2 * known >= len(said) and all(len(cell) <= 16 for cell in said)
