"""What a file holds: bytes, lines, the order of its rows, one value a row, codes for missing samples."""

import itertools
import json
import math
from datetime import datetime, timedelta
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.waiting import PATIENCE

from kalscope.common import files
from kalscope.common.progress import Progress
from kalscope.errors import BadFile, BadSetting, Cancelled, NoMemory
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading import recording_file, text_file
from kalscope.sources.reading import rows as csv_rows
from kalscope.sources.reading.recording_file import find_missing, read_recording
from kalscope.sources.reading.text_file import open_raw


def test_a_cell_that_is_no_number_is_a_missing_sample_with_line_column_and_text(read):
    recording = read("t,a,b\n0,1,2\n1,12abc,3\n2,0x1F,Infinity\n3,,nil\n4,5,6\n")
    np.testing.assert_array_equal(recording.values[:, 0], [1, math.nan, math.nan, math.nan, 5])
    np.testing.assert_array_equal(recording.values[:, 1], [2, 3, math.nan, math.nan, 6])
    assert recording.report.bad_cells == 3
    found = [(issue.line, issue.column, issue.text) for issue in recording.report.issues]
    assert found == [(3, "a", "12abc"), (4, "a", "0x1F"), (4, "b", "Infinity")]


def test_a_line_of_the_wrong_shape_is_rejected_and_without_stamps_leaves_one_missing_sample(read):
    recording = read("t,a,b\n0.0,1,2\n0.1,1\n0.2,1,2,3\n0.3,1,2\n")
    assert recording.time.tolist() == [0.0, 0.3]
    assert [issue.line for issue in recording.report.issues] == [3, 4]
    recording = read("a,b\n1,2\n3\n4,5\n")
    np.testing.assert_array_equal(recording.values, [[1, 2], [math.nan, math.nan], [4, 5]])
    assert (recording.time.tolist(), recording.sample_period) == ([0, 1, 2], None)
    assert (recording.report.rows, recording.report.rejected) == (2, 1)


def test_a_last_line_without_newline_is_kept_where_it_has_all_its_values(read):
    for last, kept in {"20,12": 1, "20,1.25": 1, "20,1.2": 0, "20,": 0, "20": 0, "20,1.25x": 0}.items():
        usual = "1.25" if "." in last else "125"
        report = read("t,a\n" + "".join(f"{i},{usual}\n" for i in range(20)) + last).report
        assert (report.rows, report.rejected) == (20 + kept, 1 - kept)
        assert kept or "torn" in report.issues[-1].reason


def test_the_last_line_of_a_file_that_grows_is_torn(tmp_path, monkeypatch):
    path, read_block = tmp_path / "log.csv", csv_rows._read_block
    rows = "t,a\n" + "".join(f"{i},125\n" for i in range(20)) + "20,12"
    path.write_text(rows)
    monkeypatch.setattr(csv_rows, "_read_block", lambda text: (read_block(text), path.write_text(rows + "5\n"))[0])
    assert read_recording(path).report.rejected >= 1


def test_comments_blank_lines_and_repeated_headers_are_counted_as_such(read):
    report = read("# c\nt,a\n\n0,1\n% c\n// c\nt,a\n  \n1,2\n,\n").report
    assert (report.comments, report.blank, report.headers, report.rows, report.rejected) == (3, 3, 2, 2, 0)


@pytest.mark.parametrize("period", [0, -1, math.nan, math.inf, 1e-60, "long"])
def test_a_sample_period_must_be_positive_and_finite_which_is_checked_before_the_file_is_opened(period):
    with pytest.raises(BadSetting, match="sample period must be"):
        read_recording("no such file", sample_period=period)


def test_the_first_hundred_issues_are_kept_and_all_are_counted(read):
    report = read("t,a\n" + "".join(f"{i},{f'E{i}' if i % 2 else i}\n" for i in range(1000))).report
    assert (report.bad_cells, len(report.issues), report.issues[0].line) == (500, 100, 3)


def test_a_missing_file_a_folder_and_an_impossible_name_are_bad_files(tmp_path):
    for path, said in {
        "none": "not found",
        tmp_path: "folder",
        "a\0b": "cannot read",
        "x" * 5000: "cannot",
    }.items():
        with pytest.raises(BadFile, match=said):
            read_recording(path)


