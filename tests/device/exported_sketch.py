"""Exported sketches for the simulated Uno, with the edits of the tests, and how long a step takes there."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import serial
from tests.support.board import EEPROM, FLAT_OUT, Firmware, Uno, Workshop, read_lines
from tests.support.waiting import PATIENCE

from kalscope.export.job import ExportJob
from kalscope.export.targets.arduino import files
from kalscope.tuning.tuning import ChannelTuning

FAST = ((r"(?<=BAUD = )115200", "1000000"), (r"(?<=PERIOD_US = )\d+", "1000"))
"""A faster line, and samples as dense as the board can filter."""
MISSING = (r"return analogRead\((.*)\);", "int n = analogRead(PINS[channel]); return n > 0 ? n : NAN;")
"""A count of 0 is no sample."""
TIMING = r"""
volatile float z, x;
DECLARED
unsigned long spent(bool running) {
  const unsigned long start = micros();
  for (int i = 0; i < 1000; i++) {
    z = 500 + (i & 31);
    STEP
  }
  return micros() - start;
}
void setup() {
  Serial.begin(115200);
  START
  Serial.println(spent(true) - spent(false));
}
void loop() {}
"""


def saved(folder: Path, *channels: ChannelTuning, **kind: bool) -> Path:
    """The sketch of an export of channels, or of one fusion, as it leaves."""
    texts = files(ExportJob(channels, sample_period=0.005), **kind)
    folder.mkdir(exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="ascii")
    return folder / next(name for name in texts if name.endswith(".ino"))


def exported(
    workshop: Workshop,
    *channels: ChannelTuning,
    edits: tuple[tuple[str, str], ...] = FAST,
    calibration: bool = False,
) -> Firmware:
    """The firmware of an export, after these edits."""
    folder = workshop.folder / f"export-{abs(hash((channels, calibration))):x}"
    return workshop.sketch(saved(folder, *channels, calibration=calibration), *edits, include=[EEPROM])


def step_us(
    start_board: Callable, workshop: Workshop, sketch: Path, step: str, declared: str = "", start: str = ""
) -> float:
    """How long a step takes on the board, µs; it has `running`, `z` and `x`, and the headers beside the sketch."""
    headers = "".join(f'#include "{path.name}"\n' for path in sorted(sketch.parent.glob("*.h")))
    text = headers + TIMING.replace("DECLARED", declared).replace("STEP", step).replace("START", start)
    timing = sketch.with_name("timing.ino")
    timing.write_text(text, encoding="ascii")
    board = start_board(workshop.sketch(timing, include=[EEPROM]), 0, *FLAT_OUT, name=f"timing-{abs(hash(step)):x}")
    return int(read_lines(board.port, 1)[0]) / 1000


def printed_rows(board: Uno, lines: int) -> np.ndarray:
    """The numbers of the first lines but for remarks, float32, shape (rows, columns); the board then stops."""
    cells = [line.split(b",") for line in read_lines(board.port, lines, 1_000_000) if not line.startswith(b"#")]
    board.stop()
    return np.array([[float(cell) for cell in row] for row in cells], dtype=np.float32)


def without_zeros(counts: np.ndarray, rows: int) -> np.ndarray:
    """The samples that `MISSING` makes of the first counts."""
    return np.where(counts[:rows] == 0, np.nan, counts[:rows]).astype(np.float32)


class Talk:
    """The open port of a board: every row that comes, and every remark with the number of rows before it."""

    def __init__(self, board: Uno) -> None:
        self.port = serial.Serial(board.port, 1_000_000, timeout=PATIENCE)
        self.rows, self.said = list[list[float]](), list[tuple[int, str]]()

    def line(self) -> str:
        text = self.port.readline().decode()
        assert text.endswith("\n"), "the board fell silent"
        text = text[max(text.find("#"), 0) :].strip()  # a reset cuts the line before it
        if not text.startswith("#"):
            self.rows.append([float(cell) for cell in text.split(",")])
        elif not text.startswith("# too slow"):
            self.said.append((len(self.rows), text))
        return text

    def follow(self, rows: int) -> None:
        """Read so many more rows."""
        goal = len(self.rows) + rows
        while len(self.rows) < goal:
            self.line()

    def until(self, words: str, times: int = 1) -> list[str]:
        """Read on until so many remarks match, a regular expression; those."""
        found, last = list[str](), len(self.rows) + 5000
        while len(found) < times:
            text = self.line()
            assert len(self.rows) < last, f"the board does not say {words}"
            found += [text] if text.startswith("#") and re.search(words, text) else []
        return found

    def ask(self, command: str, words: str, times: int = 1) -> list[str]:
        """Send a command and read until it is answered."""
        self.port.write(f"{command}\n".encode())
        return self.until(words, times)
