"""A file as lines of text: what a packed file holds, where its bytes are, their encoding."""

from __future__ import annotations

import codecs
import hashlib
import io
import json
import re
import zlib
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import chain, count
from pathlib import Path
from threading import Event
from typing import Any, BinaryIO, TextIO

from kalscope.common.files import temporary_folder
from kalscope.common.progress import Progress
from kalscope.errors import BadFile, Cancelled, reason_of
from kalscope.sources.grammar.cells import is_blank
from kalscope.sources.grammar.line_format import ESCAPE, find_pairs, split_checksum, without_escapes
from kalscope.sources.grammar.timestamps import is_stamp

# What a packed file holds: gzip and Zstandard, bounded, with progress, and refused when cut short.


GZIP = b"\x1f\x8b"
ZSTANDARD = b"\x28\xb5\x2f\xfd"


def unpacked(path: Path, name: str, progress: Progress) -> Iterator[bytes]:
    """The content of all archives that are joined in a file, in pieces; zeros after each are skipped.

    Raises:
        BadFile: it is cut short or damaged, or unpacks to too much.
    """
    with path.open("rb") as file:
        size, kind = max(path.stat().st_size, 1), "gzip" if file.read(2) == GZIP else "Zstandard"
        file.seek(0)
        zstandard: Any = import_module("zstandard") if kind == "Zstandard" else None
        error: type[Exception] = zstandard.ZstdError if zstandard else zlib.error

        def unpacker() -> Any:
            if zstandard:
                return zstandard.ZstdDecompressor().decompressobj()
            return zlib.decompressobj(16 + zlib.MAX_WBITS)

        stream = unpacker()
        try:
            # 1 KiB of Zstandard holds 32 MiB of zeros, 4 KiB of gzip 4 MiB.
            while packed := file.read(1 << 10):
                # A tape fills its blocks with zeros.
                while packed := packed.lstrip(b"\0") if stream.eof else packed:
                    stream = unpacker() if stream.eof else stream
                    piece = stream.decompress(packed)
                    progress(0.5 * file.tell() / size, "unpacking")
                    progress.unpack(len(piece))
                    yield piece
                    packed = stream.unused_data
            if not stream.eof:
                raise error("it is cut short")
        except error as damage:
            raise BadFile(f"{name} cannot be read as a {kind} archive: {damage}") from None


# A file as lines of text: where its bytes are, their encoding, and what is not text at all.


HEAD_BYTES = 1 << 20
"""Bytes from which the form of a file is detected."""

_FOREIGN = {
    **dict.fromkeys((GZIP, ZSTANDARD), "an archive in an archive, which must be unpacked first"),
    **dict.fromkeys((b"7z\xbc\xaf", b"Rar!", b"BZh", b"\xfd7zXZ"), "an archive, which must be unpacked first"),
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"%PDF": "a PDF document",
    b"RIFF": "a WAV or AVI file",
    b"CDF": "a NetCDF file: xarray.open_dataset(…).to_dataframe().to_csv(…) writes it as CSV",
    b"H Product:Blackbox": "a Betaflight blackbox log: blackbox_decode FILE writes it as CSV",
    b"netcdf ": "the text of a NetCDF file: ncgen makes it one, xarray.open_dataset(…).to_dataframe() a table",
    b"ARROW1": "an Arrow file, which can be written as Parquet",
    b"version https://git-lfs": "a Git LFS pointer, which `git lfs pull` replaces with the file itself",
}
_HEAD = 1 << 16
"""Bytes that are looked at to find out whether a file is text or binary."""
_FRAMED = re.compile(rb"\x02([^\x02\x03\n]{1,400})\x03(?=.{0,3}$)", re.MULTILINE)
_CONTROL = re.compile(rb"[\x00-\x08\x0b\x0e-\x1f]")


MAX_LINE = 1 << 20
"""Characters of a line that are read."""
CUT = "\ufffd"
"""What ends the last cell of a longer line, so that it is not a number."""

SAMPLE_BYTES = 16384
"""Bytes of each of the places further down where the form is checked."""