@pytest.mark.slow
@given(st.binary(max_size=60))
def test_a_damaged_gzip_archive_is_a_bad_file(tmp_path_factory, tail):
    path = tmp_path_factory.getbasetemp() / "any.gz"
    path.write_bytes(b"\x1f\x8b\x08" + tail)
    with pytest.raises(BadFile):
        read_recording(path)


@pytest.mark.slow
@pytest.mark.parametrize(("blank", "minus"), [(" ", "-"), ("\u00a0", "\u2212"), ("\u202f", "\u2212")])
def test_blanks_that_do_not_break_and_the_minus_sign_of_typography(read, blank, minus):
    times = [datetime(2024, 2, 29, 9) + timedelta(minutes=20 * i) for i in range(60)]
    stamps = [time.strftime(f"%m/%d/%Y, %I:%M:%S{blank}%p") for time in times]
    text = "".join(f"{stamp};{minus}{i}.5{blank}\n" for i, stamp in enumerate(stamps))
    recording = read(f"Date/Time;sea{blank}level{blank}(m)\n{text}")
    assert (recording.names, recording.units) == (("sea level",), ("m",))
    np.testing.assert_array_equal(recording.values[:, 0], [-i - 0.5 for i in range(60)])
    assert recording.sample_period == 1200.0
    assert recording.report.bad_cells == recording.report.rejected == 0


STAMPS = {
    "seconds": lambda i: f"{10 * i}.00",
    "dates": lambda i: f"2024-02-29 12:{10 * i // 60:02}:{10 * i % 60:02}",
    "a clock": lambda i: str(timedelta(seconds=(86000 + 10 * i) % 86400)).zfill(8),
}


@pytest.mark.slow
@pytest.mark.parametrize("stamp", STAMPS)
@pytest.mark.parametrize("page", [1, 3, 120])
@pytest.mark.parametrize("is_newest_first", [True, False])
def test_rows_in_pages_are_put_in_order_of_time(read, stamp, page, is_newest_first):
    rows = [f"{STAMPS[stamp](i)},{i * i}\n" for i in range(240)]
    rows.insert(7, rows[7])  # a repeated row keeps its place
    oldest = read("time,a\n" + "".join(rows))
    pages = [rows[i : i + page] for i in range(0, len(rows), page)]
    turned = [row[::-1] for row in pages] if is_newest_first and page > 1 else pages[::-1]
    newest = read("time,a\n" + "".join(itertools.chain(*turned)))
    np.testing.assert_array_equal(newest.time, oldest.time)
    np.testing.assert_array_equal(newest.values, oldest.values)
    assert newest.sample_period == 10.0
    assert any("put in order of time" in note for note in newest.report.notes)
    assert newest.report.rows == newest.report.lines - 1 == len(rows)


def test_the_runs_of_a_device_that_restarts_keep_their_order(read):
    stamps = [100 * i + i % 2 for _ in range(8) for i in range(12)]
    report = read("ms,a\n" + "".join(f"{stamp},{i % 7}\n" for i, stamp in enumerate(stamps))).report
    assert report.clipped_times == 7
    assert any("back 7 times" in note for note in report.notes)


@pytest.mark.slow
def test_a_log_that_will_not_fit_into_memory_is_refused_by_its_first_part(tmp_path, monkeypatch):
    path, seen, need = tmp_path / "log.csv", [], files.MEMORY_FACTOR * 16 * 40_000
    path.write_text("t,a,note\n" + "".join(f"{i},{i % 7}.5,text\n" for i in range(40_000)))
    monkeypatch.setattr(csv_rows, "BLOCK_SIZE", 1 << 16)
    monkeypatch.setattr(files, "free_memory", lambda: need)
    assert len(read_recording(path)) == 40_000
    monkeypatch.setattr(files, "free_memory", lambda: 0.5 * need)
    said = r"^log.csv must fit into the memory that is free, 0.0 GB \(got 0.0 GB of text"
    with pytest.raises(NoMemory, match=said):
        read_recording(path, progress=lambda done, _: seen.append(done))
    assert max(seen) < 0.5


