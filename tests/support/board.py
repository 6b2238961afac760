"""Tools of the device tests: compile a sketch for the Uno, and run it in simavr behind a pseudo-terminal."""

from __future__ import annotations

import hashlib
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import serial
from filelock import FileLock
from numpy.typing import ArrayLike
from tests.support.waiting import PATIENCE

HERE = Path(__file__).parent
SKETCHES = HERE.parents[1] / "arduino"
ARDUINO = Path("/usr/share/arduino/hardware/arduino/avr")
EEPROM = ARDUINO / "libraries/EEPROM/src"
SIMAVR = Path("/usr/include/simavr")

CHIP = ["-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_AVR_UNO", "-DARDUINO_ARCH_AVR"]
PATHS = [f"-I{ARDUINO}/cores/arduino", f"-I{ARDUINO}/variants/standard"]
COMMON = ["-c", "-Os", "-flto", "-ffunction-sections", "-fdata-sections", *CHIP, *PATHS]
# Debian's avr-gcc 5.4 hides DECIMAL_DIG from C++, and the core's WString.cpp wants it.
CXX_FLAGS = ["-std=gnu++11", "-fpermissive", "-fno-exceptions", "-fno-threadsafe-statics"]
CXX = ["avr-g++", *COMMON, *CXX_FLAGS, "-DDECIMAL_DIG=__DECIMAL_DIG__"]
COMPILER = {
    ".c": ["avr-gcc", *COMMON, "-std=gnu11"],
    ".cpp": CXX,
    ".S": ["avr-gcc", *COMMON, "-x", "assembler-with-cpp"],
}

FLAT_OUT = ("--speed", "0", "--wait-open")
"""Options for all that is numerical: the same bytes at every run, from the first, however slow the machine."""


def missing() -> list[str]:
    """What is not installed; empty where a sketch can be compiled and run."""
    if sys.platform != "linux":
        return ["Linux"]
    programs = [name for name in ("avr-gcc", "avr-g++", "avr-gcc-ar", "avr-size", "cc") if not shutil.which(name)]
    packages = {"arduino-core-avr": ARDUINO / "cores/arduino/Arduino.h", "libsimavr-dev": SIMAVR / "sim_avr.h"}
    return programs + [name for name, file in packages.items() if not file.is_file()]


@dataclass(frozen=True)
class Firmware:
    """A sketch, compiled."""

    elf: Path
    """What the simulator runs."""
    flash: int
    """Bytes of program memory, of an Uno's 32,256."""
    ram: int
    """Bytes of static memory, of an Uno's 2,048."""


