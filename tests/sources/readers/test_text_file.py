"""What is text, in which encoding, and what is said of that which is none."""

import numpy as np
import pytest

from kalscope.common.progress import Progress
from kalscope.errors import BadFile, Cancelled
from kalscope.sources.reading import recording_file, text_file
from kalscope.sources.reading import rows as csv_rows
from kalscope.sources.reading.recording_file import read_recording
from kalscope.sources.reading.text_file import open_raw

TEXT = "t,T (°C)\n" + "".join(f"{i / 100:.2f},{20 + i / 8:.3f}\n" for i in range(40))
NULS = "must be printable text (got NUL bytes)"


@pytest.mark.parametrize("size", [16, 4096, 500_000])
def test_a_part_that_was_never_written_is_one_rejected_line(read, size):
    text = TEXT.encode()
    report = read(text[:300] + bytes(size) + b"\n" + text[300:].partition(b"\n")[2]).report
    assert (report.rejected, report.issues[0].reason) == (1, NULS)
    assert report.rows >= 38


def test_scattered_nuls_are_refused_by_their_line(read):
    with pytest.raises(BadFile, match="0x00, on line 2"):
        read(b"a,b\n" + b"1\0,\x002,3\0\n" * 50)


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"PK\x03\x04" + bytes(50), "zip archive"),
        (b"RIFF\x24\x00\x00\x00WAVE", "WAV"),
        (b"BZh91AY", "an archive"),
        (bytes(range(256)) * 20, "binary data"),
        (bytes(1000), "0x00, on line 1"),
    ],
)
def test_what_is_no_text_is_named(read, data, what):
    with pytest.raises(BadFile, match=what):
        read(data)


def test_leaving_a_file_early_does_not_wait_for_its_hash(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_bytes(TEXT.encode() + bytes(1 << 21))
    monkeypatch.setattr(text_file, "_CHUNK", 1)
    with open_raw(path, Progress()) as raw:
        pass
    assert isinstance(raw.digest.exception(), Cancelled)


@pytest.mark.parametrize("at", ["_sha256", "plain_lines", "find_encoding"])
def test_a_drive_that_is_pulled_out_is_a_refusal(tmp_path, monkeypatch, at):
    def fail(*_):
        raise OSError(5, "Input/output error")

    path = tmp_path / "log.csv"
    path.write_text("\x1b[0m" + TEXT)
    monkeypatch.setattr(text_file if at == "_sha256" else recording_file, at, fail)
    with pytest.raises(BadFile, match=r"reading .* failed midway: .*Input/output error"):
        read_recording(path)


@pytest.mark.parametrize(
    "middle", [b"9" * 5000, b"\0" * 5000, b"1," * 2500, b"1.5"], ids=["digits", "nul", "cells", "row"]
)
def test_an_endless_line_costs_its_beginning_and_nothing_else(tmp_path, monkeypatch, middle):
    monkeypatch.setattr(text_file, "MAX_LINE", 1000)
    monkeypatch.setattr(csv_rows, "BLOCK_SIZE", 100)
    rows = b"".join(b"%d,%d\n" % (i, i * i % 7) for i in range(300))
    path = tmp_path / "log.csv"
    path.write_bytes(b"t,x\n" + rows + b"300," + middle + b"\n" + rows.replace(b",", b"00,"))
    recording = read_recording(path)
    assert np.count_nonzero(np.isfinite(recording.channel("x"))) == 600 + (middle == b"1.5")
    report = recording.report
    assert report.rejected + report.bad_cells == (middle != b"1.5")
