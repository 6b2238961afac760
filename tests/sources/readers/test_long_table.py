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
    assert recording.names == ("sensor.kitchen",)
    want = X.copy()
    want[7] = np.nan
    np.testing.assert_array_equal(recording.values[:, 0], want)
    assert recording.sample_period == 10.0
    notes = " ".join(recording.report.notes)
    assert '"sensor.hall" (20 × 1)' in notes
    assert "light.hall" in notes
    report = recording.report
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
        lines += [
            f",,{table},{stamp(0)},{stamp(400)},{stamp(i)},{x * scale:.3f},{field},air,kitchen"
            for i, x in enumerate(X)
        ]
        lines.append("")
    recording = read("\n".join(lines) + "\n")
    assert recording.names == ("humidity", "temperature")
    np.testing.assert_allclose(recording.values, np.column_stack([2 * X, X]), atol=1e-9)
    assert recording.sample_period == 10.0


def test_time_name_value_and_unit(read):
    rows = [f"{i * 0.5};{name};{x};{unit}" for i, x in enumerate(X) for name, unit in (("T", "°C"), ("p", "hPa"))]
    recording = read("time;sensor;value;unit\n" + "\n".join(rows) + "\n")
    assert (recording.names, recording.units) == (("T", "p"), ("°C", "hPa"))
    np.testing.assert_array_equal(recording.values, np.column_stack([X, X]))
    assert recording.sample_period == 0.5
    del rows[9]  # p misses a stamp
    values = read("time;sensor;value;unit\n" + "\n".join(rows) + "\n").values
    assert np.argwhere(np.isnan(values)).tolist() == [[4, 1]]


def test_the_answer_of_thingsboard(read):
    document = {
        key: [{"ts": 1_700_000_000_000 + 5000 * i, "value": str(x)} for i, x in enumerate(X)] for key in ("t", "h")
    }
    assert read(json.dumps(document), "log.json", part="h").names == ("t", "h")
    recording = read(json.dumps(document), "log.json")
    assert recording.names == ("t", "h")
    assert recording.sample_period == 5.0


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