@dataclass(frozen=True)
class RawFile:
    """The content of one file, unpacked."""

    name: str
    """Its name for messages."""
    path: Path
    """Where the unpacked content can be read; the file itself where it is not packed."""
    size: int
    """Bytes of the content."""
    head: bytes
    """The first HEAD_BYTES."""
    digest: Future[str]
    """SHA-256 of the file as it is on the disk, computed while it is read."""


@contextmanager
def open_raw(path: str | Path, progress: Progress) -> Generator[RawFile]:
    """Open a file; what an archive holds is in a temporary file as long as the context lasts.

    Raises:
        BadFile: there is no such file, it cannot be read, now or later, it is a folder or a damaged archive.
    """
    path, left = Path(path), Event()
    with temporary_folder() as folder, ThreadPoolExecutor(1) as beside:
        try:
            yield _open_raw(path, folder / "content", beside, left, progress)
        except OSError as error:  # a drive that was pulled out
            raise BadFile(f"reading {str(path)!r} failed midway: {reason_of(error)}") from None
        finally:
            left.set()  # else a cancelled reading would wait until all of the file is hashed


def _open_raw(path: Path, target: Path, beside: Executor, left: Event, progress: Progress) -> RawFile:
    try:
        if path.is_dir():
            raise BadFile(f"source must be a file (got the folder {str(path)!r})")
        if path.exists() and not path.is_file():  # /dev/zero never ends, a pipe never begins
            raise BadFile(f"file must be an ordinary file (got {str(path)!r}, a device or a pipe)")
        with path.open("rb") as file:
            is_packed = file.read(4).startswith((GZIP, ZSTANDARD))
        digest = beside.submit(_sha256, path, left)
        content = target if is_packed else path
        if is_packed:
            with target.open("wb") as out:
                out.writelines(unpacked(path, path.name, progress))
        with content.open("rb") as file:
            return RawFile(path.name, content, content.stat().st_size, file.read(HEAD_BYTES), digest)
    except FileNotFoundError:
        raise BadFile(f"file not found: {str(path)!r}") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        if isinstance(error, BadFile):
            raise
        raise BadFile(f"cannot read {str(path)!r}: {reason_of(error)}") from None


def _sha256(path: Path, left: Event) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            if left.is_set():
                raise Cancelled("the file was closed before it was hashed")
            digest.update(piece)
    return digest.hexdigest()


@contextmanager
def text_as_file(
    lines: Iterable[str | bytes], origin: RawFile, progress: Progress, newline: str = "\n"
) -> Generator[RawFile]:
    """Lines that a container holds as a text file, which lasts as long as the context.

    Args:
        lines: The lines, or pieces of bytes.
        origin: The file that holds them.
        progress: Called every 4,096 lines.
        newline: What is written after each line; "" where the lines hold their own.
    """
    with temporary_folder() as folder:
        target = folder / "text"
        with target.open("wb") as out:
            for number, line in enumerate(lines):
                if number % 4096 == 0:
                    progress(0.5, "reading")
                out.write(line if isinstance(line, bytes) else (line + newline).encode("utf-8", "replace"))
        with target.open("rb") as file:
            head = file.read(HEAD_BYTES)
        yield replace(origin, path=target, size=target.stat().st_size, head=head)


def find_encoding(raw: RawFile, progress: Progress) -> str:
    """Encoding of the text; BadFile where it is empty or not text."""
    head, name = raw.head, raw.name
    if not head:
        raise BadFile(f"{name} must hold lines of numbers (got an empty file)")
    what = next((what for magic, what in _FOREIGN.items() if head.startswith(magic)), "")
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    # Long runs of NULs were never written, as on a card that lost power; some bytes are those of a noisy wire.
    text = re.sub(rb"\0{16,}", b"", _FRAMED.sub(rb"\1", head[:_HEAD])).replace(ESCAPE.encode(), b"")
    is_text = len(_CONTROL.findall(text)) <= 0.1 * len(text) and text
    if not what and not is_text and (first := _CONTROL.search(head)):
        line = head[: first.start()].count(10) + 1
        what = f"binary data, the first byte is 0x{first[0].hex().upper()}, on line {line}"
    if what:
        raise BadFile(f"{name} must be a text file (got {what})")
    if head.startswith(codecs.BOM_UTF8):
        return "utf-8-sig"
    return "utf-8" if _is_utf8(raw.path, progress) else _legacy_encoding(head[:_HEAD].rpartition(b"\n")[0])


