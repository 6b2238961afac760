"""Hostile files: endless texts, numbers that are none, archives that unpack to too much, what is no file."""

from __future__ import annotations

import gzip
import io
import json
import os
import random
import socket
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from tests.support.hostile_case import Case

MIB = 1 << 20
ROWS = [f"{i / 100:.2f},{20 + i % 7}.5,{i % 5}.25\n" for i in range(200)]
READ = r"read: 200 rows, 2 channels, "
READ_ALL = READ + "0 rejected"

Make = Callable[[Path, int], object]


def written(pieces: Callable[[int], Iterable[str]]) -> Make:
    """A file of these pieces."""

    def make(path: Path, size: int) -> None:
        with path.open("w", encoding="utf-8", newline="") as file:
            file.writelines(pieces(size))

    return make


def line_of(run: str, *, alone: bool) -> Make:
    """One line of `size` characters; between rows, or alone and without an end."""
    block = run * max(1, 65536 // len(run))
    above, below = ([], []) if alone else (ROWS[:100], ["x\n", *ROWS[100:]])
    return written(lambda size: (*above, *repeat(block, max(1, size // 65536)), *below))


def text(content: str | bytes) -> Make:
    """This file."""

    def make(path: Path, _: int) -> None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))

    return make


def wide(name: Callable[[int], str]) -> Make:
    """A header and three rows of `size` columns."""
    return written(lambda size: (",".join(map(one, range(size))) + "\n" for one in (name, *["{}.5".format] * 3)))


def noise(letters: bytes) -> Make:
    """`size` random bytes of these."""

    def make(path: Path, size: int) -> None:
        draw = random.Random(7)
        with path.open("wb") as file:
            while size > 0:
                piece = draw.randbytes(min(size, MIB))
                file.write(piece.translate(bytes(letters[i % len(letters)] for i in range(256))))
                size -= len(piece)

    return make


def table(cells: Iterable[str], name: str = "x") -> bytes:
    """A table with plain rows around these cells of its last column."""
    rows = [f"{i},{i % 9}.5\n" for i in range(60)]
    odd = [f"{60 + i},{cell}\n" for i, cell in enumerate(cells)]
    return "".join((f"i,{name}\n", *rows, *odd, *(f"{100 + i},{i}.5\n" for i in range(60)))).encode()


def stamps(form: Callable[[int], str], odd: Iterable[str] = ()) -> bytes:
    """A table with these stamps: plain ones, then those of `odd`."""
    rows = [f"{form(i)},{i % 9}.5\n" for i in range(60)]
    return "".join(("time,x\n", *rows, *(f"{stamp},1.5\n" for stamp in odd))).encode()


PLAIN = "".join(ROWS)
NUMBERS = (
    "1e999", "-1e999", "nan(0x7ff)", "-nan", "NaN123", "infinity", "0x1p3", "1_000", "١٢", "１２", "½", "--1",
)  # fmt: skip
NUMBERS += ("1e", "+", "1e+", ".", "1e-999", "5e-324", "1.7976931348623157e308", "²", "1e0000000000000000005")
NUMBERS += ("9" * 5000, "1" + "0" * 400, "0." + "0" * 5000 + "1", "1e" + "9" * 5000, "0" * 5000 + "1")
DATES = ("0000-01-01 00:00:00", "99999-01-01 00:00:00", "2024-02-30 00:00:00", "2024-13-01 00:00:00")
DATES += ("2024-01-01 24:00:00", "2024-01-01 23:59:60", "2024-01-01 99:99:99", "2024-01-01T00:00:00+99:99")
DATES += ("-2024-01-01 00:00:00", "2024-00-00 00:00:00", "9999-12-31 23:59:59.9999999", "1e308", "nan")
DATES += ("0001-01-01 00:00:00",)
ZONES = ("9999-12-31T23:59:59-23:59", "0001-01-01T00:00:00+23:59")


def one_line(run: str, expected: str) -> Case:
    name = f"one line of `{run.strip() or 'blanks'}`"
    return Case(name, line_of(run, alone=True), expected, 3 * MIB // 2, 500 * MIB)


def between(run: str) -> Case:
    name = f"a line of `{run.strip() or 'blanks'}` between rows"
    return Case(name, line_of(run, alone=False), READ + "1 rejected", 5 * MIB // 4, 500 * MIB)


def endless(name: str, line: Callable[[int], str], expected: str, small: int, big: int, big_mib: int = 80) -> Case:
    return Case(
        name, written(lambda size: map(line, range(size))), expected, small, big, big_mib=big_mib, file="log.txt"
    )


def content(name: str, data: str | bytes, expected: str) -> Case:
    return Case(name, text(data), expected)


def with_name(size: int) -> Iterable[str]:
    """A table whose first column has a name of this length."""
    return ("n" * size + ",y\n", *(f"{i}.5,2\n" for i in range(50)))


def short(line: str) -> Case:
    """This line over and over; above 32 kB a file is read in blocks."""
    name = line.strip().replace("\n", " ") or " "
    few = max(4_000, (1 << 15) // len(line) + 1)
    return Case(
        f"lines of `{name}`", written(lambda size: repeat(line, size)), ".*", few, 500_000, mib=60, big_mib=200
    )


WIDE = "refused: log.csv must be a table of numbers, of at most 256 columns"
NO_TABLE = "refused: log.* must be a table of numbers, one sample per line"
NO_ROWS = "refused: log.csv must hold numbers below its header"
NO_LINES = "refused: log.* must hold lines of numbers"
NO_TEXT = "refused: log.csv must be a text file"
LETTERS = bytes(range(32, 127)) + b"\n\n\n"
MARKS = b"0123456789.,;:-+eE\t\n\n\n\n"
SHORT = (
    "a\n", "[]\n", "1x\n", "a:\n", "a=1x\n", '"\n', ">a:1\n", "$1*\n", "-\n", "1,2a\n1\n", "12:00\n", "\n", "#\n",
)  # fmt: skip
WIDTHS = "".join(("1,2\n" * 10, "1,2,3\n" * 10, "1,2,3,4,5\n" * 4, "1,2,3\n" * 10, "1,2\n" * 10))
TEXTS = (
    one_line("1", "refused: log.csv must hold at least one number"),
    one_line("1,", WIDE),
    one_line(" ", NO_LINES),
    one_line('"', NO_ROWS),
    one_line('"1",', WIDE),
    one_line("a:1 ", NO_ROWS),
    one_line("\0", NO_TEXT),
    one_line("[", NO_ROWS),
    *map(between, ("1", "1,", " ", '"', "a:1 ", "[")),
    Case("`# unit`, blanks", written(lambda n: ("# unit" + " " * n + "x\n", PLAIN)), READ_ALL, 60_000,
        MIB - 60_000),
    Case("many columns", wide("c{}".format), WIDE, 20_000, 100_000, then=NO_ROWS),
    Case("many columns of one name", wide("a".format), WIDE, 20_000, 1_000_000, then=NO_ROWS),
    Case("256 columns of one name", wide("a".format), "read: 3 rows, 256 channels, 0 rejected", 256, 256),
    Case("a long name", written(with_name), "read: 50 rows, 2 channels", MIB // 2, 10 * MIB, then=NO_ROWS),
    Case("an open quote", written(lambda size: (*ROWS[:50], '1,"2,3\n', *repeat(PLAIN, size))),
        "read: [0-9]+ rows, 3 channels, 0 rejected", 10, 20_000, big_mib=300),
    endless("a new label on each line", "a{0}:{0}\n".format, NO_TABLE, 7_000, 1_000_000),
    endless("a new name on each row", lambda i: f"{i},n{i},{i % 7}.5\n", "read: ", 10_000, 1_000_000),
    endless("a new width on each line", lambda i: ",".join(repeat("1", i % 2000)) + "\n", NO_TABLE, 400, 100_000),
    endless("headers without end", "a{},b,c\n".format, NO_TABLE, 10_000, 5_000_000),
    endless("comments without end", "# a{}\n".format, NO_LINES, 20_000, 5_000_000),
    endless("text without end", "the {} quick brown foxes\n".format, "read: ", 20_000, 5_000_000, 400),
    endless("an open quote on each line", '1,"{},3\n'.format, "read: ", 4_000, 1_000_000, 200),
    endless("quotes in quotes", lambda i: '"' * (i % 400) + f"{i},2\n", "read: ", 5000, 200_000),
    *map(short, SHORT),
    content("rows of three widths in turn", WIDTHS, "read: "),
    Case("random bytes", noise(bytes(range(256))), NO_TEXT, 2 * MIB, 100 * MIB),
    Case("random letters", noise(LETTERS), "re(fus|a)", MIB // 64, 20 * MIB, big_mib=200),
    Case("random marks of numbers", noise(MARKS), "re(fus|a)", MIB // 128, 4 * MIB, big_mib=200),
    content("UTF-16 of odd length", PLAIN.encode("utf-16") + b"1", READ + "1 rejected"),
    content("half a pair", b"\xff\xfe" + PLAIN.encode("utf-16-le") + b"\0\xd8,\x001\0\n\0", READ + "1 rejected"),
    content("UTF-16 under the mark of the other", b"\xfe\xff" + PLAIN.encode("utf-16-le"), NO_ROWS),
    content("the mark of UTF-16 alone", b"\xff\xfe", NO_LINES),
    content("UTF-32", PLAIN.encode("utf-32"), NO_TABLE),
    content("UTF-8 with half a pair", PLAIN + "\ud800,1,2\n", READ + "1 rejected"),
    content("the mark of UTF-8 on each line", "\ufeff" + PLAIN.replace("\n", "\n\ufeff"), "read: 200 rows"),
    content("numbers that are none", table(NUMBERS), "read: 146 rows, 2 channels, 0 rejected"),
    content("no dates", stamps("2024-03-01 00:00:{:02}".format, DATES), "read: 63 rows, 1 channels, 11 rejected"),
    content("stamps at the ends of the calendar", stamps("2024-03-01T00:00:{:02}Z".format, ZONES), "read: 62 rows"),
    content("years 0 and 99999", stamps("0000-00-{:02}".format) + stamps("99999-01-{:02}".format), "read: "),
    content("stamps at the ends of float64", stamps(lambda i: f"{(-1) ** i}.7e308"), "read: 60 rows"),
    content("samples at the ends of float64", table([f"{(-1) ** i}.7e308" for i in range(40)]), "read: 160 rows"),
    content("stamps as fine as numbers go", stamps("{}e-320".format), "read: 60 rows"),
)  # fmt: skip


ORDINARY = "refused: file must be an ordinary file"


def link_to(target: str) -> Callable[[Path, int], None]:
    return lambda path, _: path.symlink_to(target)


def listening(path: Path, _: int) -> None:
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(os.path.relpath(path))  # a path of a socket has 107 letters at most


def rows(path: Path, size: int) -> None:
    path.write_text("".join(f"{i},{i % 7}.5\n" for i in range(size)))


def grow(path: Path) -> None:
    with path.open("a") as file:
        file.writelines(f"{i},{i % 7}.5\n" for i in range(1000))


def overwrite(path: Path) -> None:
    path.write_bytes(bytes(range(256)) * 4096)


def shrink(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def empty(path: Path) -> None:
    os.truncate(path, 0)


def changed(name: str, change: Callable[[Path], object], expected: str) -> Case:
    return Case(f"a file that {name}", rows, expected, 5000, 500_000, during=change)


SPECIAL = (
    Case("a pipe", lambda path, _: os.mkfifo(path), ORDINARY),
    Case("a socket", listening, ORDINARY),
    Case("/dev/zero", link_to("/dev/zero"), ORDINARY),
    Case("/dev/tty", link_to("/dev/tty"), ORDINARY),
    Case("a link to itself", link_to("log.csv"), "refused: cannot read"),
    Case("the memory of the process", link_to("/proc/self/mem"), "refused: "),
    changed("grows", grow, "read: [0-9]+ rows"),
    changed("shrinks", shrink, "read: [0-9]+ rows"),
    changed("is emptied", empty, "refused: log.csv must hold a whole line"),
    changed("vanishes", os.unlink, "refused: reading .* failed midway"),
    changed("becomes noise", overwrite, "refused: log.csv must hold a whole line"),
)  # fmt: skip


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
PAIRS = b"0.5,1.25\n"
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
TOO_DEEP, BINARY_FILE = "refused: .* nested too deep", "refused: .* must be a text file"
PACKED = (
    gz("gzip of zeros", bomb(gzipped, b"\0"), BINARY_FILE, 16 * MIB, 2304 * MIB, MANY),
    gz("gzip of rows", bomb(gzipped, PAIRS), "read: ", MIB, 2304 * MIB, MANY),
    gz("gzip of one line", bomb(gzipped, b"1,"), "refused: .* of at most 256 columns", 16 * MIB, 1024 * MIB, MANY),
    gz("gzip of many members", members(GZIP_OF_NOTHING), READ_ALL, 2000, 1_000_000),
    gz("gzip in gzip", nested, BINARY_FILE, 5, 100),
    zst("Zstandard of zeros", bomb(zstandard_packed, b"\0"), BINARY_FILE, 32 * MIB, 2304 * MIB, MANY),
    zst("Zstandard of rows", bomb(zstandard_packed, PAIRS), "read: ", MIB, 2304 * MIB, MANY),
    zst("Zstandard of many frames", members(ZSTD_OF_NOTHING), READ_ALL, 2000, 300_000),
    zip_of("zeros", lambda n: iter([("a.csv", bytes(n))]), NO_ZIP, 16 * MIB, 256 * MIB, MANY),
    zip_of("rows", lambda n: iter([("a.csv", PAIRS * (n // 9))]), "read: ", MIB, 1100 * MIB, MANY),
    zip_of("tables", lambda n: ((f"{i}.csv", b"") for i in range(n)), "refused: .* at most 1000", 1001, 20_000),
    zip_of("many other files", lambda n: ((f"{i}", b"") for i in range(n)), NO_ZIP, 2000, 60_000),
    zip_of("a zip", lambda _: iter([("log.zip", INNER.getvalue())]), NO_ZIP, 1, 1),
    container("zip whose sizes lie", "zip", zipped(lambda n: iter([("a.csv", PAIRS * (n // 9))]), lie=True),
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
