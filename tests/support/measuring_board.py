"""A demo board that runs the exported sketch faster than its clock, and can be made to fail as boards do."""

from __future__ import annotations

import threading
from contextlib import suppress

import numpy as np

from kalscope import Recording
from kalscope.cli.demo_board import Sketch, _listen, send_lines

ROWS, PERIOD, RATE = 20_000, 0.005, 2000.0
"""Rows until it repeats; seconds a row takes by its clock; rows that it sends a second."""


class MeasuringBoard(Sketch):
    """Listens on a port of its own while its block runs."""

    def __init__(self, names=("light",)):
        z = np.rint(512.0 + 3.0 * np.random.default_rng(1).normal(size=(ROWS, len(names))))
        super().__init__(Recording(np.arange(ROWS) * PERIOD, names, ("",) * len(names), z, PERIOD), RATE)
        self.rows_per_s = 1.0 / PERIOD
        self.knows, self.refuses = True, ""
        self.halted = self.deaf = self.kept = self.worn = False
        self.mute: tuple[str, ...] = ()  # channels that never say what they measured
        self.remark = ""  # said with every row
        self.asked: list[str] = []
        self._server, self._stop = _listen(0), threading.Event()
        self.port = f"tcp://127.0.0.1:{self._server.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.unplug()

    def unplug(self) -> None:
        self._stop.set()
        self._thread.join()
        self._server.close()

    def _serve(self) -> None:
        while not self._stop.is_set():
            with suppress(TimeoutError), self._server.accept()[0] as client:
                send_lines(client, self, self._stop)

    def uses(self, name: str) -> float:
        """The r of a channel."""
        return float(self._used["r"][self._names.index(name)])

    def line(self, row: int) -> bytes:
        return b"" if self.halted else super().line(row) + f"{self.remark}\r\n".encode()

    def _found(self, i: int, end: int, rows: int) -> str:
        if self._names[i] in self.mute:
            return ""
        return (
            f"# {self._names[i]} not calibrated: {self.refuses}" if self.refuses else super()._found(i, end, rows)
        )

    def _answers(self, line: str) -> list[str]:
        self.asked.append(line)
        what = line.lstrip("0123456789 ")[:1]
        if self.deaf:
            return []
        if what in ("c", "k", "f") and not self.knows:
            return super()._answers("not understood")
        if what == "k" and self.worn:
            return ["# not kept: the EEPROM does not hold what was written"]
        if what in ("k", "f"):
            self.kept = what == "k"
            return [f"# kept {len(self._names)} channels" if self.kept else "# forgotten"]
        return super()._answers(line)
