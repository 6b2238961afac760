"""What loggers, oscilloscopes and phones really write, read as the table of shared/data/field_logs says."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from kalscope.sources.reading.recording_file import read_recording

LOGS = Path(__file__).parents[3] / "../shared/data/field_logs"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not LOGS.is_dir(), reason="shared/data is not beside the repository"),
]


@dataclass(frozen=True)
class Right:
    """The right reading of one file."""

    rows: int
    period: float | None = None
    """s; None where the table names none."""
    tolerance: float = 1e-6
    """Of the period, relative."""
    span: float | None = None
    """s from the first sample to the last."""
    channels: tuple[tuple[str, int, float, tuple[str, ...]], ...] = ()
    """(beginning of the name, finite samples, mean, units it may have; () where it is not looked at)."""
    torn: int = 0
    """Last lines without a newline whose whole number may have lost a digit."""


VOLT, SI_ACCEL, CELSIUS = ("V", "Volt"), ("m/s^2",), ("°C", "C", "degC")
RIGHT = {
    "tal_actigraph.txt": Right(
        10080,
        60,
        span=60 * 10079,
        channels=(("Luminosidade", 10080, 98.906746, ("",)), ("Atividade", 10080, 78.2224206, ("",))),
    ),
    "rigol_ds1204b.csv": Right(
        8192, 8e-6, span=0.065528, channels=(("CH1", 8192, 1.48196777, VOLT), ("CH4", 8192, 9.56293945, VOLT))
    ),
    "rigol_ds1102e.csv": Right(600, 2e-8, 1e-3, 1.198e-5, (("CH1", 600, 1.43133333, VOLT),)),
    "rigol_ds1052e.csv": Right(
        8192, 2e-9, 1e-4, 1.6382e-5, (("CH 1", 8192, -0.00242675781, VOLT), ("CH 2", 8192, 2.25766602, VOLT))
    ),
    "tektronix_tek0000.csv": Right(2500, 2e-6, span=0.004998, channels=(("CH2", 2500, 0.406752, VOLT),)),
    "asos_metar.txt": Right(
        312, 300, span=86100, channels=(("tmpf", 24, 59.6166667, ()), ("sknt", 304, 11.5263158, ()))
    ),
    "torque_obd.csv": Right(
        2662,
        channels=(
            ("GPS Speed", 2495, 15.3202512, ("Meters/second",)),
            ("G(z)", 2662, 4.65216868, ()),
            ("80-120kph Time", 592, 0.0, ("s",)),
        ),
    ),
    "environment_canada_hourly.csv": Right(
        720,
        3600,
        span=719 * 3600,
        channels=(("Temp", 720, 16.8901389, ("°C",)), ("Rel Hum", 717, 75.3891213, ("%",))),
    ),
    "tide_elevation.dat": Right(1584, 3600, span=1583 * 3600, channels=(("", 1510, 1.97581457, ("",)),)),
    "empatica_ACC.csv": Right(890, 1 / 32, span=889 / 32, channels=(("", 890, -0.966292135, ()),)),
    "empatica_HR.csv": Right(28, 1, span=27, channels=(("", 28, 101.495, ()),)),
    "empatica_IBI.csv": Right(49, channels=(("IBI", 49, 0.923194, ()),)),
    "labview_short.lvm": Right(
        10,
        39.0625e-6,
        span=9 * 39.0625e-6,
        channels=(("Excitation", 10, 0.6917138, ("Newtons",)), ("Response", 10, 1.2138708, SI_ACCEL)),
    ),
    # The table says 8 rows; the file holds 9, the first and the last two with "LOST COMMUNICATION".
    "labview_comments.lvm": Right(
        9,
        channels=(
            ("Pressão ABS.", 9, 1.69523888889, ("MPa",)),
            ("Temperatura", 9, 5.42960977778, ("°C",)),
            ("Volume", 9, 79.8414555556, ("ml",)),
        ),
    ),
    "labview_two_times.lvm": Right(
        3,
        19.53125e-6,
        span=2 * 19.53125e-6,
        channels=(("Voltage", 3, -0.0347673333333, ("Volts",)), ("Acceleration", 3, 0.5010466666667, ("g",))),
    ),
    "openbci_cyton.txt": Right(22490, 0.004, 0.002, channels=(("EXG Channel 0", 22490, 62052.0530, ()),)),
    "robot_currents.txt": Right(
        2094, 1 / 13.4, 0.02, channels=(("Current1", 2094, -24.407383, ()), ("Current4", 2094, -24.0318052, ()))
    ),
    "ppg_buffered.csv": Right(68476, 681.898 / 68475, 0.005, 681.898, (("hr", 68476, 509.394766, ()),), torn=1),
    "arm_whole_seconds.csv": Right(7039, 1 / 67, 0.02, channels=(("Accel_X", 7039, -0.223429038, ()),)),
    "dht22_field_added.csv": Right(
        3151, channels=(("Temperature", 3148, 28.4383736, ()), ("Humidity", 3148, 72.2198539, ()))
    ),
    "balcony_six_date_columns.txt": Right(1820, 120, 0.02, channels=(("Temperatures", 1820, 15.1731868, CELSIUS),)),
}
UNGAPPED = [
    "arm_whole_seconds.csv",
    "openbci_cyton.txt",
    "ppg_buffered.csv",
    "tal_actigraph.txt",
    "environment_canada_hourly.csv",
]


@pytest.fixture(scope="module")
def read():
    """Reads each file once."""
    kept = {}

    def read_once(name):
        if name not in kept:
            kept[name] = read_recording(LOGS / name)
        return kept[name]

    return read_once


@pytest.mark.parametrize("name", RIGHT)
def test_a_field_log_reads_as_its_table_says(read, name):
    right, recording = RIGHT[name], read(name)
    report = recording.report
    assert right.rows - right.torn <= report.rows == len(recording) <= right.rows
    assert report.rows + report.rejected + report.blank + report.comments + report.headers == report.lines
    if right.period is not None:
        assert recording.sample_period == pytest.approx(right.period, rel=right.tolerance)
    if right.span is not None:
        assert recording.time[-1] - recording.time[0] == pytest.approx(right.span, rel=max(right.tolerance, 1e-4))
    for prefix, good, mean, units in right.channels:
        index = next(i for i, known in enumerate(recording.names) if known.startswith(prefix))
        samples = recording.values[:, index]
        finite = samples[np.isfinite(samples)]
        assert good - right.torn <= finite.size <= good
        assert finite.mean() == pytest.approx(mean, rel=1e-6 if right.torn else 1e-8, abs=1e-12)
        assert not units or recording.units[index] in units


@pytest.mark.parametrize("name", UNGAPPED)
def test_a_clock_of_whole_seconds_or_of_bursts_has_no_gaps(read, name):
    assert not any("gaps" in note or "--gaps" in note for note in read(name).report.notes)
