"""Hostile archives and containers: what a small file unpacks to, claims to hold, or nests."""

from __future__ import annotations

import gzip
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from tests.sources.text_files import PLAIN, READ_ALL, Make, text
from tests.support.hostile_case import Case

MIB = 1 << 20
Files = Callable[[int], Iterator[tuple[str, bytes]]]


def bomb(packer: Callable[[], Any], run: bytes) -> Make:
    """An archive of `run` again and again, of this unpacked size."""
    piece = run * (MIB // len(run))

    def make(path: Path, size: int) -> None:
        pack = packer()
        with path.open("wb") as file:
            file.writelines(map(pack.compress, repeat(piece, max(1, size // MIB))))
            file.write(pack.flush())

    return make


def members(one: bytes) -> Make:
    """A table behind `size` archives of nothing."""

    def make(path: Path, size: int) -> None:
        with path.open("wb") as file:
            file.writelines(repeat(one, size))
            file.write((gzip if path.suffix == ".gz" else zstandard).compress(PLAIN.encode()))

    return make


def nested(path: Path, size: int) -> None:
    """An archive in an archive, and so on."""
    data = PLAIN.encode()
    for _ in range(size):
        data = gzip.compress(data)
    path.write_bytes(data)


def zipped(files: Files, lie: bool = False) -> Make:
    """A zip archive of these files; `lie`: the size that it states of each is 100 bytes."""

    def make(path: Path, size: int) -> None:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in files(size):
                archive.writestr(name, data)
            for info in archive.infolist():
                info.file_size = 100 if lie else info.file_size

    return make


def xlsx(sheet: Callable[[int], str]) -> Make:
    """A workbook with this XML as its only sheet."""
    base = "http://schemas.openxmlformats.org"
    kind = f"{base}/officeDocument/2006/relationships"

    def link(name: str, target: str) -> str:
        one = f'<Relationship Id="r1" Type="{kind}/{name}" Target="{target}"/>'
        return f'<Relationships xmlns="{base}/package/2006/relationships">{one}</Relationships>'

    def files(size: int) -> Iterator[tuple[str, bytes]]:
        yield "[Content_Types].xml", f'<Types xmlns="{base}/package/2006/content-types"/>'.encode()
        yield "_rels/.rels", link("officeDocument", "xl/workbook.xml").encode()
        yield "xl/workbook.xml", (f'<workbook xmlns="{base}/spreadsheetml/2006/main" xmlns:r="{kind}"><sheets>'
            '<sheet name="a" sheetId="1" r:id="r1"/></sheets></workbook>').encode()  # fmt: skip
        yield "xl/_rels/workbook.xml.rels", link("worksheet", "worksheets/sheet1.xml").encode()
        yield "xl/worksheets/sheet1.xml", sheet(size).encode()

    return zipped(files)


def entities(size: int) -> str:
    """Entities of entities: a billion laughs."""
    inner = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, size))
    row = '<row r="{0}"><c r="A{0}" t="inlineStr"><is><t>&e{1};</t></is></c></row>'
    rows = row.format(1, size - 1) + row.format(2, size - 1)
    return f'<!DOCTYPE x [<!ENTITY e0 "1">{inner}]><worksheet><sheetData>{rows}</sheetData></worksheet>'


def equal_cells(size: int) -> str:
    rows = "".join(f'<row r="{i}"><c r="A{i}"><v>1</v></c></row>' for i in range(1, size + 1))
    return f"<worksheet><sheetData>{rows}</sheetData></worksheet>"


def parquet(select: str) -> Make:
    """A Parquet file of one query over `size` rows."""

    def make(path: Path, size: int) -> None:
        import duckdb

        with duckdb.connect(config={"preserve_insertion_order": False}) as connection:
            options = "(FORMAT parquet, ROW_GROUP_SIZE 100000000)"
            connection.execute(f"COPY ({select.format(size=size)}) TO '{path}' {options}")

    return make


def wide_parquet(path: Path, size: int) -> None:
    parquet("SELECT " + ", ".join(f"{i} AS c{i}" for i in range(size)))(path, size)


def broken_parquet(place: slice, data: bytes) -> Make:
    """A Parquet file whose footer is overwritten in this place."""

    def make(path: Path, _: int) -> None:
        parquet("SELECT i, sin(i) AS x FROM range(1000) r(i)")(path, 0)
        whole = bytearray(path.read_bytes())
        whole[place] = data
        path.write_bytes(whole)

    return make


def hdf5(fill: Callable[[Any, int], object]) -> Make:
    def make(path: Path, size: int) -> None:
        import h5py

        with h5py.File(path, "w") as file:
            fill(file, size)

    return make


def deep_groups(file: Any, size: int) -> None:
    group = file
    for _ in range(size):
        group = group.create_group("g")
    group["x"] = np.arange(10.0)


def mat_element(path: Path, size: int) -> None:
    """A variable of ten numbers whose compressed element unpacks to `size` bytes of zeros."""
    flags = struct.pack("<IIII", 6, 8, 6, 0)
    dims = struct.pack("<IIii", 5, 8, 10, 1)
    name = struct.pack("<II8s", 1, 8, b"abcdefgh")
    body = flags + dims + name + struct.pack("<II", 9, size)
    packer = zlib.compressobj(9)
    packed = packer.compress(struct.pack("<II", 14, len(body) + size) + body)
    packed += b"".join(packer.compress(bytes(MIB)) for _ in range(size // MIB)) + packer.flush()
    head = b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + struct.pack("<H2s", 0x100, b"IM")
    path.write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)


def tdms(path: Path, size: int) -> None:
    """One channel that claims `size` numbers and has none."""

    def string(value: bytes) -> bytes:
        return struct.pack("<I", len(value)) + value

    index = struct.pack("<IIIQ", 20, 10, 1, size)
    meta = struct.pack("<I", 1) + string(b"/'g'/'c'") + index + struct.pack("<I", 0)
    path.write_bytes(b"TDSm" + struct.pack("<IIQQ", 0x0E, 4713, len(meta) + 8 * size, len(meta)) + meta)


def json_bomb(inner: str) -> Make:
    """A list of `size` empty things."""

    def make(path: Path, size: int) -> None:
        path.write_text('[{"a": 1}, ' + ",".join(repeat(inner, size)) + "]")

    return make


def deep_json(begin: str, end: str) -> Make:
    return lambda path, size: path.write_text(begin * size + "1" + end * size)


def json_keys(path: Path, size: int) -> None:
    path.write_text(json.dumps([{f"k{i}": i} for i in range(size)]))


MANY = "refused: .* must unpack to at most"
NO_ZIP = "refused: log.zip must hold a table of numbers"
NO_PARQUET = "refused: log.parquet cannot be read as a Parquet file"
ODD_JSON = '[{"x": ' + "9" * 5000 + '}, {"x": 1e999}, {"x": NaN}, {"x": 1.5}]'
ROWS = b"0.5,1.25\n"
GZIP_OF_NOTHING, ZSTD_OF_NOTHING = gzip.compress(b"", mtime=0), zstandard.compress(b"")
INNER = io.BytesIO()
with zipfile.ZipFile(INNER, "w") as _archive:
    _archive.writestr("log.csv", PLAIN)


def gz(name: str, make: Make, expected: str, small: int, big: int, then: str = "", mib: int = 40) -> Case:
    return Case(name, make, expected, small, big, mib, mib, "log.csv.gz", then)


def zst(name: str, make: Make, expected: str, small: int, big: int, then: str = "") -> Case:
    return Case(name, make, expected, small, big, 80, 160, "log.csv.zst", then)


def zip_of(name: str, files: Files, expected: str, small: int, big: int, then: str = "") -> Case:
    return Case(f"zip of {name}", zipped(files), expected, small, big, 60, 100, "log.zip", then)


def container(
    name: str, file: str, make: Make, expected: str, small: int = 1, big: int = 1, big_mib: int = 100
) -> Case:
    return Case(name, make, expected, small, big, 100, big_mib, f"log.{file}")


def never_written(file: Any, size: int) -> None:
    file.create_dataset("x", (size,), "f8", chunks=(1024,))


def packed_small(file: Any, size: int) -> None:
    file.create_dataset("x", data=np.ones(size), compression="gzip", chunks=(min(size, 1 << 20),))


gzipped = partial(zlib.compressobj, 1, wbits=31)
zstandard_packed = zstandard.ZstdCompressor(19).compressobj
TOO_DEEP, NO_TEXT = "refused: .* nested too deep", "refused: .* must be a text file"
PACKED = (
    gz("gzip of zeros", bomb(gzipped, b"\0"), NO_TEXT, 16 * MIB, 2304 * MIB, MANY),
    gz("gzip of rows", bomb(gzipped, ROWS), "read: ", MIB, 2304 * MIB, MANY),
    gz("gzip of one line", bomb(gzipped, b"1,"), "refused: .* of at most 256 columns", 16 * MIB, 1024 * MIB, MANY),
    gz("gzip of many members", members(GZIP_OF_NOTHING), READ_ALL, 2000, 1_000_000),
    gz("gzip in gzip", nested, NO_TEXT, 5, 100),
    zst("Zstandard of zeros", bomb(zstandard_packed, b"\0"), NO_TEXT, 32 * MIB, 2304 * MIB, MANY),
    zst("Zstandard of rows", bomb(zstandard_packed, ROWS), "read: ", MIB, 2304 * MIB, MANY),
    zst("Zstandard of many frames", members(ZSTD_OF_NOTHING), READ_ALL, 2000, 300_000),
    zip_of("zeros", lambda n: iter([("a.csv", bytes(n))]), NO_ZIP, 16 * MIB, 256 * MIB, MANY),
    zip_of("rows", lambda n: iter([("a.csv", ROWS * (n // 9))]), "read: ", MIB, 1100 * MIB, MANY),
    zip_of("tables", lambda n: ((f"{i}.csv", b"") for i in range(n)), "refused: .* at most 1000", 1001, 20_000),
    zip_of("many other files", lambda n: ((f"{i}", b"") for i in range(n)), NO_ZIP, 2000, 60_000),
    zip_of("a zip", lambda _: iter([("log.zip", INNER.getvalue())]), NO_ZIP, 1, 1),
    container("zip whose sizes lie", "zip", zipped(lambda n: iter([("a.csv", ROWS * (n // 9))]), lie=True),
        "refused: .* CRC", MIB, 1024 * MIB),
    container("spreadsheet of entities", "xlsx", xlsx(entities), "refused: .* entity", 10, 30),
    container("spreadsheet of equal cells", "xlsx", xlsx(equal_cells), "read: ", 2000, 300_000, 300),
    container("spreadsheet of zeros", "xlsx", xlsx(lambda n: "\0" * n), "refused: ", 8 * MIB, 600 * MIB),
    container("Parquet cut in its footer", "parquet", broken_parquet(slice(-200, None), b""), NO_PARQUET),
    container("Parquet: a long footer", "parquet", broken_parquet(slice(-8, -4), b"\xff\xff\xff\x7f"), NO_PARQUET),
    container("Parquet: a noisy footer", "parquet", broken_parquet(slice(-120, -20), b"\xa5" * 100), NO_PARQUET),
    container("Parquet of one huge row group", "parquet", parquet("SELECT 1 AS x FROM range({size})"), "read: ",
        500_000, 1 << 24, 3000),
    container("Parquet of too many rows", "parquet", parquet("SELECT 1::TINYINT AS x FROM range({size})"),
        "refused: .* must hold at most", 0, (1 << 28) + 1, 200),
    container("Parquet of many columns", "parquet", wide_parquet, "refused: .* must hold a group", 0, 20_000, 600),
    container("deep JSON", "json", deep_json("[", "]"), TOO_DEEP, 50_000, 10_000_000, 200),
    container("JSON of objects nested deep", "json", deep_json('{"a":', "}"), TOO_DEEP, 50_000, 10_000_000, 200),
    container("JSON of empty lists", "json", json_bomb("[]"), "refused: ", 30_000, 5_000_000, 1000),
    container("JSON of empty objects", "json", json_bomb("{}"), "refused: ", 8_000, 2_000_000, 1500),
    container("JSON of a new key each", "json", json_keys, "refused: ", 2000, 500_000, 600),
    container("JSON of numbers that are none", "json", text(ODD_JSON), "read: 4 rows"),
    container("HDF5 that was never written", "h5", hdf5(never_written), "read: ", 100_000, 1 << 24, 1200),
    container("HDF5 that claims too much", "h5", hdf5(never_written), "refused: .* must hold at most",
        (1 << 28) + 1, 1 << 40),
    container("HDF5 nested deep", "h5", hdf5(deep_groups), "refused: ", 50, 2000),
    container("HDF5 packed small", "h5", hdf5(packed_small), "read: ", 100_000, 1 << 24, 1200),
    container("MATLAB element larger than said", "mat", mat_element, "refused: ", 8 * MIB, 1024 * MIB, 400),
    container("TDMS that claims too much", "tdms", tdms, "refused: ", 1 << 20, 1 << 40),
)  # fmt: skip
