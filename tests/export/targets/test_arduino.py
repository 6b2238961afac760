"""The exported header and sketch: what is written and what is refused."""

from __future__ import annotations

import pytest

from kalscope.errors import BadSetting
from kalscope.export.job import ExportJob, job_of
from kalscope.export.registry import export_tuning, limits_of
from kalscope.export.targets.arduino import files
from kalscope.tuning.tuning import ChannelTuning, Tuning


@pytest.mark.parametrize(
    ("unit", "in_counts"),
    [("", True), ("counts", True), ("ADC Counts", True), ("LSB", True), ("raw", True)]
    + [(unit, False) for unit in ("g", "°C", "V", "mV", "%", "m/s²", "µT")],
)
def test_a_unit_that_analogread_does_not_return_stops_the_compiler_and_is_said(unit, in_counts):
    tuning = Tuning((ChannelTuning("a", unit, 0.1, 1.0),))
    sketch = files(job_of(tuning))["kalscope_filter.ino"]
    assert ("#error" not in sketch) == in_counts
    assert sketch.count("return analogRead(PINS[channel]);") == 1
    said = " ".join(limits_of(tuning, "arduino"))
    assert ("you have written readSensor()" not in said) == in_counts


def test_what_float_or_a_board_cannot_hold_is_refused():
    with pytest.raises(BadSetting, match=r"^light: q must fit float32: 0, or a size from 1.2e-38 to 3.4e38"):
        files(ExportJob((ChannelTuning("light", "", 1e-60, 1.0),)))
    with pytest.raises(BadSetting, match="must fit float32, up to"):
        files(ExportJob((ChannelTuning("light", "", 3e38, 3e38),)))
    with pytest.raises(BadSetting, match="1 to 6 channels"):
        files(ExportJob(tuple(ChannelTuning(str(i), "", 1.0, 1.0) for i in range(7))))
    with pytest.raises(BadSetting, match="sample period"):
        files(ExportJob((ChannelTuning("light", "", 1.0, 1.0),), sample_period=3e3))


def test_the_sketch_runs_at_the_period_that_q_belongs_to_and_names_its_columns():
    one = files(ExportJob((ChannelTuning("Light", "lx", 1.0, 1.0),), sample_period=0.01))["kalscope_filter.ino"]
    assert "PERIOD_US = 10000;" in one
    assert 'println(F("# raw,filtered"))' in one
    two = files(ExportJob((ChannelTuning("a", "", 1.0, 1.0), ChannelTuning("b", "", 1.0, 1.0))))
    assert 'println(F("# a,a_filtered,b,b_filtered"))' in two["kalscope_filter.ino"]
    assert "PERIOD_US = 5000;  // between samples; a guess" in two["kalscope_filter.ino"]


def test_only_a_sketch_of_channels_can_be_minimal():
    one = Tuning((ChannelTuning("light", "", 1.0, 1.0),))
    pair = Tuning(one.channels, fusion=ChannelTuning("both", "", 1.0, (1.0, 2.0), sensors=("light", "b")))
    assert "listen" not in export_tuning(one, "arduino", minimal=True)["kalscope_filter.ino"]
    for tuning, target, calibration in ((one, "c", False), (one, "arduino", True), (pair, "arduino", False)):
        with pytest.raises(BadSetting, match="minimal must be for arduino"):
            export_tuning(tuning, target, minimal=True, calibration=calibration)
