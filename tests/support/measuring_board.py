"""A board on a pseudo-terminal that measures its own noise as the exported sketch says that it does."""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from contextlib import suppress
from pathlib import Path

import numpy as np
from terminal import link_to

from kalscope.estimation.noise import noise_from_still

STEP = 1.0
"""Resolution of its readings."""
RATIO = np.float32(1e-4)
"""q / r of its export."""
ROWS_AT_ONCE = 50
"""Rows between two looks for a command: on a busy machine it never catches up with its clock, but obeys."""


class PtyWire:
    """A pseudo-terminal, whose other end opens like a serial port."""

    def __init__(self) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave)  # before it is opened: in cooked mode it would echo everything
        self.name = os.ttyname(slave)
        os.close(slave)  # so that POLLHUP shows whether the other end is open
        os.set_blocking(self._master, False)

    def connected(self) -> bool:
        poll = select.poll()
        poll.register(self._master, 0)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def send(self, data: bytes) -> int:
        with suppress(BlockingIOError):
            return os.write(self._master, data)
        return 0

    def receive(self) -> bytes:
        with suppress(OSError):  # nothing was sent, or the port is closed
            return os.read(self._master, 4096)
        return b""

    def close(self) -> None:
        """As an unplugged cable does."""
        os.close(self._master)


class MeasuringBoard:
    """Starts when its port is opened; its clock runs at `rate` rows a second instead of one row a `period`."""

    def __init__(self, names=("light",), *, rate=4000.0, period=0.005, knows=True, refuses="", sigma=3.0, seed=1):
        self.names, self.knows, self.refuses, self.sigma = names, knows, refuses, sigma
        self.halted = self.deaf = False
        self.mute: tuple[str, ...] = ()  # channels that never say what they measured
        self.remark = ""  # said with every row
        self.asked: list[str] = []
        self.kept = self.worn = False
        self.used = {name: (np.float32(0.5), np.float32(20.0)) for name in names}
        self._rate, self._period, self._rng = rate, period, np.random.default_rng(seed)
        self._wire = PtyWire()
        self.link: Path = link_to(self._wire.name)
        self._end, self._again = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.unplug()

    @property
    def port(self) -> str:
        return str(self.link)

    def unplug(self) -> None:
        if not self._end.is_set():
            self._end.set()
            self._thread.join()
            self.link.unlink()
            self._wire.close()

    def reset(self) -> None:
        """Press the reset button."""
        self._again.set()

    def _run(self) -> None:
        started = None
        while not self._end.wait(0.002):
            if not self._wire.connected():
                started = None
                continue
            if started is None or self._again.is_set():
                self._again.clear()
                started = self._start()
            self._obey()
            for _ in range(ROWS_AT_ONCE):
                if not self.halted and self._rows < (time.monotonic() - started) * self._rate:
                    self._row()

    def _start(self) -> float:
        self._rows, self._line = 0, b""
        self._left: dict[str, list[float]] = {}
        self._size: dict[str, int] = {}
        if self.kept:
            self._say("# kept values are in use")
        columns = [f"{name},{name}_filtered" for name in self.names]
        self._say(f"# {','.join(columns) if len(columns) > 1 else 'raw,filtered'}")
        return time.monotonic()

    def _say(self, line: str) -> None:
        data = f"{line}\r\n".encode()
        while data and not self._end.is_set() and self._wire.connected():
            data = data[self._wire.send(data) :]

    def _row(self) -> None:
        z = np.rint(512.0 + self.sigma * self._rng.normal(size=len(self.names)))
        self._rows += 1
        self._say(",".join(f"{one:.1f},{one:.1f}" for one in z))
        if self.remark:
            self._say(self.remark)
        for name, one in zip(self.names, z, strict=True):
            if name in self._size:
                self._left[name].append(one)
                if len(self._left[name]) == self._size[name]:
                    self._measured(name)

    def _measured(self, name: str) -> None:
        del self._size[name]
        if name in self.mute:
            return
        if self.refuses:
            self._say(f"# {name} not calibrated: {self.refuses}")
            return
        z = np.array(self._left[name])
        found = noise_from_still(z, STEP)
        r = np.float32(found.r)
        q = RATIO * r
        self.used[name] = q, r
        bits = ",".join(f"{one.view(np.uint32):08X}" for one in (r, q, np.float32(STEP)))
        counts = f"n={found.samples} spikes={len(z) - found.samples} missing=0"
        self._say(f"# {name} calibrated r={r:.6e} q={q:.6e} {counts} step={STEP:.6f} bits={bits}")

    def _obey(self) -> None:
        self._line += self._wire.receive()
        while b"\n" in self._line:
            line, _, self._line = self._line.partition(b"\n")
            self.asked.append(line.decode())
            if not self.deaf:
                self._do(line.decode().split())

    def _do(self, words: list[str]) -> None:
        only = [self.names[int(words[0]) - 1]] if words[0].isdigit() else self.names
        what, *value = words[1:] if words[0].isdigit() else words
        if what in "ckf" and not self.knows:
            self._say("# not understood; q VALUE, r VALUE (0 or more, not both 0), p VALUE (or inf), or ?")
        elif what == "k" and self.worn:
            self._say("# not kept: the EEPROM does not hold what was written")
        elif what == "k":
            self.kept = True
            self._say(f"# kept {len(self.names)} channels")
        elif what == "f":
            self.kept = False
            self._say("# forgotten")
        elif what == "c":
            self._calibrate(only, float(value[0]))
        else:
            for name in only:
                q, r = self.used[name]
                q, r = (np.float32(value[0]) if what == "q" else q), (np.float32(value[0]) if what == "r" else r)
                self.used[name] = q, r
                bits = ",".join(f"{one.view(np.uint32):08X}" for one in (q, r, np.float32(np.inf)))
                self._say(f"# {name} q={q:.6e} r={r:.6e} p=inf bits={bits}")

    def _calibrate(self, names, seconds: float) -> None:
        rows = round(seconds / self._period)
        for name in names:
            if seconds == 0.0:
                self._size.pop(name, None)
                self._say(f"# {name} not calibrated: cancelled")
            elif rows < 80:
                self._say(f"# {name} not calibrated: too short; {80 * self._period:g} s at least")
            else:
                self._size[name], self._left[name] = 16 + (rows - 16) // 8 * 8, []
                self._say(f"# {name} calibrating rows={self._size[name]}")
