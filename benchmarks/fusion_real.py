"""Several sensors of one quantity in real recordings: the fused value against each sensor alone.

Everything is found in the first half of a recording, scale and offset of each sensor beside the first one too, and
judged on the second:

- *next reading*: each sensor's next reading is predicted, by its own filter and by the fused one;
- *hidden stretch*: the sensor is hidden in every second stretch of rows and predicted there: by its own filter,
  which holds its last value, by the other sensors alone, and by the fused filter;
- *reference*: error of the filtered values against an independent sensor, where the recording has one. Its scale
  and zero are those that suit each best, so that none gains from its offset.

Run: python benchmarks/fusion_real.py [FOLDER], the folder of the recordings (see Case.path); missing ones are left
out. With --picture FILE.svg the first case is drawn.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import kalscope
from kalscope.common.charts import Line, Panel, draw_svg
from kalscope.common.numbers import Array
from kalscope.common.text import number
from kalscope.estimation.fusion import estimate_fusion
from kalscope.filtering.filter import fuse
from kalscope.filtering.params import FilterParams
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions, options_from_text
from kalscope.sources.reading.recording_file import read_recording


@dataclass(frozen=True)
class Case:
    """Sensors of one quantity in one recording."""

    title: str
    """What they measure."""
    path: str
    """The file in the folder of the recordings."""
    sensors: tuple[str, ...]
    """Its channels."""
    unit: str
    """Unit of the fused value."""
    hidden: int
    """Rows of a hidden stretch."""
    repeats: tuple[int, ...] = ()
    """Sensors slower than the rows, whose repeated value is no new reading; 0 of them is no reading either."""
    encoder: str = ""
    """Independent channel to compare with."""
    reading: ReadOptions = DEFAULTS
    """How the file is read."""


MISSING_200 = options_from_text(missing=("-200",))
CASES = (
    Case(
        "distance to a wall, ToF and ultrasonic on a cart",
        "tof_mcu_kalman/E1_run04.csv",
        ("tof_distance_mm", "us_distance_mm"),
        "mm",
        10,
        repeats=(1,),
        encoder="encoder_distance_mm",
    ),
    Case(
        "the same with obstacles",
        "tof_mcu_kalman/E3_run04.csv",
        ("tof_distance_mm", "us_distance_mm"),
        "mm",
        10,
        repeats=(1,),
    ),
    Case(
        "global irradiance, two pyranometers",
        "solar_stations/midc_raw_20181018.txt",
        ("Global Horiz (tracker)", "Global Horiz (platform)"),
        "W/m²",
        30,
    ),
    Case(
        "carbon monoxide, analyser and metal oxide",
        "airquality_uci/AirQualityUCI.csv",
        ("CO(GT)", "PT08.S1(CO)"),
        "mg/m³",
        12,
        reading=MISSING_200,
    ),
    Case(
        "benzene, analyser and metal oxide",
        "airquality_uci/AirQualityUCI.csv",
        ("C6H6(GT)", "PT08.S2(NMHC)"),
        "µg/m³",
        12,
        reading=MISSING_200,
    ),
)


@dataclass(frozen=True)
class Errors:
    """Root mean squares of one sensor in the second half, in its own unit; NaN where there is none."""

    next_alone: float
    next_fused: float
    hidden_alone: float
    hidden_others: float
    hidden_fused: float


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", nargs="?", type=Path, default=Path(__file__).parents[2] / "shared" / "data")
    parser.add_argument("--picture", type=Path)
    asked = parser.parse_args()
    for case in CASES:
        if not (asked.folder / case.path).is_file():
            print(f"{case.title}: no {case.path}\n")
            continue
        z, recording = readings(case, asked.folder)
        fused, singles = found_in_first_half(case, z)
        print("\n".join(page(case, z, recording, fused, singles)), end="\n\n")
        if asked.picture is not None and case is CASES[0]:
            asked.picture.write_text(picture(case, z, recording, fused), encoding="utf-8")


def readings(case: Case, folder: Path) -> tuple[Array, kalscope.Recording]:
    """The readings of the sensors, shape (n, sensors)."""
    recording = read_recording(folder / case.path, case.reading)
    z = recording.values[:, [recording.index(name) for name in case.sensors]].copy()
    for i in case.repeats:
        again = np.concatenate(([False], z[1:, i] == z[:-1, i]))
        z[again | (z[:, i] == 0.0), i] = np.nan
    return z, recording


def found_in_first_half(case: Case, z: Array) -> tuple[FilterParams, list[kalscope.FilterParams]]:
    """The fused filter, and the filter of each sensor alone."""
    half = z[: len(z) // 2]
    found = estimate_fusion(half, names=case.sensors, gains=True, reference=0)
    print(f"{case.title}: {found.verdict}. {found.message}")
    if found.params is None:
        raise SystemExit(f"no fusion of {case.path}")
    singles = [kalscope.estimate(column).params for column in half.T]
    # Where no noise is seen the best prediction of a sensor's next reading is its last one.
    return found.params, [one or kalscope.FilterParams(q=1.0, r=0.0) for one in singles]


def page(
    case: Case,
    z: Array,
    recording: kalscope.Recording,
    fused: FilterParams,
    singles: list[kalscope.FilterParams],
) -> Iterator[str]:
    """The table of one case."""
    yield f"  {'':24}{'noise σ':>9}{'offset':>9}{'share':>8} | next reading      | hidden stretch"
    yield f"  {'':24}{'':>9}{'':>9}{'':>8} | {'alone':>8}{'fused':>9} | {'alone':>8}{'others':>9}{'fused':>9}"
    for i, name in enumerate(case.sensors):
        one = errors_of(z, i, fused, singles[i], case.hidden)
        sigma, offset = number(math.sqrt(fused.sensor_r[i])), number(float(fused.offset[i]))
        yield (
            f"  {name[:24]:24}{sigma:>9}{offset:>9}{100.0 * fused.shares[i]:>6.0f} % | "
            f"{number(one.next_alone):>8}{number(one.next_fused):>9} | "
            f"{number(one.hidden_alone):>8}{number(one.hidden_others):>9}{number(one.hidden_fused):>9}"
        )
    if case.encoder:
        truth = recording.channel(case.encoder)
        values = {
            **{
                f"{name} filtered": kalscope.kalman_filter(z[:, i], singles[i]).x
                for i, name in enumerate(case.sensors)
            },
            "fused": fuse(z, fused).x,
        }
        said = ", ".join(f"{name} {number(beside(x, truth))}" for name, x in values.items())
        yield f"  RMS beside {case.encoder} ({case.unit}): {said}"


def errors_of(z: Array, i: int, fused: FilterParams, single: kalscope.FilterParams, rows: int) -> Errors:
    """How well sensor i is predicted in the second half."""
    n, order = len(z), [i, *(j for j in range(z.shape[1]) if j != i)]
    first = fused.only(order)  # sensor i before the others of its row, so that its innovation knows none of them
    late = np.arange(n) >= n // 2
    ahead = fuse(z[:, order], first).innovation[:, 0]
    alone = kalscope.kalman_filter(z[:, i], single)
    hidden = late & ((np.arange(n) // rows) % 2 == 1)
    masked = z.copy()
    masked[hidden, i] = np.nan
    holding = kalscope.kalman_filter(masked[:, i], single).x
    others = fused.only(order[1:])
    expected = [fuse(z[:, order[1:]], others).x, fuse(masked, fused).x]
    by_others, by_all = (fused.offset[i] + fused.gain[i] * x for x in expected)
    real = hidden & np.isfinite(z[:, i])
    both = late & np.isfinite(alone.innovation) & np.isfinite(ahead)
    return Errors(
        rms(alone.innovation[both]),
        rms(ahead[both]),
        *(rms((x - z[:, i])[real]) for x in (holding, by_others, by_all)),
    )


def beside(x: Array, truth: Array) -> float:
    """RMS of what is left of x after the straight line through the truth that suits it best."""
    good = np.isfinite(x)
    design = np.column_stack([truth[good], np.ones(good.sum())])
    return rms(x[good] - design @ np.linalg.lstsq(design, x[good], rcond=None)[0])


def rms(error: Array) -> float:
    """Root mean square of finite errors; NaN of none."""
    return math.sqrt(float(np.mean(error * error))) if len(error) else math.nan


def picture(case: Case, z: Array, recording: kalscope.Recording, fused: FilterParams) -> str:
    """The readings without their offsets and the fused value."""
    corrected, x = (z - fused.offset) / fused.gain, fuse(z, fused).x
    styles = ("raw", "s1", "s3")
    shown = slice(0, len(z))
    lines = [
        Line(recording.time[shown][good], corrected[shown, i][good], name, style)
        for i, (name, style) in enumerate(zip(case.sensors, styles, strict=False))
        for good in [np.isfinite(corrected[shown, i])]
    ]
    lines.append(Line(recording.time[shown], x[shown], "fused", "s2"))
    panel = Panel(case.title, tuple(lines), "time (s)", case.unit)
    return draw_svg([panel], case.title).replace("<svg ", '<svg style="background:#fff" ', 1)


if __name__ == "__main__":
    main()
