"""`kalscope demo-board`: send a recording or a synthetic signal over a local socket as a board does, until stopped.

For users without hardware, and for tests of what reads a port. With `--sketch` it filters in float32 and obeys
commands, as the exported Arduino sketch does; `export/board.py` sends them and reads the answers.
"""

from __future__ import annotations

import math
import re
import select
import socket
import threading
import time
from contextlib import suppress
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from kalscope.cli.options import Source, number_option, whole
from kalscope.cli.options import number as cli_number
from kalscope.common.stopping import stop_signals
from kalscope.errors import BadDevice, BadSetting, reason_of
from kalscope.estimation.noise import SPIKE, StillNoise, noise_from_still
from kalscope.estimation.still import GROUPS, MAX_DRIFT, SURE
from kalscope.export.names import identifiers
from kalscope.recording import Recording
from kalscope.sources.live.source import MAX_COMMAND_BYTES

MAX_RATE = 100_000.0
"""Maximum number of lines per second; no serial line carries more."""
DEFAULT_RATE = 100.0
"""Lines per second of a recording without time."""
_TICK_S = 0.02
"""Longest pause between two looks for a client, lines that are due, or the end, s."""
_MAX_BLOCKED_S = 1.0
"""Time after which a client that reads nothing is disconnected, s."""


class BoardLines:
    """The lines of a board, `name:value,name:value` per sample, and when each is due; the recording repeats."""

    def __init__(self, recording: Recording, rate: float | None = None) -> None:
        """Format all lines.

        Args:
            recording: What the sensor sees; a gap in its time is a pause.
            rate: Lines per second; None = as the recording was sampled.

        Raises:
            BadSetting: the rate is not within 0 … 100,000.
        """
        if rate is not None and not 0 < rate <= MAX_RATE:
            raise BadSetting(f"--rate must be above 0 and at most {MAX_RATE:.0f} lines per second (got {rate:g})")
        self.due, self.period = _due(recording, rate)
        """When each line is due, s, shape (n,), and after what time the recording repeats, s."""
        names = [_name(name, unit) for name, unit in zip(recording.names, recording.units, strict=True)]
        self.lines = [
            ",".join(f"{name}:{value:.9g}" for name, value in zip(names, row, strict=True)).encode() + b"\r\n"
            for row in recording.values.tolist()
        ]
        """One line per sample, newline included."""

    def between(self, sent: int, now: float) -> tuple[list[int], float]:
        """Which lines after the first `sent` ones are due at `now`, s, and when the next one is."""
        rows: list[int] = []
        while True:
            repeats, at = divmod(sent + len(rows), len(self.lines))
            due = float(self.due[at]) + repeats * self.period
            if due > now:
                return rows, due
            rows.append(at)

    def line(self, row: int) -> bytes:
        """The line of a sample, and what else the board says then."""
        return self.lines[row]

    def obey(self, received: bytes) -> bytes:  # noqa: ARG002  # see `Sketch`
        """The answers to what arrived."""
        return b""


def _due(recording: Recording, rate: float | None) -> tuple[NDArray[np.float64], float]:
    n = len(recording)
    if rate is None and recording.sample_period is None:
        rate = DEFAULT_RATE
    if rate is not None:
        return np.arange(n) / rate, n / rate
    period = max(recording.sample_period or 0.0, 1 / MAX_RATE)
    due = np.concatenate(([0.0], np.cumsum(np.maximum(np.diff(recording.time), 0.0))))
    if n > 1 and due[-1] < (n - 1) / MAX_RATE:
        raise BadSetting(f"--rate must be given where a recording is faster than {MAX_RATE:.0f} lines per second")
    return due, float(due[-1]) + period


def _name(name: str, unit: str) -> str:
    """A name that cannot be mistaken for anything else on the line."""
    bare = "".join("_" if c in ",:;*#\t|" or not c.isprintable() else c for c in name).strip() or "value"
    return f"{bare}[{unit}]" if unit and unit.isprintable() and not set(unit) & set(",:;*[]") else bare


