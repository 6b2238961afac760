"""A sketch that measures r, in a simulated Uno: 20 noise levels at 5 resolutions, against the host on its rows.

One sketch has five channels, each with a converter of another step, and measures all at once, one run per level.
The rows that it prints are what the host computes with. Exit status 1 where a figure differs by more than 1 % from
the host's, or one of twenty is refused. Needs what the device tests need: avr-gcc,
arduino-core-avr, libsimavr-dev.

    python benchmarks/board_noise.py [--quick]
"""

from __future__ import annotations

import argparse
import importlib
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import serial
from numpy.typing import NDArray

from kalscope import ChannelTuning, Tuning, export_tuning
from kalscope.estimation.noise import noise_from_still
from kalscope.export.board import Calibrated, NotCalibrated, read_calibration

STEPS = (0.25, 1.0, 2.0, 4.0, 8.0)
"""Resolution of each channel, unit."""
SIGMAS = np.geomspace(0.3, 30.0, 20)
"""Standard deviation of the noise before it is rounded, unit; the finest channel still has room for the largest."""
SECONDS, PERIOD = 1.0, 0.001
"""Length of a measurement, and the sample period that the simulated board is given, s."""
SPARE = 60
"""Rows of a signal beyond those of a measurement: the board has begun when it is asked."""


@dataclass(frozen=True)
class Cell:
    """One measurement of one channel."""

    said: Calibrated | NotCalibrated
    """What the board answered."""
    host: float
    """r of `noise_from_still` in the rows that the board measured, unit²; NaN where the board refused."""

    @property
    def share(self) -> float:
        """By how much the board's figure is off the host's."""
        return abs(float(self.said.r) / self.host - 1.0) if isinstance(self.said, Calibrated) else np.nan


def tools() -> Any:
    """The compiler and the simulator of the device tests."""
    support = Path(__file__).resolve().parents[1] / "tests/support"
    sys.path[:0] = [str(support / name) for name in ("simulated_board", "starting", "")]
    return importlib.import_module("board")


def counts_of(sigma: float, rows: int) -> NDArray[np.intp]:
    """Counts of the converter, a column a channel: noise about a level, with spikes and a slow drift."""
    rng = np.random.default_rng([21, round(100.0 * sigma)])
    z = rng.normal(0.0, sigma, rows) + np.linspace(0.0, 0.7 * sigma, rows) + 0.3
    z[rng.integers(rows // 5, rows, 4)] += 45.0 * sigma + 60.0
    return np.clip(512 + np.rint(z[:, None] / np.array(STEPS)), 0, 1023).astype(np.intp)


def firmware(board: Any, workshop: Any, folder: Path) -> Any:
    """The exported sketch with a step for each channel."""
    tuning = Tuning(tuple(ChannelTuning(f"c{i}", "", 0.01, 4.0) for i in range(len(STEPS))), sample_period=PERIOD)
    for name, text in export_tuning(tuning, "arduino", calibration=True).items():
        (folder / name).write_text(text)
    known = ", ".join(f"{{{step}, -INFINITY, INFINITY}}" for step in STEPS)
    edits = (
        (r"(?<=BAUD = )115200", "1000000"),
        (r"return analogRead\((.*)\);", "return (analogRead(PINS[channel]) - 512) * READINGS[channel].step;"),
        (r"(?=// What the filter takes)", f"struct {{ float step, low, high; }} const READINGS[] = {{{known}}};\n"),
        (r"one.start\(rows, KALSCOPE_READINGS\)", "one.start(rows, {READINGS[channel].step, -INFINITY, INFINITY})"),
    )
    return workshop.sketch(folder / "kalscope_filter.ino", *edits, include=[board.EEPROM])


def measured(port: serial.Serial) -> list[Cell]:
    """Let the board measure all channels at once; a cell for each."""
    rows: list[list[float]] = []
    cells: dict[int, Cell] = {}
    port.write(f"c {SECONDS}\n".encode())
    while len(cells) < len(STEPS):
        line = port.readline().decode()
        answer = read_calibration(line.strip())
        if not line.startswith("#"):
            rows.append([float(cell) for cell in line.split(",")[::2]])
        elif answer is not None:
            channel = int(answer.name[1:])
            cells[channel] = _cell(answer, np.array(rows)[:, channel], STEPS[channel])
    return [cells[channel] for channel in range(len(STEPS))]


def _cell(answer: Calibrated | NotCalibrated, z: NDArray[np.float64], step: float) -> Cell:
    host = noise_from_still(z[-answer.rows :], step).r if isinstance(answer, Calibrated) else np.nan
    return Cell(answer, host)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="four noise levels")
    levels = SIGMAS[::6] if parser.parse_args().quick else SIGMAS
    board, table = tools(), list[list[Cell]]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        workshop = board.Workshop(folder)
        sketch = firmware(board, workshop, folder)
        for sigma in levels:
            counts = board.write_counts(folder / "counts.txt", counts_of(sigma, round(SECONDS / PERIOD) + SPARE))
            options = ("--adc", counts, *board.FLAT_OUT)
            uno = board.Uno(workshop.uno, sketch, folder / "port", folder / "log", options)
            with serial.Serial(uno.port, 1_000_000, timeout=60.0) as port:
                table.append(measured(port))
            uno.stop()
    print("sigma   r of the board in step²/12, and its distance from the host's r, at a step of")
    print("".join(["        ", *(f"{step:<22g}" for step in STEPS)]))
    for sigma, cells in zip(levels, table, strict=True):
        words = [f"{_text(cell, step):<22}" for cell, step in zip(cells, STEPS, strict=True)]
        print(f"{sigma:<8.3g}{''.join(words)}")
    flat = [cell for cells in table for cell in cells]
    shares = np.array([cell.share for cell in flat])
    refused = int(np.isnan(shares).sum())
    print(f"{len(flat)} figures: largest distance {100.0 * np.nanmax(shares):.2g} %, refused {refused}")
    return int(np.nanmax(shares) > 0.01 or refused > len(flat) // 20)


def _text(cell: Cell, step: float) -> str:
    if isinstance(cell.said, NotCalibrated):
        return cell.said.reason[:20]
    floors = float(cell.said.r) / (step * step / 12.0)
    return f"{floors:<8.4g} {100.0 * cell.share:.1e} %"


if __name__ == "__main__":
    sys.exit(main())
