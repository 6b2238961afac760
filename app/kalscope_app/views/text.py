"""Numbers and names as a person reads them. Pure."""

from __future__ import annotations

import math
import re

from kalscope_app.views.scales import TIME_UNITS

DURATIONS = (("µs", 1e-6), *TIME_UNITS)


def number(value: float, digits: int = 3) -> str:
    """A number at `digits` significant digits: 0.0951, 15100, 1.2e-9; "∞" and "none" for inf and NaN."""
    if math.isnan(value):
        return "none"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0.0:
        return "0"
    rounded = float(f"{value:.{digits - 1}e}")
    size = abs(rounded)
    if 1e-4 <= size < 1e6:
        decimals = max(0, digits - 1 - math.floor(math.log10(size)))
        text = f"{rounded:,.{decimals}f}".replace(",", " ") if size >= 1e4 else f"{rounded:.{decimals}f}"
        return text.replace("-", "−")
    mantissa, exponent = f"{rounded:.{digits - 1}e}".split("e")
    return f"{mantissa}e{int(exponent)}".replace("-", "−", 1) if rounded < 0 else f"{mantissa}e{int(exponent)}"


def typed(value: float) -> str:
    """A value for a text box, up to eight digits, without padding zeros: 0.0589, 1e-9, 1469.18."""
    text = f"{value:.8g}"
    return re.sub(r"e([+-])0*(\d)", lambda m: f"e{m[1].replace('+', '')}{m[2]}", text)


def duration(seconds: float | None) -> str:
    """A length of time in the unit that suits it: 95.1 ms, 2.69 years."""
    if seconds is None or not math.isfinite(seconds):
        return "∞" if seconds is not None and seconds > 0 else ""
    if seconds == 0.0:
        return "0 s"
    unit, length = next((pair for pair in reversed(DURATIONS) if seconds >= pair[1]), DURATIONS[0])
    value = number(seconds / length)
    value = value.rstrip("0").rstrip(".") if "." in value and "e" not in value else value
    return f"{value} {unit.rstrip('s') if value == '1' and len(unit) > 3 else unit}"


def lag_text(samples: float, period: float | None) -> str:
    """A lag of the settled filter: a time, or samples where the recording has no time (period in s or None)."""
    return f"{number(samples)} samples" if period is None else duration(samples * period)


def noise_text(reduction: float) -> str:
    """White noise, in to out, from its reduction in dB: "−13.0 dB"."""
    return f"{number(-reduction)} dB"


def frequency(hertz: float | None) -> str:
    """A frequency: 1.59 Hz, 2.1 kHz; slow ones as one per a length of time."""
    if hertz is None or math.isnan(hertz):
        return "none"
    if 0.0 < hertz < 1e-3:
        return f"1 / {duration(1.0 / hertz)}"
    for unit, size in (("MHz", 1e6), ("kHz", 1e3), ("Hz", 0.0)):
        if hertz >= size:
            return f"{number(hertz / (size or 1.0))} {unit}"
    return "0 Hz"


def squared(unit: str) -> str:
    """The unit of a variance: counts², (m/s²)², "unit²" where the unit is not known."""
    if not unit:
        return "unit²"
    return f"{unit}²" if re.fullmatch(r"[^\W\d_]+|°C|°F|%", unit) else f"({unit})²"


def count(n: int) -> str:
    """A count with thin groups: 1 000 000."""
    return f"{n:,}".replace(",", " ")


def plain(text: str, limit: int = 60) -> str:
    """A name from outside, fit for markdown: one line, cut, every mark-up character escaped."""
    line = " ".join(text.split())
    line = line if len(line) <= limit else line[: limit - 1] + "…"
    return re.sub(r"([\\`*_{}\[\]()#+\-.!|<>&~:$@\"'/^=])", r"\\\1", line)