def _listen(port: int) -> socket.socket:
    """A socket on 127.0.0.1 for one client at a time; 0 = any free port."""
    if not 0 <= port <= 65535:
        raise BadSetting(f"--socket must be a port from 0 to 65535 (got {port})")
    try:
        server = socket.create_server(("127.0.0.1", port), backlog=1)
    except OSError as error:
        raise BadDevice(f"--socket must be a free port (got {port}: {reason_of(error)})") from error
    server.settimeout(_TICK_S)
    return server


def send_lines(client: socket.socket, lines: BoardLines, stop: threading.Event) -> None:
    """Send the lines from the first on, each when it is due, until the client disconnects or `stop` is set."""
    client.settimeout(_MAX_BLOCKED_S)
    start, sent = time.monotonic(), 0
    with suppress(OSError):  # the client disconnected
        client.sendall(b"# kalscope demo-board\r\n")
        while not stop.is_set():
            rows, due = lines.between(sent, time.monotonic() - start)
            sent += len(rows)
            client.sendall(b"".join(map(lines.line, rows)))
            if select.select([client], [], [], max(0.0, min(start + due - time.monotonic(), _TICK_S)))[0]:
                if not (received := client.recv(4096)):
                    return
                client.sendall(lines.obey(received))


# `--sketch`: the state of the exported sketch, and its answers.


_START = {"q": 0.01, "r": 1.0, "p": np.inf}
"""The values of the export; a measurement of r keeps q over r."""
_COMMAND = re.compile(r"(\d{0,3}) *(?:\?|([qrpc]) *((?:\d*\.)?\d+(?:e[+-]?\d+)?|inf))", re.ASCII)
_LEARNING, _MIN_EACH, _MAX_EACH, _MIN_CHANGES = 16, 8, 8000, 16
"""Of `KalscopeCalibration.h`: rows before the groups that are measured, rows in each, and unequal neighbours."""
_REFUSAL = "# not understood; q VALUE, r VALUE (0 or more, not both 0), p VALUE (or inf), c SECONDS or ?"


class Sketch(BoardLines):
    """The lines of a board that runs the sketch, and its state."""

    def __init__(self, recording: Recording, rate: float | None = None) -> None:
        """As for any demo board."""
        super().__init__(recording, rate)
        self._z, self._rest, self._sent = recording.values.astype(np.float32), "", 0
        self._names, count = identifiers(recording.names), len(recording.names)
        self._used = {key: np.full(count, value, np.float32) for key, value in _START.items()}
        self._x, self._p = np.full(count, np.nan, np.float32), self._used["p"].copy()
        self._ends: dict[int, tuple[int, int]] = {}  # by channel: when a measurement ends, and its rows
        self.rows_per_s = len(self.lines) / self.period
        """By which the time of a measurement counts."""

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
        still = None
        with suppress(BadSetting):
            still = noise_from_still(z)
        why = _why_not_still(z, still)
        if still is None or why:
            return f"# {self._names[i]} not calibrated: {why}"
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
            return f"# {self._names[i]} {self._begin(i, float(value))}"
        if what is not None:
            used[what] = value
            if not 0.0 < used["q"] + used["r"] < np.inf:
                return ""
            self._used[what][i] = value
        if what == "p":
            self._x[i], self._p[i] = np.nan, value
        values = " ".join(f"{key}={one:.6e}" for key, one in used.items())
        return f"# {self._names[i]} {values} bits={_bits(*used.values())}"

    def _begin(self, i: int, seconds: float) -> str:
        """Begin to measure for so long; 0 s ends it."""
        self._ends.pop(i, None)
        if seconds == 0.0:
            return "not calibrated: cancelled"
        least, most = (
            100.0 * (_LEARNING + (GROUPS + 1) * each) / self.rows_per_s for each in (_MIN_EACH, _MAX_EACH)
        )
        each = (round(min(seconds * self.rows_per_s, 1e9)) - _LEARNING) // (GROUPS + 1)
        if each < _MIN_EACH:
            return f"not calibrated: too short; {0.01 * math.ceil(least):g} s at least"
        if each > _MAX_EACH:
            return f"not calibrated: too long; {0.01 * math.floor(most):g} s at most"
        rows = _LEARNING + (GROUPS + 1) * each
        self._ends[i] = self._sent + rows, GROUPS * each
        return f"calibrating rows={rows}"


