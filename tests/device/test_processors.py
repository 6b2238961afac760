"""The exported code on other processors: compiled without a warning, and bit-equal where QEMU runs it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exported_program import spiky
from processor import PROCESSORS, Processor
from required import not_here

from kalscope import ChannelTuning
from kalscope.export.float32 import filter_float32
from kalscope.export.job import ExportJob
from kalscope.export.targets import arduino, c
from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, OneEuro

pytestmark = pytest.mark.device
CHANNELS = (
    ChannelTuning("plain", "V", 0.01, 4.0),
    ChannelTuning("gated", "V", 0.3, 20.0, 10.0, gate=9.0),
    ChannelTuning("r0", "V", 0.2, 0.0, 3.0),
    ChannelTuning("slow", "V", 3e-15, 30.0, 1.2e-6, 0.5),
)
WITH_MOMENTUM = (*(replace(channel, momentum=20.0) for channel in CHANNELS), CHANNELS[0])
CHAINS = (
    ChannelTuning("flex", "V", 0.3, 20.0, gate=9.0, momentum=20.0, chain=Chain(5)),
    ChannelTuning("tilt", "V", 1.0, 1.0, chain=Chain(3, OneEuro(0.004, 0.02, 0.05))),
    ChannelTuning("hum", "V", 1.0, 1.0, chain=Chain(then=Butterworth(0.02))),
    ChannelTuning("mean", "V", 1.0, 1.0, chain=Chain(then=MovingAverage(25))),
    ChannelTuning("middle", "V", 1.0, 1.0, chain=Chain(3, Median(9))),
    ChannelTuning("smooth", "V", 1.0, 1.0, chain=Chain(5, Exponential(0.1))),
    ChannelTuning("rest", "V", 0.01, 20.0, fast=1e4, spikes=0.01),
    CHANNELS[1],
)
FUSION = ChannelTuning(
    "level",
    "V",
    4.0,
    (90.0, 25.0, 400.0),
    sensors=("a", "b", "c"),
    offset=(0.0, 12.5, -30.0),
    gain=(1.0, 1.05, 0.9),
    gate=9.0,
    momentum=20.0,
)
CPP = """\
#include "KalscopeFilter.h"
KalscopeFilter filter(KALSCOPE_TUNING_PLAIN);
float update(float z);
float update(float z) { return filter.update(z); }
"""
DOCS = Path(__file__).parents[2] / "docs/device.md"


@pytest.fixture(params=PROCESSORS, ids=lambda processor: processor.name)
def processor(request):
    if request.param.missing:
        not_here(f"{', '.join(request.param.missing)} is not installed")
    return request.param


def compiled(processor, folder, texts, *flags):
    """The C filter of an export, compiled for float."""
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="ascii")
    return processor.compile(folder / "kalscope_filter.c", "-DKALSCOPE_FLOAT", *flags)


@pytest.mark.parametrize("channels", [CHANNELS, WITH_MOMENTUM], ids=["five lines", "momentum"])
def test_c_and_cpp_compile_without_a_warning_and_c_answers_the_same_bits(processor, tmp_path, channels):
    job, z = ExportJob(channels), spiky(3000, np.float32)
    sketch = tmp_path / "sketch.cpp"
    (tmp_path / "KalscopeFilter.h").write_text(arduino.files(job)["KalscopeFilter.h"])
    sketch.write_text(CPP)
    processor.compile(sketch)
    made = compiled(processor, tmp_path, c.files(job))
    if processor.machine:
        answers, _ = processor.emulate(made, tuple(f"kalscope_tuning_{name}" for name in job.identifiers), z)
        for answer, channel in zip(answers, channels, strict=True):
            np.testing.assert_array_equal(answer, filter_float32(z, channel.params), err_msg=channel.name)


def test_chains_two_speeds_and_a_fusion_compile_without_a_warning_and_answer_the_same_bits(processor, tmp_path):
    job, z = ExportJob(CHAINS), spiky(3000, np.float32)[600:1200]
    made = compiled(processor, tmp_path, c.files(job))
    fusion = ExportJob((FUSION,))
    for name, text in c.files(fusion).items():
        (tmp_path / name).write_text(text, encoding="ascii")
    fused = processor.compile(tmp_path / "kalscope_fusion.c", "-DKALSCOPE_FLOAT")
    sketch = tmp_path / "sketch.cpp"
    (tmp_path / "KalscopeFilter.h").write_text(arduino.files(ExportJob(CHAINS[:3]))["KalscopeFilter.h"])
    sketch.write_text(CPP.replace("PLAIN", "FLEX"))
    processor.compile(sketch)
    if processor.machine:
        names = tuple(f"kalscope_tuning_{name}" for name in job.identifiers)
        constant = f"kalscope_fusion_tuning_{fusion.identifiers[-1]}"
        answers, _ = processor.emulate(made, names, z, (fused, constant))
        for answer, channel in zip(answers[:-1], CHAINS, strict=True):
            np.testing.assert_array_equal(answer, filter_float32(z, channel), err_msg=channel.name)
        rows = np.column_stack([np.roll(z, -sensor) for sensor in range(len(FUSION.sensors))])
        np.testing.assert_array_equal(answers[-1], filter_float32(rows, FUSION.params))


def test_the_stated_costs_are_true(processor, tmp_path):
    """The table of docs/device.md, to 5 %: compilers differ a little from version to version."""
    stated = dict(re.findall(r"^\| ([\w+-]+) \|(.*)\|$", DOCS.read_text(), re.MULTILINE))[processor.name]
    for cell, channel in zip(stated.split("|")[1:], (CHANNELS[0], WITH_MOMENTUM[0]), strict=True):
        figures = cost(processor, tmp_path, channel)
        numbers = [float(number.replace(",", "")) for number in re.findall(r"\d[\d,]*", cell)]
        np.testing.assert_allclose(figures, numbers, rtol=0.05)


def cost(processor: Processor, folder: Path, channel: ChannelTuning) -> list[float]:
    """Bytes of code with one tuning, and instructions of a sample where it can be run."""
    made = compiled(processor, folder, c.files(ExportJob((channel,))))
    if not processor.machine:
        return [processor.size(made)]
    _, (instructions,) = processor.emulate(
        made, ("kalscope_tuning_" + ExportJob((channel,)).identifiers[0],), spiky(3000, np.float32)
    )
    return [processor.size(made), instructions]
