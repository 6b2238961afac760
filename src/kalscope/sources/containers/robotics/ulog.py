"""PX4 ULog files, read by pyulog: the fields of one topic."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.common.progress import Progress
from kalscope.sources.containers.library import load_library
from kalscope.sources.containers.parts import Part, choose_part
from kalscope.sources.containers.table import MAX_COLUMNS, Table

_TIME = "timestamp"


def read_ulog(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read one topic of a ULog file.

    Raises:
        BadFile: no topic holds numbers.
        BadSetting: there is no such topic.
    """
    pyulog = load_library("pyulog", "pyulog", name, "a ULog file")
    progress(0.0, "reading")
    # The library prints its warnings, which are not part of a command's output.
    with path.open("rb") as file, contextlib.redirect_stdout(io.StringIO()):
        log = pyulog.ULog(file)
    progress(0.8, "reading")
    topics = [(_name(one), one.data, _fields(one.data)) for one in log.data_list]
    topics = [topic for topic in topics if topic[2] and len(topic[1][_TIME])]
    parts = [Part(topic, len(data[_TIME]), len(fields)) for topic, data, fields in topics]
    chosen, notes = choose_part(parts, part, name, "topic")
    topic, data, fields = topics[chosen]
    return Table(
        names=tuple(f"{topic}/{field}" for field in fields),
        units=("",) * len(fields),
        columns=tuple(np.asarray(data[field], dtype=np.float64) for field in fields),
        time=np.asarray(data[_TIME], dtype=np.float64) / 1e6,
        notes=("a ULog file", *notes),
    )


def _name(topic: Any) -> str:
    """Several sensors of one kind are told apart by their instance."""
    return f"{topic.name}_{topic.multi_id}" if topic.multi_id else str(topic.name)


def _fields(data: dict[str, Any]) -> list[str]:
    names = [name for name in data if name != _TIME and "_padding" not in name and data[name].dtype.kind in "iufb"]
    return names[:MAX_COLUMNS] if _TIME in data else []
