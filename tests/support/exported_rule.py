"""The rule by which a sketch measures r, as it is exported, compiled for this computer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tests.support.exported_program import build

from kalscope import ChannelTuning, Tuning, export_tuning

LEARNING, GROUPS = 16, 8
"""Readings that only show the level, and the groups that are measured after one that shows the spread."""

STATES = [
    "IDLE", "MEASURING", "FOUND", "MISSING", "SPIKES", "TOO_FEW",
    "CUT_OFF", "EQUAL", "MOVING", "UNEVEN", "DEPENDENT", "TOO_LARGE",
]  # fmt: skip
MAIN = r"""
#include <stdio.h>
#include "KalscopeCalibration.h"
int main() {
  KalscopeReadings readings;
  KalscopeCalibration one;
  uint32_t n;
  float z;
  if (fread(&readings, sizeof readings, 1, stdin) != 1 || fread(&n, 4, 1, stdin) != 1) return 1;
  if (!one.start(n, readings)) return 2;
  while (fread(&z, 4, 1, stdin) == 1) one.take(z);
  printf("%d %.9g %.9g %.9g", one.state, one.r, one.variance, one.step);
  printf(" %d %d %d %d\n", one.used, one.spikes, one.missing, one.cut_off);
}
"""


def rows_of(seconds, period):
    """Rows that a measurement takes."""
    return LEARNING + (GROUPS + 1) * ((round(seconds / period) - LEARNING) // (GROUPS + 1))


@dataclass(frozen=True)
class Found:
    """What the rule says at the end."""

    state: str
    r: np.float32
    variance: np.float32
    step: np.float32
    used: int
    spikes: int
    missing: int
    cut_off: int


def compiled_rule(folder):
    """measure(z, step, lowest, highest) -> `Found`."""
    texts = export_tuning(Tuning((ChannelTuning("light", "", 0.01, 4.0),)), "arduino", calibration=True)
    header = {"KalscopeCalibration.h": texts["KalscopeCalibration.h"]}
    run = build(
        folder, "g++", header, MAIN, "-O2", "-Wno-class-memaccess", "-Wno-conversion", "-Wno-double-promotion"
    )

    def measure(z, step=0.0, lowest=-np.inf, highest=np.inf):
        known, samples = np.array([step, lowest, highest], np.float32), np.asarray(z, np.float32)
        state, *values = run(known.tobytes() + np.uint32(len(samples)).tobytes() + samples.tobytes()).split()
        return Found(STATES[int(state)], *map(np.float32, values[:3]), *map(int, values[3:]))

    return measure
