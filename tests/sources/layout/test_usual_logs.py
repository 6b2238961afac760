"""Logs as loggers, boards and consoles write them: names, units, rate and values are the right ones."""

import math

import numpy as np
import pytest
from each import each

from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.reading.recording_file import read_recording

N = 40
A = [round(20 + 3 * math.sin(i / 9), 2) for i in range(N)]
B = [round(1012.5 + 0.31 * i, 2) for i in range(N)]


def german(value):
    return f"{value:,.2f}".translate(str.maketrans(".,", ",."))


def rows(line):
    return "".join(line(i) for i in range(N))


def clock(i, step=10):
    seconds = int(i * step)
    return f"{9 + seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}"


LOGS = {
    "Python lists": (rows(lambda i: f"[{A[i]}, {B[i]}]\n"), {"value 1": ("", A), "value 2": ("", B)}, None),
    "Python tuples, and blanks": (
        rows(lambda i: f" ({i / 10:.1f}, {A[i]}, {B[i]} )\n"),
        {"value 1": ("", A), "value 2": ("", B)},
        0.1,
    ),
    "a list between blanks": (
        rows(lambda i: f"[ {A[i]}  {B[i]}]\n"),
        {"value 1": ("", A), "value 2": ("", B)},
        None,
    ),
    "Fortran": (
        rows(lambda i: f"  {i / 4:.2f}D+00  {A[i] / 1000:.5f}D+03\n"),
        {"value 1": ("", A)},
        0.25,
    ),
    "Julian dates": (
        "HJD,mag\n" + rows(lambda i: f"{2455000.5 + i / 80:.4f},{A[i]}\n"),
        {"mag": ("", A)},
        1080,
    ),
    "German numbers alone": (rows(lambda i: german(B[i]) + "\n"), {"value 1": ("", B)}, None),
    "English numbers alone": (rows(lambda i: f"{B[i]:,.2f}\n"), {"value 1": ("", B)}, None),
    "HoboWare text": (
        "Plot-Titel: Keller\n#\tDatum Zeit, GMT+02:00\tTemp., °C\n"
        + rows(lambda i: f"{i + 1}\t17.05.2024 {clock(i)}\t{german(A[i])}\n"),
        {"Temp.": ("°C", A)},
        10,
    ),
    "Excel, two digits of the year": (
        "sep=;\nDatum;Uhrzeit;Temp (°C);Druck (hPa)\n"
        + rows(lambda i: f"17.05.24;{clock(i)};{german(A[i])};{german(B[i])}\n"),
        {"Temp": ("°C", A), "Druck": ("hPa", B)},
        10,
    ),
    "multimeter": (
        "Reading,Sample,Start Time\n" + rows(lambda i: f"{i + 1},{A[i]} V DC,05/17/2024 {clock(i)}\n"),
        {"Sample": ("V DC", A)},
        10,
    ),
    "terminal with colours": (
        "=~=~= PuTTY log 2024.05.17 09:30:00 =~=~=\r\n\x1b[2J\x1b[H"
        + rows(lambda i: f"\x1b[0;32m{A[i]},{B[i]}\x1b[0m\r\n"),
        {"value 1": ("", A), "value 2": ("", B)},
        None,
    ),
    "ESPHome": (
        "INFO Starting log output\n[09:00:00][C][wifi:410]:   SSID: 'home'\n"
        + rows(
            lambda i: (
                f"[{clock(i)}][D][sensor:094]: 'Barn': Sending state {A[i]} °C with 1 decimals of accuracy\n"
                f"[{clock(i)}][D][sensor:094]: 'Air' >> {B[i]} hPa\n"
            )
        ),
        {"Barn": ("°C", A), "Air": ("hPa", B)},
        10,
    ),
    "Tasmota": (
        rows(lambda i: f'{clock(i)}.5 MQT: tele/x/SENSOR = {{"BME280":{{"Temp":{A[i]},"P":{B[i]}}},"Unit":"C"}}\n'),
        {"tele/x/SENSOR.BME280.Temp": ("", A), "tele/x/SENSOR.BME280.P": ("", B)},
        10,
    ),
    "topics": (
        rows(lambda i: f"barn/temperature {A[i]}\nbarn/pressure {B[i]}\n"),
        {"barn/temperature": ("", A), "barn/pressure": ("", B)},
        None,
    ),
    "topics with stamps": (
        rows(lambda i: f"{1715931000 + i}.123 barn/temp {A[i]}\n{1715931000 + i}.125 barn/pressure {B[i]}\n"),
        {"barn/temp": ("", A), "barn/pressure": ("", B)},
        1,
    ),
    "objects behind a topic": (
        rows(lambda i: f'zigbee2mqtt/s1 {{"battery":97,"temperature":{A[i]}}}\n'),
        {"zigbee2mqtt/s1.temperature": ("", A)},
        None,
    ),
    "a value a line": (
        rows(lambda i: f"Temperature: {A[i]} *C\nPressure: {B[i]} hPa\n\n"),
        {"Temperature": ("C", A), "Pressure": ("hPa", B)},
        None,
    ),
    "French thousands": (
        "Heure;Pression\n" + rows(lambda i: f"{clock(i)};{f'{B[i]:,.2f}'.replace(',', ' ').replace('.', ',')}\n"),
        {"Pression": ("", B)},
        10,
    ),
    "Swiss thousands": (
        "Zeit;Druck\n" + rows(lambda i: f"{clock(i)};{f'{B[i]:,.2f}'.replace(',', chr(39))}\n"),
        {"Druck": ("", B)},
        10,
    ),
    "labels with decimal commas": (rows(lambda i: f"T={german(A[i])};P={german(A[i])}\n"), {"T": ("", A)}, None),
    "table in Markdown": (
        "| t | temp |\n|------|------|\n" + rows(lambda i: f"| {clock(i)} | {A[i]} |\n"),
        {"temp": ("", A)},
        10,
    ),
    "axes": (
        "MPU6050 Found!\n"
        + rows(
            lambda i: f"Acceleration X: {A[i]}, Y: 2.5, Z: 9.81 m/s^2\nRotation X: 0.1, Y: {B[i]}, Z: 0.02 rad/s\n"
        ),
        {"Acceleration X": ("", A), "Rotation Y": ("", B)},
        None,
    ),
    "system log": (
        rows(lambda i: f"May 17 {clock(i, 1)} raspberrypi sensor[612]: temp={A[i]} p={B[i]}\n"),
        {"temp": ("", A), "p": ("", B)},
        1,
    ),
}


