"""Which files are containers, and how each is read."""

from __future__ import annotations

import importlib
import json
import os
import warnings
from codecs import BOM_UTF8
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from kalscope.common.progress import Progress
from kalscope.common.text import one_line
from kalscope.errors import BadFile, KalscopeError
from kalscope.sources.containers.table import Table, Text
from kalscope.sources.grammar.line_format import find_object

_LVM = b"LabVIEW Measurement"

Recogniser = Callable[[bytes, str], bool]
"""Whether the head of a file, and its name in lower case, are of a kind."""

ReadContainer = Callable[[Path, str, "str | None", Progress], Table | Text]
"""Takes the path of the content, the name of the file, the part to read and the progress; returns what it holds."""


@dataclass(frozen=True)
class Container:
    """One kind of file that is read by rules of its own."""

    kind: str
    """What it is, for messages: "a Parquet file"."""
    recognise: Recogniser
    """Whether a file is one."""
    reader: str
    """Its `ReadContainer`, "module.function" in this package: imported where a file needs it."""


def _begins(*magic: bytes) -> Recogniser:
    return lambda head, _: head.startswith(magic)


def _is_excel(head: bytes, name: str) -> bool:
    """For a zip archive the names in its head decide, or its own name."""
    is_old = head.startswith(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")  # of before 2007
    is_named = name.endswith((".xlsx", ".xlsm", ".ods"))
    held = b"xl/" in head or b"opendocument.spreadsheet" in head[:200]
    return is_old or (head.startswith(b"PK\x03\x04") and (is_named or held))


def _is_edf(head: bytes, _: str) -> bool:
    """It begins with a number in a place of eight characters, as a table may."""
    counts = head[184:192].strip(), head[252:256].strip()
    return head.startswith(b"0       ") and b"\n" not in head[:256] and all(map(bytes.isdigit, counts))


def _is_numpy(head: bytes, name: str) -> bool:
    """For a zip archive the name of its first file decides, or its own name."""
    is_zip = head.startswith(b"PK\x03\x04")
    return head.startswith(b"\x93NUMPY") or (is_zip and (name.endswith(".npz") or b".npy" in head[30:94]))


def _is_json_document(head: bytes, name: str) -> bool:
    """The whole file is one value, and not one object on each line."""
    # Byte order marks, blanks, and the empty halves of UTF-16 may come first.
    if head.lstrip(b"\xef\xbb\xbf\xff\xfe\0 \t\r\n")[:1] not in (b"{", b"["):
        return False
    text = head.decode(json.detect_encoding(head), "replace").lstrip("\ufeff \t\r\n")
    if text[:1] == "{" and text[1:].lstrip()[:1] not in ('"', "}", ""):
        return False  # a list of Mathematica
    if text[:1] == "[":
        inside = text[1:].lstrip()[:1]
        return inside == "{" or (inside == "[" and name.endswith(".json"))
    lines = [line for line in text.replace("\r", "\n").split("\n") if line.strip("\0 \t")][:50]
    # The first line may be torn, so other lines must show what the file is.
    return len(lines) == 1 or sum(find_object(line.rstrip(" \t,")) is not None for line in lines) < 2


_CONTAINERS = (
    Container("a Parquet file", _begins(b"PAR1"), "arrays.read_parquet"),
    Container("a LabVIEW measurement file", _begins(_LVM, BOM_UTF8 + _LVM), "labview.read_lvm"),
    Container("a TDMS file", _begins(b"TDSm"), "arrays.read_tdms"),
    Container("an HDF5 file", _begins(b"\x89HDF\r\n\x1a\n"), "arrays.read_hdf5"),
    Container("a MATLAB file", _begins(b"MATLAB 5.0 MAT-file"), "arrays.read_mat"),
    Container("a MATLAB file", _begins(b"MATLAB 7.3 MAT-file"), "arrays.read_hdf5"),
    Container("an MCAP log", _begins(b"\x89MCAP0\r\n"), "robotics.read_mcap"),
    Container("a ROS 1 bag", _begins(b"#ROSBAG V2"), "robotics.read_ros1"),
    Container("a ROS 2 bag", _begins(b"SQLite format 3\0"), "robotics.read_ros2"),
    Container("a ULog file", _begins(b"ULog\x01\x12\x35"), "robotics.read_ulog"),
    Container("a spreadsheet", _is_excel, "spreadsheets.read_excel"),
    Container("a NumPy file", _is_numpy, "arrays.read_numpy"),
    Container("an EDF file", _is_edf, "arrays.read_edf"),
    Container("a zip archive", _begins(b"PK\x03\x04", b"PK\x05\x06"), "texts.read_zip"),
    Container("a JSON document", _is_json_document, "texts.read_json_document"),
)


def find_container(head: bytes, name: str) -> Container | None:
    """The container with this head and name; None for a text file, or one of an unknown kind."""
    lower = name.lower()
    return next((container for container in _CONTAINERS if container.recognise(head, lower)), None)


def read_container(
    container: Container, path: Path, name: str, part: str | None, progress: Progress
) -> Table | Text:
    """What the file holds.

    Raises:
        BadFile: it is damaged, holds no numbers, is too large, or its library is not installed.
        BadSetting: there is no such part.
        Cancelled: it was cancelled.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # libraries warn about oddities in a file
            module, _, function = container.reader.rpartition(".")
            read: ReadContainer = getattr(importlib.import_module(f"{__package__}.{module}"), function)
            return read(path, name, part, progress)
    except (KalscopeError, MemoryError):
        raise
    except Exception as error:  # a damaged file may raise anything in a library
        said = one_line(str(error))[:120] or type(error).__name__
        raise BadFile(f"{name} cannot be read as {container.kind}: {said}") from None


def storage_of(path: Path) -> Path:
    """The file that holds the messages of a ROS 2 bag, which is a folder; any other path itself.

    Raises:
        BadFile: the bag is split into several files.
    """
    if not os.path.isfile(path / "metadata.yaml"):  # which returns False for an invalid name as well
        return path
    files = sorted(file for file in path.iterdir() if file.suffix in (".db3", ".mcap"))
    if len(files) != 1:
        listed = ", ".join(file.name for file in files[:8]) or "none"
        raise BadFile(f"{path.name} must be a bag of one .db3 or .mcap file (got {listed}); open one of them")
    return files[0]
