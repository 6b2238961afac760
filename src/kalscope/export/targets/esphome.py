"""ESPHome: a Kalman combination sensor, which takes standard deviations, the process noise per √second.

Its component (esphome/components/combination) adds process_std_dev² to the variance per second of the board's
clock, and computes in float32.
"""

from __future__ import annotations

import math

from kalscope.errors import BadSetting
from kalscope.export.float32 import to_float32
from kalscope.export.job import ExportJob, about, about_channel, commented, fill_template
from kalscope.export.names import comment_text, number_text
from kalscope.tuning.tuning import ChannelTuning

_SENSOR = """\
{about}  - platform: combination
    type: kalman
    id: {word}
    name: {name}
    process_std_dev: {process}
    sources:
{sources}"""
_SOURCE = """\
      - source: {source}{remark}
        error: {error}
"""
_SCALED = """\
  - platform: copy
    source_id: {word}  # id of your raw sensor
    id: {word}_scaled
    filters:
      - offset: {offset}
      - multiply: {factor}
"""
_RAW = "  # id of your raw sensor"


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_esphome.yaml`: a Kalman combination sensor for each channel, or one of all sensors that are fused.

    Raises:
        BadSetting: The sample period is unknown, or float32 cannot hold the variances.
    """
    sensors = "".join(_combination(job, *named) for named in job.named_channels)
    text = fill_template("kalscope_esphome.yaml", about=commented(about(job), "#"), sensors=sensors)
    return {"kalscope_esphome.yaml": text}


def _combination(job: ExportJob, word: str, one: ChannelTuning) -> str:
    """One filter; a copy scales each sensor that does not read x itself."""
    if job.sample_period is None:
        raise BadSetting(
            "sample_period of the tuning must be known for ESPHome, which counts q per second (got none)"
        )
    process = math.sqrt(one.q) / math.sqrt(job.sample_period)  # q/T alone might overflow
    name = comment_text(one.name)
    to_float32(f"q of {name} per ms, for ESPHome,", 0.001 * process * process)
    scaled, sources = "", ""
    words = job.sensor_identifiers if one.sensors else (word,)
    each = zip(
        words, one.params.scaled_r.tolist(), one.params.offset.tolist(), one.params.gain.tolist(), strict=True
    )
    for name, r, offset, gain in each:
        is_raw = offset == 0.0 and gain == 1.0
        if not is_raw:
            scaled += _SCALED.format(word=name, offset=number_text(-offset), factor=number_text(1.0 / gain))
        error = math.sqrt(r)
        to_float32(f"r of {name}, for ESPHome,", r)
        source, remark = (name, _RAW) if is_raw else (f"{name}_scaled", "")
        sources += _SOURCE.format(source=source, remark=remark, error=number_text(error))
    ending = "" if one.sensors else " filtered"
    return scaled + _SENSOR.format(
        about=commented(about_channel(job, one), "  #"),
        word=word + ending.replace(" ", "_"),
        name=f'"{comment_text(one.name, 40)}{ending}"',  # harmless: "${…}" would be substituted
        process=number_text(process),
        sources=sources,
    )
