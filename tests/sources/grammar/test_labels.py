"""Lines that name their values: labels, equalities, JSON."""

import pytest

from kalscope.sources.grammar.line_format import MAX_VALUES, find_labels
from kalscope.sources.reading.line_parser import LineParser


@pytest.mark.parametrize(
    ("line", "pairs"),
    [
        ("t=123 ax=0.1 ay=-2.0", {"t": "123", "ax": "0.1", "ay": "-2.0"}),
        ("temp=21.5C hum=40%", {"temp": "21.5C", "hum": "40%"}),
        ("a = 1, b = 2", {"a": "1", "b": "2"}),
        ("rel hum = 40 %; temp = 21.5 C", {"rel hum": "40 %", "temp": "21.5 C"}),
        ("a=1&b=2", {"a": "1", "b": "2"}),
        ("Sensor Value=155", {"Sensor Value": "155"}),
        ("Temperature = 21.05 *C", {"Temperature": "21.05 C"}),
        ("Humidity: 45.00 %  Temperature: 21.30 C", {"Humidity": "45.00 %", "Temperature": "21.30 C"}),
        ("Temp: 21.5 C Rel Hum: 40 %", {"Temp": "21.5 C", "Rel Hum": "40 %"}),
        (
            "T: 21.0°C 69.8°F  Heat index: 20°C 68°F",
            {"T": "21.0°C", "T 2": "69.8°F", "Heat index": "20°C", "Heat index 2": "68°F"},
        ),
        (
            "Reading: -0.1 lbs calibration_factor: -7050.00",
            {"Reading": "-0.1 lbs", "calibration_factor": "-7050.00"},
        ),
        ("INFO temp=20.89 hum=52", {"temp": "20.89", "hum": "52"}),
        ('ts=2026-01-01T00:00 msg="two words" v=5', {"ts": "2026-01-01T00:00", "msg": "two words", "v": "5"}),
        ("ax= ay=2", {"ax": "", "ay": "2"}),
        ('{"t": 1.50, "imu": {"acc": [0.1, -9.8]}}', {"t": "1.50", "imu.acc[0]": "0.1", "imu.acc[1]": "-9.8"}),
        ('{"ts":1700000000000,"values":{"temp":"21.5"}}', {"ts": "1700000000000", "values.temp": "21.5"}),
        ('{"a": null, "b": true, "c": NaN}', {"a": "", "b": "true", "c": "NaN"}),
    ],
)
def test_the_pairs_of_a_line(line, pairs):
    found = find_labels(line)
    assert found is not None
    assert dict(found) == pairs


@pytest.mark.parametrize(
    "line",
    [
        "5=6",
        "Temp: 21.5 C and rising: slowly",
        "=",
        "a==b",
        'msg="cut v=1',
        "{",
        "{}",
        "[1]",
        '{"a":' * 5000,
        '{"a": ' + "[" * 30000,
        "ets Jun  8 2016 00:22:57",
    ],
)
def test_lines_that_hold_no_pairs(line):
    assert find_labels(line) is None


def test_an_object_of_very_many_values_is_no_row():
    assert find_labels(f'{{"a": {[1] * MAX_VALUES}}}') is not None
    assert find_labels(f'{{"a": {[1] * (MAX_VALUES + 1)}}}') is None


@pytest.mark.parametrize(
    "write",
    [lambda i: f"t={i * 10} ax={i / 8} state=ok", lambda i: f'{{"t": {i * 10}, "ax": {i / 8}, "state": "ok"}}'],
)
def test_a_stream_of_pairs_reads_the_numbers_and_leaves_the_texts(write):
    parser = LineParser()
    parser.feed("".join(write(i) + "\n" for i in range(20)).encode())
    events = list(parser)
    assert parser.layout is not None
    assert [parser.layout.columns[i].name for i in parser.layout.channels] == ["ax"]
    assert [event.kind for event in events] == ["row"] * 20
    assert not any(event.issues for event in events)


def test_a_damaged_object_among_others_is_rejected():
    parser = LineParser()
    parser.feed(b'{"t": 1, "a": 2}\n{"t": 2, "a": 3}\n{"t": 3, "a": \n{"t": 4, "a": 5}\n')
    assert [event.kind for event in parser] == ["row", "row", "rejected", "row"]
