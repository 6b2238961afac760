"""What the live benchmarks share: a board on a pseudo-terminal whose lines carry their number and time.

    1st channel   a noisy wave of 0 ... 1000; its last five decimals are the line's number modulo 60,000
    2nd channel   the line's number
    3rd ...       number * j, j = 2, 3 ...

So the newest line that a chart shows can be read off the drawn value, and a recording checked to the last digit.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import random
import time
import tty
from multiprocessing.sharedctypes import RawArray, RawValue

import numpy as np
from numpy.typing import NDArray

TICK = 0.002
"""Seconds between two writes, about as a USB chip hands over."""
MARKS = 60_000
"""Numbers after which the mark repeats: `number_of` distinguishes a lag from one that is a minute longer."""
_NOISE = [random.Random(1).gauss(0.0, 20_000.0) for _ in range(997)]


def wave(number: int) -> int:
    """The first channel of a line, in 1e-8: three decimals of noise, five of the mark."""
    level = 500_000 + 300_000 * math.sin(number / 700.0) + _NOISE[number % len(_NOISE)]
    return int(level) * 100_000 + number % MARKS


def line(number: int, channels: int) -> str:
    """One line, without its end."""
    whole, rest = divmod(wave(number), 100_000_000)
    return ",".join((f"{whole}.{rest:08d}", str(number), *(str(number * j) for j in range(2, channels))))


def number_of(drawn: NDArray[np.float64], sent: int) -> NDArray[np.int64]:
    """The numbers of the lines that drawn values of the first channel belong to: the last such before `sent`."""
    mark = np.round(np.asarray(drawn) * 1e8).astype(np.int64) % 100_000
    return sent - 1 - (sent - 1 - mark) % MARKS


def soak_parser(doc: str | None) -> argparse.ArgumentParser:
    """The options of both soaks; `doc` is the docstring of the script."""
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate", type=float, default=1000.0, help="lines a second of the numbered board")
    parser.add_argument("--channels", type=_channels, default=2, help="at least 2: the wave and the number")
    parser.add_argument("--every", type=float, default=30.0, help="seconds between two looks")
    return parser


def _channels(text: str) -> int:
    if int(text) < 2:
        raise argparse.ArgumentTypeError("must be at least 2: the wave and the number")
    return int(text)


class NumberedBoard:
    """The board, in a process of its own, paced by the clock; use it in a `with`, then `start` it."""

    def __init__(self, rate: float, channels: int, longest: float) -> None:
        """Args: lines a second; values a line, at least 2; seconds that it may send at most."""
        self.rate, self.channels = rate, channels
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        most = round(rate * longest)
        self._written = RawArray("d", most)
        self._sent, self._go, self._end = RawValue("q", 0), RawValue("b", 0), RawValue("b", 0)
        self._longest_write = RawValue("d", 0.0)
        context = multiprocessing.get_context("fork")
        self._process = context.Process(target=self._run, args=(most,), daemon=True)

    def __enter__(self) -> NumberedBoard:
        self._process.start()  # before any browser: a fork of its pipes would keep it from ending
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        os.close(self._slave)
        os.close(self._master)

    def start(self) -> None:
        """Begin to send."""
        self._go.value = 1

    def stop(self) -> int:
        """End; the number of lines that were sent, the last one whole."""
        self._end.value = 1
        if self._process.pid is not None:
            self._process.join(timeout=5.0)
            self._process.kill()
        return self.sent

    @property
    def sent(self) -> int:
        """Lines that are written."""
        return int(self._sent.value)

    @property
    def longest_write(self) -> float:
        """Longest wait of a write, because nothing was read, s; a real board would have lost lines."""
        return float(self._longest_write.value)

    def written(self) -> NDArray[np.float64]:
        """Monotonic moment at which each line was written, s, shape (sent,)."""
        return np.frombuffer(self._written)[: self.sent]

    def _run(self, most: int) -> None:
        names = ",".join(["wave", "number", *(f"times{j}" for j in range(2, self.channels))])
        while not self._go.value and not self._end.value:
            time.sleep(TICK)
        os.write(self._master, f"# numbered lines\n{names}\n".encode())
        written, begin, sent = np.frombuffer(self._written), time.monotonic(), 0
        while sent < most and not self._end.value:
            now = time.monotonic()
            due = min(int((now - begin) * self.rate) + 1, most)
            if due > sent:
                data = "".join(f"{line(number, self.channels)}\n" for number in range(sent, due)).encode()
                before = time.monotonic()
                written[sent:due] = before
                while data:
                    data = data[os.write(self._master, data) :]
                self._longest_write.value = max(self._longest_write.value, time.monotonic() - before)
                self._sent.value = sent = due
            time.sleep(TICK)


class RecordedRows:
    """Looks through a recording of the board while it grows: is a line missing, doubled or changed?"""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path, self._at, self._rest = path, 0, b""
        self.rows = self.wrong = 0
        self.first = -1
        """Number of the first line that was recorded; -1 = none yet."""
        self.account = ""
        """The recorder's last line."""

    def look(self) -> None:
        """Check what was written since the last look."""
        with open(self._path, "rb") as file:
            file.seek(self._at)
            data = self._rest + file.read()
            self._at = file.tell()
        *lines, self._rest = data.split(b"\n")
        for one in lines:
            if one.startswith(b"#"):
                self.account = one.decode() if one.startswith(b"# end:") else self.account
            elif one[:1].isdigit():
                self._check(one.decode().split(","))

    def _check(self, cells: list[str]) -> None:
        value, number = float(cells[1]), int(float(cells[2]))
        if self.first < 0:
            self.first = number
        expected = self.first + self.rows + self.wrong
        if number == expected and value == wave(number) / 1e8:
            self.rows += 1
        else:
            self.wrong += 1