def read(tmp_path, text, options=DEFAULTS):
    path = tmp_path / "log.txt"
    path.write_bytes(text.encode())
    return read_recording(path, options)


@pytest.mark.slow
@each("name", LOGS)
def test_a_usual_log_is_read_right(tmp_path, name):
    text, channels, period = LOGS[name]
    recording = read(tmp_path, text)
    assert recording.report.rejected == 0
    assert recording.sample_period == (None if period is None else pytest.approx(period))
    for channel, (unit, values) in channels.items():
        assert recording.units[recording.names.index(channel)] == unit
        np.testing.assert_array_equal(recording.channel(channel), values)


def test_what_could_be_one_number_or_two_is_asked_about(tmp_path):
    text = rows(lambda i: f"1.0{10 + i % 9},25\n")
    assert "it could also be 1 column: --delimiter semicolon" in read(tmp_path, text).report.notes
    one = read(tmp_path, text, ReadOptions(delimiter=";"))
    np.testing.assert_array_equal(one.values[:, 0], [1010.25 + i % 9 for i in range(N)])


def test_labels_that_are_evenly_apart_are_rows_of_their_own(tmp_path):
    recording = read(tmp_path, rows(lambda i: f"[{clock(i)}] temp: {A[i]}\n[{clock(i + 0.5)}] pressure: {B[i]}\n"))
    assert (len(recording), recording.sample_period) == (2 * N, 5)
    assert np.isnan(recording.values[0, 1])


def test_a_label_that_is_lost_shifts_no_other(tmp_path):
    lines = [line for i in range(N) for line in (f"Temp: {A[i]}\n", f"Press: {B[i]}\n")]
    recording = read(tmp_path, "".join(line for i, line in enumerate(lines) if i not in (21, 30)))
    known = recording.channel("Press")[np.isfinite(recording.channel("Press"))]
    np.testing.assert_array_equal(known, B[:10] + B[11:])
    both = recording.values[np.isfinite(recording.values).all(axis=1)]
    assert {tuple(row) for row in both} <= set(zip(A, B, strict=True))


def test_a_name_with_d_and_digits_is_no_number_of_fortran(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text("t,a,id\n" + "".join(f"{i / 4:.2f},{A[i]},12D3\n" for i in range(N)))
    recording = read_recording(path)
    assert recording.names == ("a",)
    assert not any("Fortran" in note for note in recording.report.notes)
