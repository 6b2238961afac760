"""Other processors: exported code compiled for them, and run in QEMU where it has one."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from board import run
from numpy.typing import NDArray

HERE = Path(__file__).parent
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-pedantic", "-Werror")
TICK = 40
"""Instructions in a tick of the timer: QEMU takes 1 ns for each, and the timer runs at 25 MHz."""


@dataclass(frozen=True)
class Processor:
    """A kind of processor, and the cross compiler for it."""

    name: str
    """As in docs/device.md."""
    compiler: str
    """Prefix of the compiler's programs."""
    flags: tuple[str, ...]
    """That choose the processor and its C library."""
    machine: str = ""
    """QEMU's machine that runs it; "" = compiled only."""

    @property
    def missing(self) -> list[str]:
        """Programs that are not installed."""
        emulator = ["qemu-system-arm"] if self.machine else []
        return [name for name in (f"{self.compiler}-gcc", *emulator) if not shutil.which(name)]

    def compile(self, source: Path, *flags: str) -> Path:
        """The object file of a C or C++ source, in its folder; every warning is an error."""
        driver, standard = ("g++", "c++11") if source.suffix == ".cpp" else ("gcc", "c99")
        made = source.with_suffix(".o")
        command = [f"{self.compiler}-{driver}", *self.flags, f"-std={standard}", "-Os", *WARNINGS, *flags]
        run(*command, "-c", source, "-o", made)
        return made

    def size(self, made: Path) -> int:
        """Bytes of code and constants of an object file."""
        return int(run(f"{self.compiler}-size", made).splitlines()[1].split()[0])

    def emulate(
        self, made: Path, tunings: tuple[str, ...], z: NDArray[np.float32], fused: tuple[Path, str] | None = None
    ) -> tuple[NDArray[np.float32], list[float]]:
        """Run the exported C filter on samples.

        Args:
            made: `kalscope_filter.o`, compiled for float, beside its header.
            tunings: Names of its constants.
            z: Samples, shape (n,), n ≤ 10,000.
            fused: `kalscope_fusion.o` in the same folder and the name of its constant: its sensor j reads z rolled
                back by j samples.

        Returns:
            The filtered values, shape (tunings, n), the fused ones below them, and the instructions of a sample for
            each tuning.
        """
        folder = made.parent
        z.tofile(folder / "samples.bin")
        names = ", ".join(f"&{name}" for name in tunings)
        (folder / "main.c").write_text((HERE / "main.c").read_text().replace("TUNINGS", names))
        sources = [folder / "main.c", HERE / "vectors.c", made]
        if fused is not None:
            sources += [fused[0], f"-DFUSION={fused[1]}"]
        linking = ("--specs=rdimon.specs", "-T", str(HERE / "board.ld"), "-DKALSCOPE_FLOAT", "-lm")
        command = [f"{self.compiler}-gcc", *self.flags, "-std=gnu99", "-Os"]
        run(*command, *sources, *linking, "-o", folder / "filter.elf")
        quiet = ("-nographic", "-monitor", "none", "-serial", "none")
        counted = ("-icount", "shift=0", "-semihosting-config", "enable=on,target=native")
        said = run("qemu-system-arm", "-M", self.machine, *quiet, *counted, "-kernel", "filter.elf", folder=folder)
        answers = np.fromfile(folder / "filtered.bin", dtype=np.float32).reshape(-1, len(z))
        return answers, [int(ticks) * TICK / len(z) for ticks in said.split()]


THUMB = ("-mthumb",)
PROCESSORS = (
    Processor("Cortex-M0+", "arm-none-eabi", ("-mcpu=cortex-m0plus", *THUMB), "mps2-an385"),
    Processor("Cortex-M3", "arm-none-eabi", ("-mcpu=cortex-m3", *THUMB), "mps2-an385"),
    Processor(
        "Cortex-M4F",
        "arm-none-eabi",
        ("-mcpu=cortex-m4", *THUMB, "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
        "mps2-an386",
    ),
    Processor(
        "RISC-V", "riscv64-unknown-elf", ("-march=rv32imc", "-mabi=ilp32", "--specs=picolibc.specs"), machine=""
    ),
    Processor("Xtensa", "xtensa-lx106-elf", ("--specs=/usr/lib/xtensa-lx106-elf/picolibc.specs",)),
)
"""RP2040, STM32, ESP32-C3, ESP8266. What is compiled for a Cortex-M0+ runs in QEMU on a Cortex-M3, which has all
its instructions."""
