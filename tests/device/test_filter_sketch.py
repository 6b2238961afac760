"""The exported sketch, compiled by avr-gcc and run in a simulated Uno: the same bits as the host's float32 run."""

from __future__ import annotations

import re

import numpy as np
import pytest
import serial
from board import FLAT_OUT

from kalscope.errors import BadSetting
from kalscope.export import ExportJob
from kalscope.export.arduino import files
from kalscope.export.float32 import Float32Params
from kalscope.tuning import ChannelTuning

pytestmark = pytest.mark.device

FAST = (
    (r"(?<=BAUD = )115200", "1000000"),
    (r"(?<=PERIOD_US = )\d+", "1000"),
)
TRIPLES = [
    (0.01, 4.0, None),
    (1e-3, 25.0, 1000.0),
    (0.05, 0.3, 0.0),
    (2.0, 2.0, 1.0),
    (1e-5, 9.7, 100.0),
    (1.0, 100.0, 1.0),
    (30.0, 0.1, None),
    (0.0, 4.0, 50.0),
    (0.7, 0.0, 3.0),
    (1e-7, 1e-3, 1e-9),
    (123.456, 7890.1, 1e6),
    (1e-10, 3.3, 12.0),
]


class Float32Oracle:
    """The five lines in numpy's float32, one operation a rounding, as a person would write them."""

    def __init__(self, q, r, p0):
        self.q, self.r, self.x, self.p = np.float32(q), np.float32(r), np.float32(np.nan), np.float32(p0)

    def update(self, z):
        z, p = np.float32(z), self.p + self.q
        k = p / (p + self.r) if np.isfinite(p) else np.float32(1.0)
        self.p = (np.float32(1.0) - k) * p if np.isfinite(p) else self.r
        self.x = z if np.isnan(self.x) else self.x + k * (z - self.x)
        return self.x


def noisy_counts(n, seed=8):
    rng = np.random.default_rng(seed)
    return np.clip(np.rint(512 + 300 * np.sin(np.arange(n) / 90) + rng.normal(0, 15, n)), 1, 1023).astype(int)


def exported(workshop, *channels, edits=FAST):
    """The firmware of an export, with the line made faster and samples as dense as the board can filter."""
    folder = workshop.folder / f"export-{abs(hash(channels)):x}"
    folder.mkdir(exist_ok=True)
    for name, text in files(ExportJob(tuple(channels), sample_period=0.005)).items():
        (folder / name).write_text(text, encoding="ascii")
    return workshop.sketch(folder / "kalscope_filter.ino", *edits)


class Conversation:
    """An open port, and an oracle that is fed what the converter is fed; every line that comes is compared."""

    def __init__(self, port, counts, oracle):
        self.port, self.counts, self.oracle, self.rows = port, iter(counts), oracle, 0

    def follow(self, rows):
        """Read and compare so many samples."""
        goal = self.rows + rows
        while self.rows < goal:
            self._check(self.port.readline())

    def ask(self, text):
        """Send a command, compare what comes before its answer; returns the values it answers, from their bits."""
        self.port.write(text.encode() + b"\n")
        while (found := re.search(rb"bits=(\w{8}),(\w{8}),(\w{8})", line := self.port.readline())) is None:
            self._check(line)
        return [np.uint32(int(bits, 16)).view(np.float32) for bits in found.groups()]

    def _check(self, line):
        if line.startswith(b"# too slow"):
            return
        raw, filtered = line.split(b",")
        z = next(self.counts)
        assert int(float(raw)) == z
        assert np.float32(float(filtered)).view(np.uint32) == self.oracle.update(z).view(np.uint32), line
        self.rows += 1


def test_the_board_prints_the_bits_of_the_host_also_after_changes_while_it_runs(start_board, workshop):
    counts = noisy_counts(20_000)
    firmware = exported(workshop, ChannelTuning("raw", "", *TRIPLES[0]))
    board = start_board(firmware, counts, *FLAT_OUT)
    with serial.Serial(board.port, 1_000_000, timeout=30) as port:
        assert port.readline() == b"# raw,filtered\r\n"
        talk = Conversation(port, counts, Float32Oracle(*TRIPLES[0][:2], np.inf))
        for q, r, p0 in TRIPLES[1:]:
            talk.follow(750)
            # 0 is no noise at all: the other one first, because both at once are refused.
            order = sorted((("q", q), ("r", r)), key=lambda pair: pair[1] == 0)
            for letter, value in order:
                used = talk.ask(f"{letter} {value}")
                talk.oracle.q, talk.oracle.r = used[:2]
            used = talk.ask(f"p {'inf' if p0 is None else p0}")
            np.testing.assert_allclose(used, [q, r, np.inf if p0 is None else p0], rtol=3e-7)
            talk.oracle = Float32Oracle(*used)
        talk.follow(max(750, 10_000 - talk.rows))
