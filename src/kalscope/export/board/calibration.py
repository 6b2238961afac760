"""The commands by which a board measures its own noise, and its answers: texts only, no port.

A sketch exported with calibration supports them. The answers come from outside: each is split once and bounded in
length, and its numbers must be finite and agree with their bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.errors import BadSetting

MAX_LETTERS = 200
"""Maximum length of an answer that is read, characters; a live source cuts its lines there."""

_AGREES = 1e-5
"""Share by which a printed number may differ from its bits: a board divides by ten until seven digits are left."""


@dataclass(frozen=True)
class Calibrating:
    """The board measures from the next sample on."""

    name: str
    """Identifier of the channel."""
    rows: int
    """Samples that it takes."""


@dataclass(frozen=True)
class Calibrated:
    """The board has measured the `rows` samples before this line, and uses r and q from the next sample on."""

    name: str
    """Identifier of the channel."""
    r: np.float32
    """Measurement-noise variance, unit², exact."""
    q: np.float32
    """Process-noise variance, unit², exact: r times the q/r of the export, whose lag it keeps."""
    step: np.float32
    """Resolution of the readings as the board sees or knows it, unit, exact; 0 = none."""
    samples: int
    """Samples that r was measured on."""
    spikes: int
    """Samples that were set aside."""
    missing: int
    """Samples without a reading."""

    @property
    def rows(self) -> int:
        """All samples that were examined."""
        return self.samples + self.spikes + self.missing

    @property
    def parameters(self) -> dict[str, float]:
        """The values of q and r, in as few digits as give the same float32."""
        return {name: float(str(value)) for name, value in (("q", self.q), ("r", self.r))}

    @property
    def is_rounding(self) -> bool:
        """Whether the readings hardly change, so that r is only the variance of rounding to a step."""
        floor = float(self.step) ** 2 / 12.0
        return floor > 0.0 and math.isclose(float(self.r), floor, rel_tol=1e-5)


@dataclass(frozen=True)
class NotCalibrated:
    """The board could not measure, and keeps the values that it had."""

    name: str
    """Identifier of the channel."""
    reason: str
    """Why, in the words of the board."""


@dataclass(frozen=True)
class Kept:
    """The board starts with its present values from now on."""

    channels: int
    """Channels whose values it keeps."""


@dataclass(frozen=True)
class NotKept:
    """The board could not store its values."""

    reason: str
    """Why, in the words of the board."""


@dataclass(frozen=True)
class Forgotten:
    """The board starts with the values of its export from now on."""


@dataclass(frozen=True)
class KeptAtStart:
    """The board has just started, and something was stored."""

    refused: str
    """Why it is not used, in the words of the board; "" = it is."""


@dataclass(frozen=True)
class NotUnderstood:
    """The sketch does not know the command."""


CalibrationAnswer = (
    Calibrating | Calibrated | NotCalibrated | Kept | NotKept | Forgotten | KeptAtStart | NotUnderstood
)

KEEP = "k"
"""The line that stores the values of all channels: the board starts with them."""
FORGET = "f"
"""The line that removes what was stored: the board starts with the values of its export."""


def start(seconds: float, channel: int | None = None) -> str:
    """The line that lets a board measure.

    Args:
        seconds: For how long, > 0.
        channel: Which channel of the board, from 1; None = all.

    Raises:
        BadSetting: This is not a valid time to measure for.
    """
    if not 0.0 < seconds < 1e6:
        raise BadSetting(f"the time to measure for must be above 0 s and below 1e6 s (got {seconds:.6g})")
    return _for(channel, f"c {seconds:.6g}")


def cancel(channel: int | None = None) -> str:
    """The line that ends it: the board keeps the values that it had."""
    return _for(channel, "c 0")


def _for(channel: int | None, command: str) -> str:
    return command if channel is None else f"{channel} {command}"


def read_answer(line: str) -> CalibrationAnswer | None:
    """What a line says of a calibration; None for any other line: a sample, another remark, a damaged answer."""
    if len(line) > MAX_LETTERS or not line.startswith("# ") or not (line.isascii() and line.isprintable()):
        return None
    words = line[2:].split()
    found = _of_all(words)
    return _of_channel(words) if found is None and words and words[0].isidentifier() else found


def _of_all(words: list[str]) -> CalibrationAnswer | None:
    """An answer for the whole board."""
    found: CalibrationAnswer | None = None
    match words:
        case ["not", "understood" | "understood;", *_]:
            found = NotUnderstood()
        case ["kept", count, "channel" | "channels"] if (channels := _count(count)) is not None:
            found = Kept(channels)
        case ["not", "kept:", *reason] if reason:
            found = NotKept(" ".join(reason))
        case ["forgotten"]:
            found = Forgotten()
        case ["kept", "values", "are", "in", "use"]:
            found = KeptAtStart("")
        case ["kept", "values", "refused:", *reason] if reason:
            found = KeptAtStart(" ".join(reason))
        case _:
            pass
    return found


def _of_channel(words: list[str]) -> CalibrationAnswer | None:
    """An answer for one channel, named first."""
    found: CalibrationAnswer | None = None
    match words:
        case [name, "calibrating", rows] if (count := _count(rows.removeprefix("rows="))) is not None:
            found = Calibrating(name, count)
        case [name, "calibrated", *fields]:
            found = _calibrated(name, fields)
        case [name, "not", "calibrated:", *reason] if reason:
            found = NotCalibrated(name, " ".join(reason))
        case _:
            pass
    return found


def _calibrated(name: str, fields: list[str]) -> Calibrated | None:
    """The measured values, if all are there and the printed ones are those of the bits."""
    said = dict(field.split("=", 1) for field in fields if "=" in field)
    bits = said.get("bits", "").split(",")
    if len(bits) != len(("r", "q", "step")):
        return None
    r, q, step = (_float32(said.get(key, ""), one) for key, one in zip(("r", "q", "step"), bits, strict=True))
    samples, spikes, missing = (_count(said.get(key, "")) for key in ("n", "spikes", "missing"))
    if r is None or q is None or step is None or samples is None or spikes is None or missing is None:
        return None
    return Calibrated(name, r, q, step, samples, spikes, missing) if r > 0.0 and samples > 0 else None


def _float32(printed: str, bits: str) -> np.float32 | None:
    """The value of eight hexadecimal digits, if it is 0 or more and agrees with the printed number."""
    try:
        value = float(printed)
    except ValueError:
        return None
    if len(bits) != 8 or not set(bits) <= set("0123456789ABCDEF"):
        return None
    exact = np.uint32(int(bits, 16)).view(np.float32)
    if not 0.0 <= exact < np.inf or not math.isclose(value, float(exact), rel_tol=_AGREES):
        return None
    return exact


def _count(text: str) -> int | None:
    return int(text) if text.isdigit() and len(text) <= 9 else None
