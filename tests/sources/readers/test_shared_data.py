"""Files of others, with the readings that `EXPECTED.md` and the tables of shared/data call right."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from kalscope.errors import BadFile
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.reading.recording_file import read_recording

SHARED = Path(__file__).parents[3] / "../shared/data"
HERE = SHARED.is_dir()
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not HERE, reason="shared/data is not beside the repository")]

TWINS = (
    *("02_semicolon_decimalcomma.csv", "03_comments.csv", "04_boot_text.csv", "06_bom.csv", "07_crlf.csv"),
    *("08_label_value.csv", "12_gz.csv.gz", "13_zst.csv.zst", "15_spaces_tabs.txt", "18_utf16.csv"),
)
"""Files that hold the same as 01_clean.csv."""
SAME = (*TWINS, "01_clean.csv", "09_dup_header.csv", "14_noheader.csv", "16_plotter_single.txt", "19_iso_time.csv")
MESSY = {
    **dict.fromkeys((*SAME, "25_units_row.csv", "26_arduino_ide_ts.txt"), (40, [], [])),
    "05_truncated_last.csv": (39, [41], []),
    "10_mixed_types.csv": (40, [], [(9, "temp", "ERR"), (32, "temp", "ovf")]),
    "11_ragged.csv": (36, [7, 8, 17, 24], []), "17_binary_garbage.csv": (38, [13, 19], []),
    "20_late_type.csv": (60003, [], [(60003, "temp", "err")]), "21_repeat_header.csv": (80, [], []),
    "22_quote.csv": (40, [], [(11, "temp", '"20.1'), (32, "temp", '20.0"x')]),
}  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def forget():
    """The recordings are let go with the last test."""
    yield
    read.cache_clear()


@cache
def read(name, options=DEFAULTS):
    """A file of shared/data, read once for all its channels."""
    return read_recording(SHARED / name, options)


def assert_accounted(report):
    """Each line is in one count."""
    assert report.rows + report.rejected + report.blank + report.comments + report.headers == report.lines


@pytest.mark.parametrize("name", MESSY)
def test_a_messy_file_reads_as_expected(name):
    recording, clean = read(f"messy/{name}"), read("messy/01_clean.csv")
    report, (rows, rejected, cells) = recording.report, MESSY[name]
    assert report.rows == len(recording) == rows
    assert [issue.line for issue in report.issues if issue.column is None] == rejected
    assert [(issue.line, issue.column, issue.text) for issue in report.issues if issue.column] == cells
    assert_accounted(report)
    if name in TWINS:
        assert recording.names == clean.names == ("temp", "dist")
        np.testing.assert_array_equal(recording.time, clean.time)
        np.testing.assert_array_equal(recording.values, clean.values)


def test_messy_times_and_late_values_are_right():
    for name in ("19_iso_time.csv", "26_arduino_ide_ts.txt"):
        np.testing.assert_allclose(np.diff(read(f"messy/{name}").time), 0.1, atol=1e-9)
    np.testing.assert_array_equal(read("messy/20_late_type.csv").values[-3:, 0], [20.55, np.nan, 21.25])
    mixed = np.isnan(read("messy/10_mixed_types.csv").values)
    assert np.argwhere(mixed).tolist() == [[7, 0], [20, 0], [25, 0], [30, 0], [30, 1]]


# File, channel, rows, good samples, mean, standard deviation (n - 1), period in s where the catalogue says it.
NAB = [f"nab_{one}_temperature/{one}_temperature_system_failure.csv" for one in ("machine", "ambient")]
CATALOGUE = [
    ("nile/nile.csv", "volume", 100, 100, 919.35, 169.227501, 31557600),
    ("ck_state_space/NorwayFinland.txt", "value 2", 34, 34, 386.029412, 85.7831958, None),
    ("ck_state_space/logUKpetrolprice.txt", "value 1", 192, 192, -2.27401771, 0.119658341, None),
    ("tof_mcu_kalman/E1_run04.csv", "tof_distance_mm", 235, 235, 250.93617, 206.669066, None),
    ("tmp36_serial_monitor/serial_monitor_output.txt", "degrees C", 22, 22, 31.6095455, 2.92407328, None),
    ("putty_pressure/putty.log", "value 1", 190, 190, 0.624280226, 0.0295082723, None),
    ("flex_arm/flex_sensor_data.csv", "Raw_ADC", 3206, 3206, 136.74267, 54.635147, None),
    ("hcsr04_short/ultrasonic_data_20260227_225818.csv", "Distance_cm", 110, 110, 121.518182, 159.171406, None),
    ("ppg_arduino/data.csv", "value 1", 2483, 2483, 514.823198, 102.945017, None),
    ("ppg_arduino/data2.csv", "hr", 15000, 15000, 482.955933, 124.691456, None),
    ("actigraphy_exports/test_sample_rpx_eng.csv", "White Light", 20160, 20160, 604.984753, 3945.97836, 30),
    ("actigraphy_exports/test_sample_atr.txt", "TEMPERATURE", 5760, 5760, 30.4055885, 1.92604864, 60),
    (NAB[0], "value", 22695, 22695, 85.9264982, 13.7469125, 300),
    (NAB[1], "value", 7267, 7267, 71.2424327, 4.24750942, 3600),
    ("occupancy_office/datatest.txt", "Temperature", 2665, 2665, 21.4338763, 1.02802418, 60),
    ("brocket_flight/log.csv", "alt", 8630, 8630, 107.633256, 87.5884885, None),
    ("picoquake_car/car_vibration.csv", "a_x", 10000, 10000, 0.397375598, 0.246534969, None),
    ("oxford_phone_accel/accelerometer.csv", "value 2", 61406, 61406, 0.0686045233, 2.51276667, 0.00247),
    ("daphnet_accel/S06R02E0.csv", "ankle_vert", 7040, 7040, 1140.42812, 430.863621, 0.015625),
    ("sea_surface_temp/sea_surface_temperature.csv", "temperature", 19226, 19226, 10.5893775, 5.35483601, 1800),
    ("cgm_glucose/CGM.csv", "glucose", 52281, 52281, 137.421912, 53.8804756, 300),
    ("gps_track_mtb/obiszow_mtb_xcm.csv", "alt", 978, 978, 173.037832, 25.6192417, None),
    ("co2_weekly/co2.csv", "co2", 2284, 2225, 340.142247, 17.0038848, 604800),
    ("solar_stations/surfrad-slv16001.dat", "value 3", 1440, 1440, 140.368542, 211.306456, None),
    ("solar_stations/midc_20181014.txt", "Temperature @ 2m", 1440, 1440, -6.73128889, 0.945073643, 60),
    ("solar_stations/midc_raw_20181018.txt", "Temp CHP1", 1440, 1440, -6967.0341, 2625.05753, 60),
    ("solar_stations/SRML-day-EUPO1801.txt", "7008", 1440, 1440, -23.3027083, 23.3861, None),
    ("one_euro_truth/groundTruth.csv", "noisy", 1200, 1200, 0.183259403, 0.669276584, None),
    ("oscillators/ocxo_frequency.txt", "value 1", 19982, 19982, 1e7 + 0.125564225, 0.000647778266, None),
]


def check_samples(samples, good, mean, std):
    finite = samples[np.isfinite(samples)]
    assert finite.size == good
    assert [finite.mean(), finite.std(ddof=1)] == pytest.approx([mean, std], rel=5e-7)


@pytest.mark.parametrize(("name", "channel", "rows", "good", "mean", "std", "period"), CATALOGUE)
def test_a_real_recording_reads_as_the_catalogue_says(name, channel, rows, good, mean, std, period):
    recording = read(name)
    assert recording.report.rows == len(recording) == rows
    check_samples(recording.channel(channel), good, mean, std)
    assert period is None or recording.sample_period == pytest.approx(period, rel=0.01)


MISSING = [
    ("airquality_uci/AirQualityUCI.csv", -200.0, "T", 8991, 18.3178289, 8.83211573),
    ("airquality_uci/AirQualityUCI.csv", -200.0, "CO(GT)", 7674, 2.15274954, 1.45325204),
    ("airquality_uci/AirQualityUCI_edited.csv", -200.0, "T", 8991, 18.3178289, 8.83211573),
    ("hcsr04_short/ultrasonic_data_20260227_225818.csv", 400.0, "Distance_cm", 84, 35.3214286, 38.198644),
]


@pytest.mark.parametrize(("name", "missing", "channel", "good", "mean", "std"), MISSING)
def test_a_missing_value_is_asked_about_and_taken_away_only_when_told(name, missing, channel, good, mean, std):
    unasked = read(name)
    question = f"is {missing:g} a missing value"
    assert any(question in note for note in unasked.report.notes)
    assert np.count_nonzero(unasked.channel(channel) == missing) == len(unasked) - good
    told = read(name, ReadOptions(missing=(missing,)))
    check_samples(told.channel(channel), good, mean, std)
    assert not any(question in note for note in told.report.notes)


@pytest.mark.parametrize(("name", "rows", "steps"), [("E1_run04.csv", 235, 250), ("E3_run04.csv", 231, 247)])
def test_a_sequence_number_with_holes_gives_rows_of_missing_samples(name, rows, steps):
    options = ReadOptions(time_column="seq", gaps="missing")
    recording = read_recording(SHARED / "tof_mcu_kalman" / name, options)
    assert (recording.report.rows, recording.report.inserted, len(recording)) == (rows, steps - rows, steps)
    assert np.count_nonzero(np.isfinite(recording.channel("tof_distance_mm"))) == rows


def test_repeated_and_backward_stamps_are_counted_and_named():
    notes = " ".join(read(NAB[0]).report.notes)
    assert "the stamps wrap once, like a clock that is set back by an hour" in notes
    notes = " ".join(read("cgm_glucose/CGM.csv").report.notes)
    assert "3 samples repeat an earlier stamp" in notes


@pytest.mark.parametrize("name", ["basic_motions/BasicMotions_TRAIN.ts", "solar_stations/bsrn-lr0100-pay0616.dat"])
def test_a_text_that_is_no_table_of_samples_is_refused(name):
    with pytest.raises(BadFile, match="table of numbers"):
        read_recording(SHARED / name)


def right(rows, *channels, period=None, tolerance=1e-6, span=None, torn=0):
    """The right reading of one file.

    Args:
        rows: How many.
        channels: (beginning of the name, finite samples, mean, units it may have where that is looked at).
        period: s; None where the table names none.
        tolerance: Of the period, relative.
        span: s from the first sample to the last.
        torn: Last lines without a newline whose whole number may have lost a digit.
    """
    return rows, channels, period, tolerance, span, torn


VOLT, SI_ACCEL, CELSIUS = ("V", "Volt"), ("m/s^2",), ("°C", "C", "degC")
RIGHT = {
    "tal_actigraph.txt": right(10080, ("Luminosidade", 10080, 98.906746, ("",)),
        ("Atividade", 10080, 78.2224206, ("",)), period=60, span=60 * 10079),
    "rigol_ds1204b.csv": right(8192, ("CH1", 8192, 1.48196777, VOLT), ("CH4", 8192, 9.56293945, VOLT), period=8e-6,
        span=0.065528),
    "rigol_ds1102e.csv": right(600, ("CH1", 600, 1.43133333, VOLT), period=2e-8, tolerance=1e-3, span=1.198e-5),
    "rigol_ds1052e.csv": right(8192, ("CH 1", 8192, -0.00242675781, VOLT), ("CH 2", 8192, 2.25766602, VOLT),
        period=2e-9, tolerance=1e-4, span=1.6382e-5),
    "tektronix_tek0000.csv": right(2500, ("CH2", 2500, 0.406752, VOLT), period=2e-6, span=0.004998),
    "asos_metar.txt": right(312, ("tmpf", 24, 59.6166667), ("sknt", 304, 11.5263158), period=300, span=86100),
    "torque_obd.csv": right(2662, ("GPS Speed", 2495, 15.3202512, ("Meters/second",)), ("G(z)", 2662, 4.65216868),
        ("80-120kph Time", 592, 0.0, ("s",))),
    "environment_canada_hourly.csv": right(720, ("Temp", 720, 16.8901389, ("°C",)),
        ("Rel Hum", 717, 75.3891213, ("%",)), period=3600, span=719 * 3600),
    "tide_elevation.dat": right(1584, ("", 1510, 1.97581457, ("",)), period=3600, span=1583 * 3600),
    "empatica_ACC.csv": right(890, ("", 890, -0.966292135), period=1 / 32, span=889 / 32),
    "empatica_HR.csv": right(28, ("", 28, 101.495), period=1, span=27),
    "empatica_IBI.csv": right(49, ("IBI", 49, 0.923194)),
    "labview_short.lvm": right(10, ("Excitation", 10, 0.6917138, ("Newtons",)),
        ("Response", 10, 1.2138708, SI_ACCEL), period=39.0625e-6, span=9 * 39.0625e-6),
    # The table says 8 rows; the file holds 9, the first and the last two with "LOST COMMUNICATION".
    "labview_comments.lvm": right(9, ("Pressão ABS.", 9, 1.69523888889, ("MPa",)),
        ("Temperatura", 9, 5.42960977778, ("°C",)), ("Volume", 9, 79.8414555556, ("ml",))),
    "labview_two_times.lvm": right(3, ("Voltage", 3, -0.0347673333333, ("Volts",)),
        ("Acceleration", 3, 0.5010466666667, ("g",)), period=19.53125e-6, span=2 * 19.53125e-6),
    "openbci_cyton.txt": right(22490, ("EXG Channel 0", 22490, 62052.0530), period=0.004, tolerance=0.002),
    "robot_currents.txt": right(2094, ("Current1", 2094, -24.407383), ("Current4", 2094, -24.0318052),
        period=1 / 13.4, tolerance=0.02),
    "ppg_buffered.csv": right(68476, ("hr", 68476, 509.394766), period=681.898 / 68475, tolerance=0.005,
        span=681.898, torn=1),
    "arm_whole_seconds.csv": right(7039, ("Accel_X", 7039, -0.223429038), period=1 / 67, tolerance=0.02),
    "dht22_field_added.csv": right(3151, ("Temperature", 3148, 28.4383736), ("Humidity", 3148, 72.2198539)),
    "balcony_six_date_columns.txt": right(1820, ("Temperatures", 1820, 15.1731868, CELSIUS), period=120,
        tolerance=0.02),
}  # fmt: skip


@pytest.mark.parametrize("name", RIGHT)
def test_a_field_log_reads_as_its_table_says(name):
    rows, channels, period, tolerance, span, torn = RIGHT[name]
    recording = read(f"field_logs/{name}")
    report = recording.report
    assert rows - torn <= report.rows == len(recording) <= rows
    assert_accounted(report)
    assert period is None or recording.sample_period == pytest.approx(period, rel=tolerance)
    assert span is None or recording.time[-1] - recording.time[0] == pytest.approx(span, rel=max(tolerance, 1e-4))
    for prefix, good, mean, *units in channels:
        index = next(i for i, known in enumerate(recording.names) if known.startswith(prefix))
        samples = recording.values[:, index]
        finite = samples[np.isfinite(samples)]
        assert good - torn <= finite.size <= good
        assert finite.mean() == pytest.approx(mean, rel=1e-6 if torn else 1e-8, abs=1e-12)
        assert not units or recording.units[index] in units[0]