def _is_utf8(path: Path, progress: Progress) -> bool:
    """True where all bytes are UTF-8; in pieces, because a file may be larger than the memory."""
    try:
        with path.open("rb") as file:
            for _ in codecs.iterdecode(iter(lambda: file.read(1 << 20), b""), "utf-8"):
                progress(0.0, "reading")
    except UnicodeDecodeError:
        return False
    return True


_SCRIPTS = {
    "cp1251": re.compile("[А-Я]?[а-я]{3,}|[А-Я]{3,}"),
    "cp932": re.compile("[\u3040-\u30ff\u4e00-\u9fff]{2,}"),
    "gb2312": re.compile("[\u4e00-\u9fff]{2,}"),
}
"""Encodings older than UTF-8, with words as they are in no text of another one; of Western languages: Latin-1."""


def _legacy_encoding(head: bytes) -> str:
    """The encoding in which most characters that are not ASCII are in words of its script."""
    for encoding, word in _SCRIPTS.items():
        text = head.decode(encoding, "replace")
        if 2 * len("".join(word.findall(text))) > sum(not c.isascii() for c in text):
            return encoding
    return "latin-1"


def unusual_marks(raw: RawFile) -> tuple[str, ...]:
    """Sentences about what `plain_lines` has to repair, judged by the head; usually none."""
    escapes = "control sequences of a terminal were left out"
    return (*(escapes,) * (ESCAPE.encode() in raw.head), *filter(None, [_rewritten(raw.head[:_HEAD])]))


def _rewritten(head: bytes) -> str | None:
    """The key of `_REWRITTEN` that a file with this head has; None for most."""
    ways = ((what, mark in head and begin(head)) for what, (mark, begin, _) in _REWRITTEN.items())
    return next((what for what, found in ways if found), None)


def _positions(lines: Iterator[str]) -> Iterator[str]:
    """`09:30:00.00 -> altitude:431.0 m,satellites:8` of a GGA sentence of NMEA, speed and course of an RMC."""
    for line in lines:
        parts = split_checksum(line)
        if not line.startswith("$") or parts is None or parts[1] != parts[2]:
            yield line
            continue
        cells = parts[0].split(",")
        kind, clock = cells[0][2:], cells[1] if len(cells) > 9 else ""
        if kind not in ("GGA", "RMC") or len(clock) < 6:
            yield f"# {line}"
            continue
        first = f"altitude:{cells[9]} m,satellites:{cells[7]}"
        said = first if kind == "GGA" else f"speed:{cells[7]} kn,course:{cells[8]}"
        yield f"{clock[:2]}:{clock[2:4]}:{clock[4:]} -> {said}\n"


def _documents(lines: Iterator[str]) -> Iterator[str]:
    """Each document of YAML as an object of JSON in place of the `---` that ends it; its lines are left empty."""
    keys, values = list[tuple[int, str]](), dict[str, str]()
    for line in lines:
        match = _KEY.fullmatch(line.rstrip())
        if match is not None:
            while keys and keys[-1][0] >= len(match[1]):
                keys.pop()
            keys.append((len(match[1]), match[2]))
            if match[3]:
                values[".".join(key for _, key in keys)] = match[3].strip("'\"")
        ends = line.startswith("---")
        yield json.dumps(values) + "\n" if ends and values else "\n"
        values = {} if ends else values


def _in_blocks(head: bytes) -> bool:
    """Whether most lines have a label, and one label comes first below most lines that are a stamp or blank.

    Without such lines many labels must come in turn.
    """
    lines = b"".join(head.splitlines(keepends=True)[:400]).decode("utf-8", "replace").splitlines()
    if 3 * sum(_LABEL.match(line) is not None for line in lines) <= len(lines):
        return False
    first, often, begins = Counter[str](), Counter[str](), True
    for line in lines:
        is_parting = is_blank(line) or bool(_stamp_alone(line))
        label = None if is_parting else _LABEL.match(line)
        if label is not None and begins:
            first[label[1]] += 1
        often.update([] if label is None else [label[1]])
        begins = is_parting or (begins and label is None)
    turns = max(often.values(), default=0)
    alike = sum(turns - 1 <= n <= turns for n in often.values())
    if turns >= 3 and 10 <= len(often) < 1.1 * alike and often.total() > 0.9 * len(lines):
        return True
    return 3 <= max(first.values(), default=0) >= 0.6 * first.total() and 3 * often.total() > len(lines)


