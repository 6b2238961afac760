"""Long tables: one value per row, beside its name, as Home Assistant, InfluxDB and databases export them."""

import json

import numpy as np
import pytest

from kalscope.errors import BadSetting

X = np.round(np.random.default_rng(2).normal(20, 1, 30), 3)


def stamp(i, step=10, fraction=""):
    s = i * step
    return f"2024-05-01T{s // 3600:02}:{s // 60 % 60:02}:{s % 60:02}{fraction}Z"


def test_the_history_of_home_assistant(read):
    rows = [f"sensor.kitchen,{x},{stamp(i, 10, '.250')}" for i, x in enumerate(X)]
    rows[7] = f"sensor.kitchen,unavailable,{stamp(7, 10, '.250')}"
    rows += [f"sensor.hall,{x},{stamp(i, 37)}" for i, x in enumerate(X[:20])]
    rows += [f"light.hall,{'on' if i % 2 else 'off'},{stamp(i, 60)}" for i in range(6)]
    text = "entity_id,state,last_changed\n" + "\n".join(rows) + "\n"
    recording = read(text)
    assert (recording.names, recording.sample_period) == (("sensor.kitchen",), 10.0)
    np.testing.assert_array_equal(recording.values[:, 0], np.where(np.arange(30) == 7, np.nan, X))
    report = recording.report
    assert all(said in " ".join(report.notes) for said in ('"sensor.hall" (20 × 1)', "light.hall"))
    assert report.lines == text.count("\n") == report.rows + report.headers
    np.testing.assert_array_equal(read(text, part="sensor.hall").values[:, 0], X[:20])
    with pytest.raises(BadSetting, match=r"sensor\.kitchen"):
        read(text, part="sensor.cellar")


def test_annotated_csv_of_influxdb(read):
    lines = [
        "#group,false,false,true,true,false,false,true,true,true",
        "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string,string,string",
        "#default,mean,,,,,,,,",
        ",result,table,_start,_stop,_time,_value,_field,_measurement,room",
    ]
    for table, (field, scale) in enumerate([("humidity", 2), ("temperature", 1)]):
        row = f",,{table},{stamp(0)},{stamp(400)},{{}},{{:.3f}},{field},air,kitchen"
        lines += [*(row.format(stamp(i), x * scale) for i, x in enumerate(X)), ""]
    recording = read("\n".join(lines) + "\n")
    assert (recording.names, recording.sample_period) == (("humidity", "temperature"), 10.0)
    np.testing.assert_allclose(recording.values, np.column_stack([2 * X, X]), atol=1e-9)


def test_time_name_value_and_unit(read):
    rows = [f"{i * 0.5};{name};{x};{unit}" for i, x in enumerate(X) for name, unit in (("T", "°C"), ("p", "hPa"))]
    recording = read("time;sensor;value;unit\n" + "\n".join(rows) + "\n")
    assert (recording.names, recording.units, recording.sample_period) == (("T", "p"), ("°C", "hPa"), 0.5)
    np.testing.assert_array_equal(recording.values, np.column_stack([X, X]))
    del rows[9]  # p misses a stamp
    values = read("time;sensor;value;unit\n" + "\n".join(rows) + "\n").values
    assert np.argwhere(np.isnan(values)).tolist() == [[4, 1]]


def test_the_answer_of_thingsboard(read):
    series = [{"ts": 1_700_000_000_000 + 5000 * i, "value": str(x)} for i, x in enumerate(X)]
    for part in (None, "h"):
        recording = read(json.dumps({"t": series, "h": series}), "log.json", part=part)
        assert (recording.names, recording.sample_period) == (("t", "h"), 5.0)


@pytest.mark.parametrize("text", [
    "time,value,status\n" + "".join(f"{i},{x},{'ok' if i % 3 else 'low'}\n" for i, x in enumerate(X)),
    "time,sensor,temp,hum\n" + "".join(f"{i},kitchen,{x},{x}\n" for i, x in enumerate(X)),
    "time,name,value,other\n" + "".join(f"{i},a,{x},{x}\n" for i, x in enumerate(X)),
    "time,name,value\n" + "".join(f"{i},run{i},{x}\n" for i, x in enumerate(X)),
])  # fmt: skip
def test_a_table_with_text_beside_its_values_is_no_long_one(read, text):
    recording = read(text)
    assert len(recording) == len(X)
    assert recording.names[0] in ("value", "temp")
