"""Which files are containers, and how each is read."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from kalscope.common.progress import Progress
from kalscope.common.text import one_line
from kalscope.errors import BadFile, KalscopeError
from kalscope.sources.containers.arrays.hdf5 import read_hdf5
from kalscope.sources.containers.arrays.mat import is_mat, read_mat
from kalscope.sources.containers.arrays.tdms import read_tdms
from kalscope.sources.containers.json_document import is_json_document, read_json_document
from kalscope.sources.containers.lvm import is_lvm, read_lvm
from kalscope.sources.containers.parquet import read_parquet
from kalscope.sources.containers.robotics.mcap import read_mcap
from kalscope.sources.containers.robotics.rosbag import read_ros1, read_ros2
from kalscope.sources.containers.robotics.ulog import read_ulog
from kalscope.sources.containers.spreadsheets.excel import is_excel, read_excel
from kalscope.sources.containers.table import Table, Text

ReadContainer = Callable[[Path, str, "str | None", Progress], Table | Text]
"""From the path of the content, the name of the file, the part to read and the progress to what it holds."""


@dataclass(frozen=True)
class Container:
    """One kind of file that is read by rules of its own."""

    kind: str
    """What it is, for messages: "a Parquet file"."""
    recognise: Callable[[bytes, str], bool]
    """Whether the head of a file, and its name in lower case, are of this kind."""
    read: ReadContainer
    """Its reader."""


def _begins(*magic: bytes) -> Callable[[bytes, str], bool]:
    return lambda head, _: head.startswith(magic)


_CONTAINERS = (
    Container("a Parquet file", _begins(b"PAR1"), read_parquet),
    Container("a LabVIEW measurement file", is_lvm, read_lvm),
    Container("a TDMS file", _begins(b"TDSm"), read_tdms),
    Container("an HDF5 file", _begins(b"\x89HDF\r\n\x1a\n"), read_hdf5),
    Container("a MATLAB file", is_mat, read_mat),
    Container("an MCAP log", _begins(b"\x89MCAP0\r\n"), read_mcap),
    Container("a ROS 1 bag", _begins(b"#ROSBAG V2"), read_ros1),
    Container("a ROS 2 bag", _begins(b"SQLite format 3\0"), read_ros2),
    Container("a ULog file", _begins(b"ULog\x01\x12\x35"), read_ulog),
    Container("a spreadsheet", is_excel, read_excel),
    Container("a JSON document", is_json_document, read_json_document),
)


def find_container(head: bytes, name: str) -> Container | None:
    """The container that begins so and is named so; None for a text file, or one of no known kind."""
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
            warnings.simplefilter("ignore")  # libraries warn of what is odd in a file
            return container.read(path, name, part, progress)
    except KalscopeError:
        raise
    except Exception as error:  # a damaged file may raise anything in a library
        said = one_line(str(error))[:120] or type(error).__name__
        raise BadFile(f"{name} must be {container.kind} that is whole (got: {said})") from None
