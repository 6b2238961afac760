"""The exported code on other processors: compiled without a warning, and bit-equal where QEMU runs it."""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.support.board import run
from tests.support.exported_program import FUSION, spiky
from tests.support.required import not_here

from kalscope import ChannelTuning
from kalscope.export.float32 import filter_float32
from kalscope.export.job import ExportJob
from kalscope.export.targets import arduino, c
from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, Notch, OneEuro

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
        sources += [fused[0], f"-DFUSION={fused[1]}"] if fused else []
        linking = ("--specs=rdimon.specs", "-T", str(HERE / "board.ld"), "-DKALSCOPE_FLOAT", "-lm")
        command = [f"{self.compiler}-gcc", *self.flags, "-std=gnu99", "-Os"]
        run(*command, *sources, *linking, "-o", folder / "filter.elf")
        quiet = ("-nographic", "-monitor", "none", "-serial", "none")
        counted = ("-icount", "shift=0", "-semihosting-config", "enable=on,target=native")
        said = run("qemu-system-arm", "-M", self.machine, *quiet, *counted, "-kernel", "filter.elf", folder=folder)
        answers = np.fromfile(folder / "filtered.bin", dtype=np.float32).reshape(-1, len(z))
        return answers, [int(ticks) * TICK / len(z) for ticks in said.split()]


THUMB, HARD_FLOAT = ("-mthumb",), ("-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
PROCESSORS = (
    Processor("Cortex-M0+", "arm-none-eabi", ("-mcpu=cortex-m0plus", *THUMB), "mps2-an385"),
    Processor("Cortex-M3", "arm-none-eabi", ("-mcpu=cortex-m3", *THUMB), "mps2-an385"),
    Processor("Cortex-M4F", "arm-none-eabi", ("-mcpu=cortex-m4", *THUMB, *HARD_FLOAT), "mps2-an386"),
    Processor("RISC-V", "riscv64-unknown-elf", ("-march=rv32imc", "-mabi=ilp32", "--specs=picolibc.specs")),
    Processor("Xtensa", "xtensa-lx106-elf", ("--specs=/usr/lib/xtensa-lx106-elf/picolibc.specs",)),
)
"""RP2040, STM32, ESP32-C3, ESP8266. What is compiled for a Cortex-M0+ runs in QEMU on a Cortex-M3, which has all
its instructions."""


pytestmark = pytest.mark.device
CHANNELS = (
    ChannelTuning("plain", "V", 0.01, 4.0),
    ChannelTuning("gated", "V", 0.3, 20.0, 10.0, gate=9.0),
    ChannelTuning("r0", "V", 0.2, 0.0, 3.0),
    ChannelTuning("slow", "V", 3e-15, 30.0, 1.2e-6, 0.5),
)
MOVING = tuple(replace(channel, momentum=20.0) for channel in CHANNELS)
CHAINS = (
    ChannelTuning("flex", "V", 0.3, 20.0, gate=9.0, momentum=20.0, chain=Chain(5)),
    ChannelTuning("tilt", "V", 1.0, 1.0, chain=Chain(3, OneEuro(0.004, 0.02, 0.05))),
    ChannelTuning("slow", "V", 1.0, 1.0, chain=Chain(then=Butterworth(0.02))),
    ChannelTuning("hum", "V", 0.3, 20.0, chain=Chain(notch=Notch(0.2, 0.05))),
    ChannelTuning("mean", "V", 1.0, 1.0, chain=Chain(then=MovingAverage(25))),
    ChannelTuning("middle", "V", 1.0, 1.0, chain=Chain(3, Median(9))),
    ChannelTuning("smooth", "V", 1.0, 1.0, chain=Chain(5, Exponential(0.1))),
    ChannelTuning("rest", "V", 0.01, 20.0, fast=1e4, spikes=0.01),
)
DOCS = Path(__file__).parents[2] / "docs/device.md"
CPP = """\
#include "KalscopeFilter.h"
KalscopeFilter filter(KALSCOPE_TUNING_PLAIN);
float update(float z);
float update(float z) { return filter.update(z); }
"""


@pytest.fixture(params=PROCESSORS, ids=lambda processor: processor.name)
def processor(request):
    if request.param.missing:
        not_here(f"{', '.join(request.param.missing)} is not installed")
    return request.param


def compiled(processor, folder, texts):
    """The C filter of an export, compiled for float."""
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="ascii")
    return processor.compile(folder / next(name for name in texts if name.endswith(".c")), "-DKALSCOPE_FLOAT")


def test_c_and_cpp_compile_without_a_warning_and_c_answers_the_same_bits(processor, tmp_path):
    job, fusion, z = ExportJob(CHANNELS + MOVING + CHAINS), ExportJob((FUSION,)), spiky(3000, np.float32)[600:1200]
    for channels in (CHANNELS, MOVING, CHAINS[:3]):
        (tmp_path / "KalscopeFilter.h").write_text(arduino.files(ExportJob(channels))["KalscopeFilter.h"])
        (tmp_path / "sketch.cpp").write_text(CPP.replace("PLAIN", channels[0].name.upper()))
        processor.compile(tmp_path / "sketch.cpp")
    made, fused = (compiled(processor, tmp_path, c.files(one)) for one in (job, fusion))
    if processor.machine:
        names = tuple(f"kalscope_tuning_{name}" for name in job.identifiers)
        answers, _ = processor.emulate(made, names, z, (fused, f"kalscope_fusion_tuning_{fusion.identifiers[-1]}"))
        for answer, channel in zip(answers[:-1], job.channels, strict=True):
            np.testing.assert_array_equal(answer, filter_float32(z, channel), err_msg=channel.name)
        rows = np.column_stack([np.roll(z, -sensor) for sensor in range(len(FUSION.sensors))])
        np.testing.assert_array_equal(answers[-1], filter_float32(rows, FUSION.params))


def test_the_stated_costs_are_true(processor, tmp_path):
    """The table of docs/device.md, to 5 %: bytes with one tuning, and instructions of a sample where it runs."""
    stated = dict(re.findall(r"^\| ([\w+-]+) \|(.*)\|$", DOCS.read_text(), re.MULTILINE))[processor.name]
    z = spiky(3000, np.float32)
    for cell, channel in zip(stated.split("|")[1:], (CHANNELS[0], MOVING[0]), strict=True):
        made = compiled(processor, tmp_path, c.files(ExportJob((channel,))))
        figures = [processor.size(made)]
        if processor.machine:
            (x,), instructions = processor.emulate(made, ("kalscope_tuning_plain",), z)
            np.testing.assert_array_equal(x, filter_float32(z, channel.params))
            figures += instructions
        numbers = [float(number.replace(",", "")) for number in re.findall(r"\d[\d,]*", cell)]
        np.testing.assert_allclose(figures, numbers, rtol=0.05)
