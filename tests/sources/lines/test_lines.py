"""Lines that name their values, and the streaming parser: what people print, cut at every byte."""

import itertools
import math
from functools import reduce

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.grammar.line_format import MAX_VALUES, find_pairs
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.reading import line_parser
from kalscope.sources.reading.line_parser import MAX_LINE_BYTES, LineParser


def events_of(data, pieces=None, options=DEFAULTS):
    """All events of a stream, fed whole or in pieces."""
    parser, events = LineParser(options), []
    for piece in pieces or [data]:
        parser.feed(piece)
        events += parser
    return parser, events


def only(line, before=b""):
    """(kind, {channel: value}, issues) of the last line of a stream."""
    parser, events = events_of(before + line.encode() + b"\n")
    event, layout = events[-1], parser.layout
    values = {layout.columns[i].name: event.rows[-1][i] for i in layout.channels} if event.rows else {}
    return event.kind, values, event.issues


NAN = math.nan
ROWS = [
    ("1 2\t3", {"value 1": 1, "value 2": 2, "value 3": 3}), ("1;2", {"value 1": 1, "value 2": 2}),
    ("1,2,3,", {"value 1": 1, "value 2": 2, "value 3": 3}), ("1,,3", {"value 1": 1, "value 2": NAN, "value 3": 3}),
    ("a:1,b:2", {"a": 1, "b": 2}), ("a:1\tb:2", {"a": 1, "b": 2}), ("a:1,b:2\r", {"a": 1, "b": 2}),
    ("a: 1, b: 2", {"a": 1, "b": 2}), ("a = 1, b = 2", {"a": 1, "b": 2}), ("a=1&b=2", {"a": 1, "b": 2}),
    ("P: 3", {"P": 3}), ("Label 1:10", {"Label 1": 10}), ("Sensor Value=155", {"Sensor Value": 155}),
    (">a:1", {"a": 1}), ("> a : 1 ", {"a": 1}), (">a:1000:1", {"a": 1}), (">a:1000:1;2000:2", {"a": 2}),
    ("12:30:05,5", {"value 1": 5}), ("19:23:11.891 -> 1,2", {"value 1": 1, "value 2": 2}),
    ("19:23:11.891 -> a:1 b:2", {"a": 1, "b": 2}), ("t=123 ax=0.1 ay=-2.0", {"ax": 0.1, "ay": -2}),
    ("temp=21.5C hum=40%", {"temp": 21.5, "hum": 40}), ("rel hum = 4 %; temp = 2.5 C", {"rel hum": 4, "temp": 2.5}),
    ("Humidity: 45.00 %  Temperature: 21.30 C", {"Humidity": 45, "Temperature": 21.3}),
    ("Temperature = 21.05 *C", {"Temperature": 21.05}), ("Temp: 2.5 C Rel Hum: 4 %", {"Temp": 2.5, "Rel Hum": 4}),
    ("T: 21.0°C 69.8°F  Heat index: 20°C 68°F", {"T": 21, "T 2": 69.8, "Heat index": 20, "Heat index 2": 68}),
    ("Reading: -0.1 lbs calibration_factor: -7050.00", {"Reading": -0.1, "calibration_factor": -7050}),
    ("INFO temp=20.89 hum=52", {"temp": 20.89, "hum": 52}), ("ax= ay=2", {"ax": NAN, "ay": 2}),
    ('ts=2026-01-01T00:00 msg="two words" v=5', {"v": 5}), ('{"a": null, "b": true, "c": 1}', {"a": NAN, "c": 1}),
    ('{"t": 1.50, "imu": {"acc": [0.1, -9.8]}}', {"imu.acc[0]": 0.1, "imu.acc[1]": -9.8}),
    ('{"ts":1700000000000,"values":{"temp":"21.5"}}', {"values.temp": 21.5}),
]  # fmt: skip


@pytest.mark.parametrize(("line", "values"), ROWS)
def test_what_people_print_is_a_row(line, values):
    kind, found, issues = only(line)
    assert (kind, issues) == ("row", ())
    np.testing.assert_equal(found, values)


TABLE, LABELS = b"1,2\n" * 3, b"temp:1,hum:2\n" * 3
OTHERS = {
    (b"", "text"): [
        *("hello world", "nan", "WiFi connected", "Warning: too hot", "Temp: 21.5 C and rising: slowly", "="),
        *("a==b", 'msg="cut v=1', "{", "{}", '{"a":' * 5000, '{"a": ' + "[" * 30000),
    ],
    (b"", "rejected"): ["5=6"],
    (LABELS, "text"): ["Warning: reached 26 degrees", "rebooting in 3, 2, 1"],
    (LABELS, "rejected"): ["temp:1,hu", "temp:1,temp:2"],
}  # fmt: skip


def test_prose_is_text_and_a_damaged_line_is_rejected():
    for (before, kind), lines in OTHERS.items():
        assert [line for line in lines if only(line, before)[0] != kind] == []
    for line in ("ets Jun  8 2016 00:22:57", f'{{"a": {[1] * (MAX_VALUES + 1)}}}'):
        assert find_pairs(line) is None


def test_once_the_shape_is_known_a_cell_that_is_no_number_is_a_reported_missing_sample():
    for cell in ("12abc", "0x1F", "Infinity", "hello"):
        kind, values, issues = only(f"1,{cell}", TABLE)
        np.testing.assert_equal((kind, values), ("row", {"value 1": 1, "value 2": NAN}))
        assert [(issue.line, issue.column, issue.text) for issue in issues] == [(4, "value 2", cell)]


