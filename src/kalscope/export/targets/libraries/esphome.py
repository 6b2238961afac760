"""ESPHome: a Kalman combination sensor, which takes standard deviations, the process noise per √second.

Its component (esphome/components/combination) adds process_std_dev² to the variance per second of the board's
clock, and computes in float32.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from kalscope.errors import BadSetting
from kalscope.export.header_text import about, about_channel, commented, fill_template
from kalscope.export.job import ExportJob
from kalscope.export.names import comment_text, number_text, quoted
from kalscope.export.targets.libraries.nearest import require_no_momentum
from kalscope.tuning.tuning import ChannelTuning

_SENSOR = """\
{about}  - platform: combination
    type: kalman
    id: {word}_filtered
    name: {name}
    process_std_dev: {process}
    sources:
      - source: {word}  # id of your raw sensor
        error: {error}
"""


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_esphome.yaml`.

    Raises:
        BadSetting: The sample period is unknown, or float32 cannot hold the variances, or a channel has momentum.
    """
    require_no_momentum(job, "ESPHome")
    if job.sample_period is None:
        raise BadSetting(
            "sample_period of the tuning must be known for ESPHome, which counts q per second (got none)"
        )
    sensors = "".join(_sensor(job, job.sample_period, *named) for named in job.named_channels)
    text = fill_template("libraries/kalscope_esphome.yaml", about=commented(about(job), "#"), sensors=sensors)
    return {"kalscope_esphome.yaml": text}


def _sensor(job: ExportJob, period: float, word: str, channel: ChannelTuning) -> str:
    # √q/√T: q/T alone might overflow.
    process, error = math.sqrt(channel.q) / math.sqrt(period), math.sqrt(channel.r)
    _check("q", channel, process, 0.001)
    _check("r", channel, error, 1.0)
    return _SENSOR.format(
        about=commented(about_channel(job, channel), "  #"),
        word=word,
        name=quoted(f"{comment_text(channel.name, 40)} filtered"),  # harmless: "${…}" would be substituted
        process=number_text(process),
        error=number_text(error),
    )


def _check(name: str, channel: ChannelTuning, deviation: float, factor: float) -> None:
    """Refuse a variance that float32 loses; `factor` is what ESPHome multiplies it by."""
    with np.errstate(over="ignore", under="ignore"):
        variance = float(np.float32(deviation) * np.float32(deviation) * np.float32(factor))
    smallest, largest = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)
    if deviation > 0.0 and not smallest <= variance <= largest:
        raise BadSetting(
            f"{name} must be a variance that float32 holds, for ESPHome (got {getattr(channel, name)!r} of"
            f" {comment_text(channel.name)}, {deviation * min(deviation, sys.float_info.max) * factor:.3g} inside)"
        )
