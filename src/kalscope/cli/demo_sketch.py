"""`kalscope demo-board --sketch`: filters in float32 and obeys commands, as the exported Arduino sketch does.

`export/board.py` sends the commands and reads the answers.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from kalscope.errors import BadSetting
from kalscope.estimation.noise import noise_from_still
from kalscope.export.board import MAX_LETTERS
from kalscope.export.names import identifiers
from kalscope.recording import Recording
from kalscope.sources.live.source import MAX_COMMAND_BYTES

_START = {"q": 0.01, "r": 1.0, "p": np.inf}
"""The values of the export; a measurement of r keeps q over r."""
_COMMAND = re.compile(r"(\d{0,3}) *(?:\?|([qrpc]) *((?:\d*\.)?\d+(?:e[+-]?\d+)?|inf))", re.ASCII)
_REFUSAL = "# not understood; q VALUE, r VALUE (0 or more, not both 0), p VALUE (or inf), c SECONDS or ?"


class Sketch:
    """The state of a board that runs the sketch."""

    def __init__(self, recording: Recording, rate: float) -> None:
        """Args: What the sensors see; samples per second."""
        self._rate = rate
        self._z, self._rest, self._sent = recording.values.astype(np.float32), "", 0
        self._names, count = identifiers(recording.names), len(recording.names)
        self._used = {key: np.full(count, value, np.float32) for key, value in _START.items()}
        self._x, self._p = np.full(count, np.nan, np.float32), self._used["p"].copy()
        self._ends: dict[int, tuple[int, int]] = {}  # by channel: when a measurement ends, and its rows

    def line(self, row: int) -> bytes:
        """The line of a sample, and what a measurement found that ends with it."""
        z, p, r = self._z[row], self._p + self._used["q"], self._used["r"]
        came, unknown = ~np.isnan(z), np.isinf(p)
        gain: NDArray[np.float32] = np.divide(p, p + r, out=np.ones_like(p), where=~unknown)
        x = self._x + gain * (z - self._x)
        np.copyto(x, z, where=unknown | np.isnan(x))
        self._x, self._p = np.where(came, x, self._x), np.where(came, gain * r, p)
        self._sent += 1
        pairs = zip(self._names, z, self._x, strict=True)
        text = ",".join(f"{name}:{raw:.9g},{name}_filtered:{filtered:.9g}" for name, raw, filtered in pairs)
        found = [self._found(i, row + 1, rows) for i, (end, rows) in self._ends.items() if end == self._sent]
        return "".join(f"{line}\r\n" for line in (text, *found)).encode()

    def _found(self, i: int, end: int, rows: int) -> str:
        z = self._z[np.arange(end - rows, end) % len(self._z), i].astype(np.float64)
        try:
            still = noise_from_still(z)
        except BadSetting as error:
            return f"# {self._names[i]} not calibrated: {error}"[:MAX_LETTERS]
        q, r, step = np.array([still.r * _START["q"] / _START["r"], still.r, still.quantum], np.float32)
        self._used["q"][i], self._used["r"][i] = q, r
        missing = int(np.isnan(z).sum())
        counts = f"n={still.samples} spikes={len(z) - missing - still.samples} missing={missing}"
        said = f"calibrated r={r:.6e} q={q:.6e} {counts} step={step:.6e} bits={_bits(r, q, step)}"
        return f"# {self._names[i]} {said}"

    def obey(self, received: bytes) -> bytes:
        """The answers to what arrived; a command may arrive in parts."""
        *lines, rest = re.split("[\r\n]+", self._rest + received.decode("ascii", "replace"))
        self._rest = rest[:MAX_COMMAND_BYTES]
        return "".join(f"{answer}\r\n" for line in filter(None, lines) for answer in self._answers(line)).encode()

    def _answers(self, line: str) -> list[str]:
        if line in ("k", "f"):
            return ["# not kept: a demo board has no EEPROM"]
        if (match := _COMMAND.fullmatch(line)) is None:
            return [_REFUSAL]
        number, what, value = match.groups()
        channels = range(len(self._names))[int(number) - 1 : int(number)] if number else range(len(self._names))
        answers = [self._answer(i, what, np.float32(value or 0.0)) for i in channels]
        return answers if answers and all(answers) else [_REFUSAL]

    def _answer(self, i: int, what: str | None, value: np.float32) -> str:
        """What the sketch says to a command for one channel; "" where it cannot work with the value."""
        used = {key: values[i] for key, values in self._used.items()}
        if what == "c":
            rows = round(min(float(value), 1e6) * self._rate)
            self._ends[i] = self._sent + rows, rows
            return f"# {self._names[i]} " + (f"calibrating rows={rows}" if rows else "not calibrated: cancelled")
        if what is not None:
            used[what] = value
            if not 0.0 < used["q"] + used["r"] < np.inf:
                return ""
            self._used[what][i] = value
        if what == "p":
            self._x[i], self._p[i] = np.nan, value
        values = " ".join(f"{key}={one:.6e}" for key, one in used.items())
        return f"# {self._names[i]} {values} bits={_bits(*used.values())}"


def _bits(*values: np.float32) -> str:
    return ",".join(f"{value.view(np.uint32):08X}" for value in values)