@pytest.mark.slow
def test_text_without_data_costs_each_line_only_a_few_looks(monkeypatch):
    looked, real = [], line_parser.sniff
    monkeypatch.setattr(line_parser, "sniff", lambda head, options: looked.append(len(head)) or real(head, options))
    _, events = events_of(b"".join(b"state s%d\n" % i for i in range(3000)))
    assert {event.kind for event in events} == {"text"}
    assert sum(looked) < 10 * 3000


@pytest.mark.parametrize("options", [ReadOptions(header_row=2), ReadOptions(header_row=2, unit_row=3)])
def test_a_stream_waits_for_the_rows_that_were_chosen(options):
    parser, events = events_of(b"Logger v1.2\na,b\n1,2\n3,4\n5,6\n", options=options)
    assert [column.name for column in parser.layout.columns] == ["a", "b"]
    assert [event.kind for event in events[-2:]] == ["row", "row"]
    assert parser.adopt_layout(["Logger v1.2"]) is None


def test_teleplot_lines_bring_stamps_and_units_and_all_else_is_text():
    parser, events = events_of("setup done\n>t:5:3.5§degC\nlog 5\n>t:6:nan\n>t:x\n".encode())
    assert [event.kind for event in events] == ["text", "row", "text", "row", "rejected"]
    assert [(c.name, c.unit) for c in parser.layout.columns] == [("time", "ms"), ("t", "degC")]
    np.testing.assert_equal(events[3].rows, ((6.0, NAN),))


@pytest.mark.slow
def test_a_late_variable_of_teleplot_counts_from_its_second_line_on():
    """A name that came once may be damage on the wire."""
    parser, _ = events_of(b">a:1\n" * 20_000)
    for line, kind in ((b">b:1\n", "rejected"), (b">b:2\n", "row"), (b">c:\n", "header"), (b">c:3\n", "row")):
        parser.feed(line)
        assert [event.kind for event in parser] == [kind]
    assert [column.name for column in parser.layout.columns] == ["a", "b", "c"]
    _, events = events_of("".join(f">v{i}:1\n" for i in range(300)).encode())
    assert [event.kind for event in events] == ["row"] * 255 + ["rejected"] * 45  # columns of a table
    assert "one of the first 255 names" in events[-1].issues[0].reason


def test_variables_that_come_together_are_known_before_the_first_is_read():
    parser, events = events_of(">a:1000:1\n>time:1000:2\n>b:1000:3§V\n".encode())
    np.testing.assert_equal(events[0].rows, ((1000.0, 1.0, NAN, NAN),))
    assert [(c.name, c.unit) for c in parser.layout.columns[1:]] == [("a", ""), ("time", ""), ("b", "V")]
    assert parser.layout.time.index == 0


def checked(payload):
    return f"{payload}*{reduce(int.__xor__, payload.encode(), 0):02X}"


def test_a_right_checksum_is_taken_off_and_a_wrong_one_rejects_the_line():
    lines = [checked(f"{i},{i / 2}") for i in range(5)]
    spoilt = [lines[0].replace("0,", "7,", 1), "6,3", lines[4][:-3], ""]
    parser, events = events_of("\n".join([*lines, *spoilt]).encode())
    assert [event.kind for event in events] == ["row"] * 5 + ["rejected"] * 3
    assert events[4].rows == ((4.0, 2.0),)
    assert "checksum" in events[5].issues[0].reason
    assert parser.layout.form.checksum


STREAMS = {
    "table": b"boot\r\nt,a,b\n" + b"".join(b"0.%02d,%d,2\n" % (i, i % 5) for i in range(30)) + b"x\n0.30,1,2\n",
    "labels": b"ready\n" + b"".join(b"temp: %d, hum: %d\n" % (i % 7, i) for i in range(9)) + b"temp: 1\nhot: x\n",
    "stamps": b"".join(b"12:00:%02d.5 -> %d.25\n" % (i, i % 5) for i in range(9)),
    "checksums": "".join(checked(f"{i},2") + "\n" for i in range(9)).encode() + b"1,2*00\n",
    "units": "temp [°C];dist [µm]\n1,5;2,5\n1,6;x\n".encode(),
}


@pytest.mark.slow
@given(st.binary(max_size=200), st.lists(st.integers(0, 200), max_size=5))
def test_any_bytes_in_any_pieces_are_the_same_events(data, cuts):
    places = sorted({0, len(data), *(min(cut, len(data)) for cut in cuts)})
    pieces = [data[a:b] for a, b in itertools.pairwise(places)]
    whole, cut = events_of(data)[1], events_of(data, pieces)[1]
    assert repr(cut) == repr(whole)
    assert [event.number for event in whole] == list(range(1, len(whole) + 1))


@pytest.mark.parametrize("data", STREAMS.values(), ids=STREAMS)
def test_a_stream_means_what_the_file_means(read, data):
    recording = read(data)
    parser, events = events_of(data)
    # The caller leaves the gap of a rejected line, as the file reader does.
    gap = () if parser.layout.time else ((NAN,) * len(parser.layout.columns),)
    rows = [row for event in events for row in (gap if event.kind == "rejected" else event.rows)]
    channels = parser.layout.channels
    np.testing.assert_array_equal([[row[i] for i in channels] for row in rows], recording.values)
    rejected = [event.number for event in events if event.kind == "rejected"]
    assert rejected == [issue.line for issue in recording.report.issues if issue.column is None]
    assert len(events) == recording.report.lines


def test_a_line_without_end_is_dropped_as_it_comes_and_reported_once():
    parser = LineParser()
    for _ in range(100):
        parser.feed(b"1" * 40_000)
        assert parser.next_line() is None
        assert len(parser._buffer) <= MAX_LINE_BYTES + 40_000
    parser.feed(b"\n1,2\n")
    events = list(parser)
    assert [event.kind for event in events] == ["rejected", "row"]
    assert "65536 bytes" in events[0].issues[0].reason
    assert len(events[0].text) <= 200