def _stamp_alone(line: str) -> str:
    """The stamp that a line is, with or without a rule beside it; "" for any other line."""
    text = line.strip(" \t\r\n=*-")
    return text if (text.isdecimal() and len(text) == 10) or (text and is_stamp(text)) else ""


def _blocks(lines: Iterator[str]) -> Iterator[str]:
    """Each block of labelled lines, below a line that is a stamp or between blank ones, as an object of JSON."""
    values, size, headings = dict[str, str](), 0, [""]
    for line in chain(lines, ("",)):
        stamp, is_stamped = _stamp_alone(line), "time" in values
        pairs = {"time": stamp} if stamp else dict(find_pairs(line) or ())
        heading = "" if pairs or is_stamped else line.strip(" \t\r\n=*-")
        above = f"{headings[-1]} ".lstrip()
        twice = above + next(iter(pairs), "") in values if pairs.keys() & values.keys() else heading in headings[1:]
        ends = "time" in pairs if is_stamped else twice or is_blank(line)
        if ends or not line:
            yield (json.dumps(values) if values else "") + "\n" * size
            values, size, headings, above = {}, 0, [""], ""
        headings += [heading] if heading else []
        for label, value in pairs.items():
            names = chain((label, above + label), (f"{label} {k}" for k in count(2)))
            values[next(name for name in names if name not in values)] = value
        size += 1


def _typed(lines: Iterator[str]) -> Iterator[str]:
    """`(2024-03-14T09:00:00.000000, 21.5)` of `(datetime.datetime(2024, 3, 14, 9, 0), np.float64(21.5))`."""
    for line in lines:
        yield _DATETIME.sub(_as_iso, _TYPED.sub(r"\2", line))


def _as_iso(match: re.Match[str]) -> str:
    parts = [int(part) for part in match[1].split(",")]
    return "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:06}".format(*parts, *[0] * (7 - len(parts)))


def _framed(lines: Iterator[str]) -> Iterator[str]:
    """`$Q,226,2.44*1A` of a line between STX and ETX with its checksum, `Q,226,2.44` of one without."""
    for line in lines:
        found = _FRAME.search(line)
        yield line if found is None else f"${found[1]}*{found[2]}\n" if found[2] else f"{found[1]}\n"


def _series_of_lines(lines: Iterator[str]) -> Iterator[str]:
    """Each number of a line on a line of its own, below the line with NPTS."""
    begun = False
    for line in lines:
        yield "\n".join(line.split()) + "\n" if begun else line
        begun = begun or "NPTS" in line


def _counted(head: bytes) -> bool:
    """Whether the rows below `NPTS= 1503` hold several values each, all of the last ones but one as many."""
    count = re.search(rb"NPTS= {0,8}([0-9]{2,9})[^\n]*\n", head)
    widths = [len(line.split()) for line in head[count.end() :].splitlines()[:-1]] if count else []
    return len(widths) > 2 and len({*widths[:-1]}) == 1 < widths[0] and bool(count) and sum(widths) <= int(count[1])


def _tuples(lines: Iterator[str]) -> Iterator[str]:
    """`id,time,temp` of `INSERT INTO logs (id, time, temp) VALUES (1, '09:00', 21.5);`, and `1, '09:00', 21.5`."""
    names, above = "", ""
    for line in lines:
        head, statement, held = line.partition("VALUES")
        held = held if statement else line
        names = names or (head.partition("(")[2].partition(")")[0].replace("`", "") if statement else "")
        rows = [row.replace("'", '"') for row in _TUPLE.findall(held)]
        yield names + "\n" if names and not above else ""
        above = names
        yield "".join(f"{row}\n" for row in rows) or f"# {line}"