@pytest.mark.slow
def test_a_header_far_below_a_long_preamble_names_the_columns(read):
    """As a log of PuTTY with carriage returns only: line numbers below the head are not those of the file."""
    rows = [f"{i},{20 + i % 7}" for i in range(20_000)]
    above = ["=~=~=~=~= PuTTY log 2020.01.01 12:00:00 =~=~=~=~=", "boot,1", "wifi,2", "ERR,5", "up,3"]
    above += ["# no sensor"] * (len("\r".join(rows)) // len("# no sensor\r"))
    recording = read("\r".join([*above, "millis,temp", *rows, ""]))
    assert (recording.names, len(recording)) == (("temp",), 20_000)
    assert f"names from line {len(above) + 1}" in recording.report.notes


TEXT = "t,T (°C)\n" + "".join(f"{i / 100:.2f},{20 + i / 8:.3f}\n" for i in range(40))


@pytest.mark.slow
@pytest.mark.parametrize("size", [16, 500_000])
def test_a_part_that_was_never_written_is_one_rejected_line(read, size):
    text = TEXT.encode()
    report = read(text[:300] + bytes(size) + b"\n" + text[300:].partition(b"\n")[2]).report
    assert (report.rejected, report.issues[0].reason) == (1, "must be printable text (got NUL bytes)")
    assert report.rows >= 38


NO_TEXTS = {
    b"PK\x03\x04" + bytes(50): "zip archive", b"RIFF\x24\x00\x00\x00WAVE": "WAV", b"BZh91AY": "an archive",
    bytes(range(256)) * 20: "binary data", bytes(1000): "0x00, on line 1",
}  # fmt: skip


def test_what_is_no_text_is_named(read):
    for data, what in NO_TEXTS.items():
        with pytest.raises(BadFile, match=what):
            read(data)


def test_leaving_a_file_early_does_not_wait_for_its_hash(tmp_path, monkeypatch):
    path, read_hash = tmp_path / "log.csv", text_file._sha256
    path.write_text(TEXT)
    monkeypatch.setattr(text_file, "_sha256", lambda path, left: left.wait(PATIENCE) and read_hash(path, left))
    with open_raw(path, Progress()) as raw:
        pass
    assert isinstance(raw.digest.exception(), Cancelled)


@pytest.mark.parametrize("at", ["_sha256", "plain_lines", "find_encoding"])
def test_a_drive_that_is_pulled_out_is_a_refusal(read, monkeypatch, at):
    fail = Mock(side_effect=OSError(5, "Input/output error"))
    monkeypatch.setattr(text_file if at == "_sha256" else recording_file, at, fail)
    with pytest.raises(BadFile, match=r"reading .* failed midway: .*Input/output error"):
        read("\x1b[0m" + TEXT)


@pytest.mark.parametrize("middle", [b"9" * 5000, b"\0" * 5000, b"1," * 2500, b"1.5"], ids=len)
def test_an_endless_line_costs_its_beginning_and_nothing_else(read, monkeypatch, middle):
    monkeypatch.setattr(text_file, "MAX_LINE", 1000)
    monkeypatch.setattr(csv_rows, "BLOCK_SIZE", 100)
    rows = b"".join(b"%d,%d\n" % (i, i * i % 7) for i in range(300))
    recording = read(b"t,x\n" + rows + b"300," + middle + b"\n" + rows.replace(b",", b"00,"))
    assert np.count_nonzero(np.isfinite(recording.channel("x"))) == 600 + (middle == b"1.5")
    report = recording.report
    assert report.rejected + report.bad_cells == (middle != b"1.5")


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


def test_a_name_that_misses_a_stamp_has_a_missing_sample_there(read):
    rows = [f"{i * 0.5};{name};{x};{unit}" for i, x in enumerate(X) for name, unit in (("T", "°C"), ("p", "hPa"))]
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


N = 3000
RNG = np.random.default_rng(5)
WALK = 20.0 + np.cumsum(RNG.normal(0.0, 0.05, N))
ROWS = np.arange(N)


def asked(*channels):
    values = np.column_stack([np.asarray(channel, dtype=float) for channel in channels])
    names = [f"c{i}" for i in range(values.shape[1])]
    questions = find_missing(values, names, (np.nanmin(values, axis=0), np.nanmax(values, axis=0)))
    return [float(question.split()[1]) for question in questions]


def at_moments(signal, code, every=97, long=1):
    return np.where(ROWS % every < long, code, signal)


@pytest.mark.parametrize("code", [-999.0, -9999.9, 9999.0, -888.0])
@pytest.mark.parametrize("every", [3, N])
def test_nines_that_are_very_far_from_the_rest_are_missing_samples(tmp_path, code, every):
    near, wide = at_moments(WALK, code, every), at_moments(2000.0 * WALK, code, every)
    values = np.column_stack([near, wide])
    note, *_ = find_missing(values, ["near", "wide"], (values.min(axis=0), values.max(axis=0)))
    assert note.startswith(f"{code:.15g} is a missing value: it occurs")
    assert np.array_equal(np.isnan(values), np.column_stack([near == code, np.zeros(N)]))
    log = tmp_path / "a.csv"
    log.write_text("a\n" + "".join(f"{z}\n" for z in near))
    counts = [np.isnan(read_recording(log, ReadOptions(missing=said)).values).sum() for said in ((), ("none",))]
    assert counts == [(near == code).sum(), 0]


SURE = [999.9, 888.0, -200.0, -127.0, 85.0, -7999.0, 32767.0, -32768.0, 65535.0, 1e30]


@pytest.mark.parametrize("code", SURE)
@pytest.mark.parametrize("long", [1, 60])
def test_a_code_is_asked_about_however_long_it_lasts(code, long):
    assert asked(at_moments(WALK, code, long=long)) == [code]


@pytest.mark.parametrize("code", [0.0, -1.0, 400.0, 20000.0, 255.0])
def test_a_number_that_may_be_a_reading_is_one_unless_it_comes_for_moments(code):
    far = np.where(code == 0.0, 300.0, 50.0) + WALK
    assert asked(at_moments(far, code)) == [code]
    assert asked(at_moments(far, code, long=30)) == []


LIGHT = np.maximum(0.0, 900.0 * np.sin(ROWS / 200))
STATES = {
    "no light at night": LIGHT,
    "a motor that stands still": np.where(ROWS // 250 % 2, 563.0 + RNG.normal(0.0, 2.0, N), 0.0),
    "a motor at half duty": np.where(ROWS % 2, 563.0 + RNG.normal(0.0, 2.0, N), 0.0),
    "a signal that is cut off": np.clip(40.0 * np.sin(ROWS / 30), -20.0, 30.0),
    "a range of the converter": np.clip(np.rint(600.0 + 30.0 * WALK), 0.0, 1023.0),
    "a percentage": np.clip(60.0 + 60.0 * np.sin(ROWS / 90), 0.0, 100.0),
    "a switch": ROWS % 2,
    "a step that stays": np.where(ROWS > 2000, 400.0, WALK),
    "a step of a reference": np.where(ROWS // 60 % 7 == 3, 200.0, WALK),
    **{f"{code}, which is no code": at_moments(WALK, code) for code in (10.5, 563.0, -12.25, 71.3, 1234.0)},
    "once is chance": np.where(ROWS == 77, 888.0, WALK),
}


@pytest.mark.parametrize("signal", STATES.values(), ids=STATES)
def test_states_and_readings_raise_no_question(signal):
    assert asked(signal) == []


def test_a_code_of_several_channels_is_one_question_and_missing_samples_around_it_do_not_matter():
    values = np.column_stack([at_moments(WALK, 888.0), at_moments(WALK[::-1], 888.0), WALK])
    (question,) = find_missing(values, ["a", "b", "c"], (values.min(axis=0), values.max(axis=0)))
    assert 'times in "a", "b", far from' in question
    assert question.endswith("--missing 888")
    assert asked(np.where(RNG.random(N) < 0.05, np.nan, at_moments(WALK, 400.0))) == [400.0]
    assert asked(np.full(N, -999.0)) == []
    assert find_missing(np.full((5, 1), np.nan), ["a"], (np.array([np.nan]),) * 2) == []