@dataclass(frozen=True)
class Workshop:
    """Compiles into one folder, which all workers of a test run share: nothing is compiled twice."""

    folder: Path
    """Where all that is made goes."""

    @property
    def _lock(self) -> FileLock:
        return FileLock(self.folder / "lock", timeout=PATIENCE)

    def sketch(self, source: Path, *edits: tuple[str, str], include: Sequence[Path] = ()) -> Firmware:
        """Compile `source` (.ino), after replacing each regular expression of `edits`, as its user would edit it.

        Each expression must be found exactly once. `include`: folders with further headers; that of the sketch
        is always among them. The compiler's warnings are errors here, except those of the Arduino core.
        """
        text = source.read_text(encoding="utf-8")
        for pattern, value in edits:
            text, found = re.subn(pattern, value.replace("\\", r"\\"), text)
            assert found == 1, f"{pattern!r} stands {found} times in {source.name}"
        headers = [header.read_text() for folder in (source.parent, *include) for header in folder.glob("*.h")]
        digest = hashlib.sha256("\0".join((text, *headers)).encode()).hexdigest()[:12]
        elf = self.folder / f"{source.stem}-{digest}.elf"
        with self._lock:
            if not elf.exists():
                self._compile(text, elf, [source.parent, *include])
        text_size, data, bss = map(int, run("avr-size", elf).splitlines()[1].split()[:3])
        return Firmware(elf, text_size + data, data + bss)

    @property
    def uno(self) -> Path:
        """The simulated board, a program."""
        program = self.folder / "uno"
        with self._lock:
            if not program.exists():
                warnings = ("-Wall", "-Wextra", "-Werror")
                run("cc", "-O2", *warnings, "-o", program, HERE / "uno.c", f"-I{SIMAVR}", "-lsimavr")
        return program

    def _compile(self, text: str, elf: Path, include: list[Path]) -> None:
        source, made = elf.with_suffix(".cpp"), elf.with_suffix(".o")
        source.write_text(f"#include <Arduino.h>\n#line 1\n{text}", encoding="utf-8")
        headers = [f"-I{folder}" for folder in include]
        run(*CXX, "-Wall", "-Wextra", "-Werror", *headers, source, "-o", made)
        linked = ["avr-gcc", "-Os", "-flto", "-fuse-linker-plugin", "-Wl,--gc-sections", "-mmcu=atmega328p", "-w"]
        run(*linked, "-o", elf, made, self._core(), "-lm")

    def _core(self) -> Path:
        """The Arduino core as an archive, made at the first need: its 25 files take half a second."""
        archive = self.folder / "core.a"
        if not archive.exists():
            folder = self.folder / "core"
            folder.mkdir()
            sources = [s for s in sorted((ARDUINO / "cores/arduino").iterdir()) if s.suffix in COMPILER]
            for source in sources:
                run(*COMPILER[source.suffix], "-w", source, "-o", folder / f"{source.name}.o")
            run("avr-gcc-ar", "rcs", archive, *sorted(folder.iterdir()))
        return archive


def run(*command: str | Path, folder: Path | None = None) -> str:
    """Standard output of a command run in a folder; what it complained of is raised where it failed."""
    done = subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True, timeout=PATIENCE)
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))}\n{done.stderr}")
    return done.stdout


class Uno:
    """One simulated board, running. `port` opens like a serial port; see uno.c for the options."""

    def __init__(self, program: Path, firmware: Firmware, port: Path, log: Path, options: Sequence[object]) -> None:
        """Power the board; when this returns, `port` may be opened."""
        self.port = str(port)
        """Path of the serial port."""
        self._log = log
        with log.open("w") as errors:
            self._process = subprocess.Popen(
                list(map(str, (program, "--link", port, *options, firmware.elf))),
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            )
        assert self._process.stdout is not None
        with self._process.stdout as lines:  # simavr says first which .elf it loads
            if not any(line.startswith("READY") for line in lines):
                raise RuntimeError(f"the simulated board did not start: {log.read_text()}")

    def reset(self) -> None:
        """Press the reset button."""
        self._process.send_signal(signal.SIGUSR1)

    def unplug(self) -> None:
        """Pull the plug: the port hangs up at once and unread bytes are lost.

        Its link goes first: the number of its terminal may be that of another board a moment later.
        """
        Path(self.port).unlink()
        self._process.kill()
        self._process.wait(PATIENCE)

    def stop(self) -> dict[str, float]:
        """End the board. Returns its counts by name (see uno.c), {} where the plug was pulled."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
        return self.wait()

    def wait(self) -> dict[str, float]:
        """Wait for a board that ends by itself (`--seconds`), and return its counts by name."""
        self._process.wait(PATIENCE)
        return {name: float(n) for name, n in re.findall(r"(\w+) ([\d.]+)", self._log.read_text())}


def write_counts(path: Path, counts: ArrayLike) -> Path:
    """The file for `--adc`: counts 0 … 1023, () or (n,) for A0, or (n, pins) with a column a pin from A0 on."""
    np.savetxt(path, np.atleast_1d(counts), fmt="%d")
    return path


def read_lines(port: str, n: int, baud: int = 115200) -> list[bytes]:
    """The next n whole lines of a port, newlines kept."""
    with serial.Serial(port, baud, timeout=PATIENCE) as opened:
        lines = [opened.readline() for _ in range(n)]
    assert all(line.endswith(b"\n") for line in lines), "the board fell silent"
    return lines