def _why_not_still(z: NDArray[np.float64], still: StillNoise | None) -> str:
    """Why the sketch refuses these readings, groups of equal size, whose noise is `still`; "" if it does not."""
    n, missing = len(z), int(np.isnan(z).sum())
    if missing > n // 10:
        return f"no reading in {missing} of {n} samples"
    changes = int(np.count_nonzero(np.nan_to_num(np.diff(z))))
    if still is None or (still.variance <= still.floor and changes < _MIN_CHANGES):
        return "nearly all readings are equal"
    if (spikes := n - missing - still.samples) > n // 20:
        return f"spikes in {spikes} of {n} samples"
    off = z - still.drift * np.arange(n)
    off -= np.nanmedian(off)
    off[np.abs(off) > SPIKE * max(math.sqrt(still.r), still.quantum)] = np.nan
    groups, chance = off.reshape(GROUPS, -1), GROUPS - 2 + SURE * math.sqrt(2.0 * (GROUPS - 2)) + 3.0
    wander, drift = float(np.var(np.nanmean(groups, axis=1))) * n / still.r, abs(still.drift) * n
    if wander > max(chance, n / 100.0) or drift > MAX_DRIFT * math.sqrt(still.r):
        return "the level moves"
    return "" if still.variance <= still.floor else _why_not_white(off, groups, still)


def _why_not_white(off: NDArray[np.float64], groups: NDArray[np.float64], still: StillNoise) -> str:
    """Why readings about their line, `off`, also in `groups`, are no white noise; "" if they are."""
    n = len(off)
    apart = float(np.ptp(np.nanvar(groups, axis=1, ddof=1))) / still.variance
    coarse = 2.0 + still.quantum**2 / still.variance
    if apart**2 > max(0.16, GROUPS * (2.0 * SURE) ** 2 * coarse / n):
        return "the noise is uneven"
    jumps = float(np.nanmean(np.diff(off) ** 2)) / (2.0 * still.variance) - 1.0
    return "neighbouring readings depend on each other" if jumps**2 > max(0.01, SURE**2 / n) else ""


def _bits(*values: np.float32) -> str:
    return ",".join(f"{value.view(np.uint32):08X}" for value in values)


def demo_board_command(
    source: Source = "demo",
    port: Annotated[
        int,
        typer.Option("--socket", metavar="PORT", help="Port on 127.0.0.1; default: any free one.", parser=whole),
    ] = 0,
    rate: Annotated[
        float | None, number_option("Lines per second; default: as SOURCE was sampled.", cli_number)
    ] = None,
    as_sketch: Annotated[
        bool, typer.Option("--sketch", help="Filter too, and obey commands, as the exported Arduino sketch does.")
    ] = False,
) -> None:
    """Send a recording over a port, as a board would.

    The port is a local socket. Each program that connects gets the recording from its start, at its own rate,
    until Ctrl+C.
    """
    from kalscope.catalogue import open_source

    lines = (Sketch if as_sketch else BoardLines)(open_source(source), rate)
    with _listen(port) as server, stop_signals() as stop:
        print(f"Demo board: kalscope open tcp://127.0.0.1:{server.getsockname()[1]}", flush=True)
        while not stop.is_set():
            with suppress(TimeoutError), server.accept()[0] as client:
                send_lines(client, lines, stop)
