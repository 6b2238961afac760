"""JSON documents and zip archives: each table reads as it does alone, and what holds none is refused."""

import json
import zipfile

import numpy as np
import pytest

from kalscope.common import files
from kalscope.errors import BadFile, BadSetting, NoMemory
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading.recording_file import read_recording

X = [round(0.5 * i, 3) for i in range(12)]


@pytest.fixture
def read_json(read):
    def read_document(document, part=None, **how):
        return read(document if isinstance(document, str) else json.dumps(document, **how), "log.json", part=part)

    return read_document


def test_the_pairs_of_prometheus(read_json):
    values = [[1.7e9 + 15 * i, str(x)] for i, x in enumerate(X)]
    result = [{"metric": {"__name__": "temp", "host": host}, "values": values} for host in ("a", "b")]
    recording = read_json({"status": "success", "data": {"resultType": "matrix", "result": result}})
    assert (recording.names, recording.sample_period) == (("temp a", "temp b"), 15.0)
    np.testing.assert_array_equal(recording.values[:, 1], X)


def test_the_longest_list_is_read_and_another_by_name(read_json):
    document = {"a": [{"t": 0, "x": 1}, {"t": 1, "x": 2}], "b": {"c": [{"t": i, "y": x} for i, x in enumerate(X)]}}
    assert read_json(document).names == ("y",)
    assert read_json(document, "a").names == ("x",)
    with pytest.raises(BadSetting, match=r'"b\.c"'):
        read_json(document, "d")


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '[{"a": 1}, {"a"', "{}", '{"a": 5}', "[]", '[{"a": "b"}]', "[1, 2", '{"']
)
def test_a_document_without_samples_is_refused(read_json, text):
    with pytest.raises(BadFile):
        read_json(text)


def test_a_document_that_will_not_fit_into_memory_is_refused_before_it_is_parsed(read_json, monkeypatch):
    document = [{"t": i, "x": x} for i, x in enumerate(X)]
    monkeypatch.setattr(files, "free_memory", lambda: 10_000)
    assert len(read_json(document)) == len(X)
    monkeypatch.setattr(files, "free_memory", lambda: 4_000)
    with pytest.raises(NoMemory, match=r"^log.json must fit into the memory that is free.*one object per line$"):
        read_json(document)


ACCELERATION = '"Time (s)","Acceleration x (m/s^2)","Absolute (m/s^2)"\n' + "".join(
    f"{i / 100:.3E},{np.sin(i):.6E},{9.81 + i % 7:.6E}\n" for i in range(300)
)
PRESSURE = "time;Druck (hPa)\n" + "".join(f"{i / 10:.1f};{1013 + i % 5},5\n" for i in range(60)).replace(".", ",")
DEVICE = '"property","value"\n' + "".join(f'"name {i}","Pixel {i}"\n' for i in range(500)) + '"version","1.1"\n'


@pytest.fixture
def archive(tmp_path):
    def write(**files):
        path = tmp_path / "phone.zip"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
            for name, text in files.items():
                out.writestr(name, text)
        return path

    return write


def assert_same(recording, expected):
    for name in ("names", "units", "sample_period"):
        assert getattr(recording, name) == getattr(expected, name)
    np.testing.assert_array_equal(recording.values, expected.values)
    np.testing.assert_array_equal(recording.time, expected.time)


@pytest.mark.slow
def test_the_table_with_most_numbers_is_read_and_the_others_are_named(archive, read):
    path = archive(**{"Pressure.csv": PRESSURE, "Raw Data.csv": ACCELERATION, "meta/device.csv": DEVICE})
    recording = read_recording(path)
    assert_same(recording, read(ACCELERATION))
    assert recording.sample_period == 0.01
    said = "\n".join(recording.report.notes)
    assert 'line numbers count in "Raw Data.csv"' in said
    assert '--part NAME chooses another: "Pressure.csv" (' in said
    for part in ("Pressure.csv", "sure.csv"):
        assert_same(read_recording(path, ReadOptions(part=part)), read(PRESSURE))
    with pytest.raises(BadSetting, match=r'part must be one table of .*"Raw Data.csv"'):
        read_recording(path, ReadOptions(part="Gyroscope.csv"))


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
def test_a_single_table_needs_no_choice_in_any_encoding(archive, read, encoding):
    text = "t,temp (°C)\r\n" + "".join(f"{i},{20 + i % 3}.5\r\n" for i in range(50))
    recording = read_recording(archive(**{"._log.csv": "1,2\n" * 900, "log.csv": text.encode(encoding)}))
    assert_same(recording, read(text))
    assert recording.units == ("°C",)
    assert not any("--part" in note for note in recording.report.notes)


@pytest.mark.parametrize(
    ("files", "got"),
    [({"a.png": b"\x89PNG"}, "a.png"), ({"readme.txt": "hello\nworld\n"}, "readme.txt"), ({}, "nothing")],
)
def test_an_archive_without_a_table_is_refused_by_what_it_holds(archive, files, got):
    with pytest.raises(BadFile, match=rf"phone.zip must hold a table of numbers, .*\(got a zip archive of {got}\)"):
        read_recording(archive(**files))


def test_what_unpacks_without_a_bound_or_lies_about_its_size_or_needs_a_password_is_refused(archive):
    path = archive(**{"log.csv": ACCELERATION})
    data, size = path.read_bytes(), len(ACCELERATION).to_bytes(4, "little")
    locked = bytearray(data)
    for at in (6, data.find(b"PK\1\2") + 8):
        locked[at] |= 1
    for packed, said in (
        (data.replace(size, (100).to_bytes(4, "little")), "cannot be read as a zip archive"),
        (locked, r"without a password \(got log\.csv\)"),
    ):
        path.write_bytes(packed)
        with pytest.raises(BadFile, match=said):
            read_recording(path)
    for packing in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        with zipfile.ZipFile(path, "w", packing) as out:
            out.writestr("log.csv", ACCELERATION)
        with pytest.raises(BadFile, match=r"packed by Deflate, .*got log\.csv"):
            read_recording(path)


@pytest.mark.slow
def test_what_is_said_of_names_is_printable(archive):
    name = "../../\x1b[31mevil\r\n\x07"
    recording = read_recording(archive(**{f"{name}.csv": ACCELERATION}))
    assert any('"../../ [31mevil .csv"' in note for note in recording.report.notes)
    assert all(note.isprintable() for note in recording.report.notes)
    with pytest.raises(BadFile) as refused:
        read_recording(archive(**{f"{name}.png": "x"}))
    assert str(refused.value).isprintable()