_KEY = re.compile(r"( {0,40})(?:- )?([A-Za-z_][\w/-]{0,60}):(?: {1,20}(\S.*))?")
_TYPED = re.compile(r"\b(?:np\.[a-z]{3,5}[0-9]{1,2}|Decimal|Timestamp)\(('?)([^()']{1,60})\1\)")
_DATETIME = re.compile(r"\bdatetime\.datetime\(([0-9]{4}(?:, ?[0-9]{1,6}){2,6})(?:, tzinfo=[\w.()]{1,40})?\)")
_FRAME = re.compile(r"\x02([^\x02\x03]{1,400})\x03([0-9A-F]{2})?\s*$")
_TUPLE = re.compile(r"\(((?:[^()']|'[^']*'){1,4000})\)[,;\s]")
_LABEL = re.compile(r"[ \t]*([A-Za-z_](?:[^:=,;|\t]|\t(?=[\t :=])){0,60})[:=]")
"""What begins a labelled line."""
_REWRITTEN: dict[str, tuple[bytes, Callable[[bytes], object], Callable[[Iterator[str]], Iterator[str]]]] = {
    "of NMEA, GGA gives the altitude and RMC the speed, both the clock; other sentences are comments": (
        *(b"*", re.compile(rb"^\$[A-Z]{2}(?:GGA|RMC),[0-9]{6}", re.MULTILINE).search, _positions),
    ),
    "each block of labelled lines is a row": (b"\n", _in_blocks, _blocks),
    "each document of YAML is a row": (
        *(b"\n---", re.compile(rb"^[a-z_]+:.*\n(?:[ a-z_]+:.*\n){1,400}---\n", re.MULTILINE).search, _documents),
    ),
    "of values printed with their type by Python only the value is read": (
        *(b"(", re.compile(rb"\b(?:datetime\.datetime|np\.(?:float|int)[0-9]{1,2})\([^()]{1,60}\)").search, _typed),
    ),
    "lines are framed by STX and ETX": (b"\3", _FRAMED.search, _framed),
    "the lines hold one signal, as many values as NPTS says": (b"NPTS=", _counted, _series_of_lines),
    "the rows that INSERT statements of SQL hold": (
        *(b"INSERT", re.compile(rb"^INSERT INTO .* VALUES", re.MULTILINE).search, _tuples),
    ),
}
"""What is written as labels, objects or rows before it is read: a sentence, two marks of it, what rewrites it."""


def plain_lines(raw: RawFile, encoding: str) -> Iterator[str]:
    """The lines without control sequences of a terminal, NMEA, documents and statements as rows."""
    what = _rewritten(raw.head[:_HEAD])
    rewritten = _REWRITTEN[what][2] if what else iter
    with raw.path.open("rb") as file, open_text(file, encoding) as lines:
        yield from rewritten(without_escapes(line) for line in iter(lambda: read_line(lines), ""))


def sample_lines(raw: RawFile, encoding: str) -> list[str]:
    """Whole lines from the middle and from the end of a file, "" between; none of text in pairs of bytes."""
    samples: list[str] = []
    with raw.path.open("rb") as file:
        for start in () if encoding == "utf-16" else (raw.size // 2, raw.size - SAMPLE_BYTES):
            file.seek(max(start, 0))
            lines = list(open_text(io.BytesIO(file.read(SAMPLE_BYTES)), encoding))
            samples += ["", *(line.rstrip("\n") for line in lines[1:-1])]  # the others may be cut
    return samples


def read_line(text: TextIO) -> str:
    """The next line with its newline, "" at the end; what is beyond MAX_LINE is left out and marked with CUT."""
    line = text.readline(MAX_LINE)
    if len(line) < MAX_LINE or line.endswith("\n"):
        return line
    while (rest := text.readline(MAX_LINE)) and not rest.endswith("\n"):
        pass
    return f"{line}{CUT}\n"


def open_text(file: BinaryIO, encoding: str) -> io.TextIOWrapper:
    """Lines of the text, one at a time, each with its newline where it has one."""
    # newline=None turns \r\n and \r into \n and breaks at nothing else, unlike str.splitlines.
    return io.TextIOWrapper(file, encoding, errors="replace", newline=None)
