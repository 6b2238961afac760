"""Read a spreadsheet or a MATLAB file; run as a process of its own.

The libraries abort their process at some damaged files: this one, not Kalscope's.

    python convert.py sheets|mat FILE FOLDER

FOLDER gets 0.txt, 1.txt, …, cells separated by tabs, and sheets.json: name, rows, columns and numbers of each; or
variables.pickle, the numbers and structs of a MATLAB file by their names.
"""

from __future__ import annotations

import datetime
import importlib
import json
import pickle
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

_CLASSES = re.compile("double|single|logical|struct|u?int(8|16|32|64)")
MAX_CELLS = 1 << 24
"""Cells of one sheet, including empty ones."""
MAX_BYTES = 4 << 30
"""Memory of this process, where the system can limit it."""


def convert(book_path: str, folder: str) -> None:
    """Write the sheets; ValueError where one is too large."""
    book: Any = importlib.import_module("python_calamine").CalamineWorkbook.from_path(book_path)
    said: list[dict[str, Any]] = []
    for title in book.sheet_names:
        sheet = book.get_sheet_by_name(title)
        height, width = (0, 0) if sheet.end is None else (sheet.end[0] + 1, sheet.end[1] + 1)
        if height * width > MAX_CELLS:
            raise ValueError(f"a sheet of {height} × {width} cells, above {MAX_CELLS}")
        rows: list[list[Any]] = sheet.to_python(skip_empty_area=False) if height else []
        numbers = [sum(type(cell) in (int, float) for cell in row) for row in rows]  # no flags
        with (Path(folder) / f"{len(said)}.txt").open("w", encoding="utf-8", errors="replace", newline="\n") as out:
            out.writelines("\t".join(map(cell_text, row)) + "\n" for row in rows)
        said.append({"name": title, "rows": height, "columns": max(numbers, default=0), "numbers": sum(numbers)})
    (Path(folder) / "sheets.json").write_text(json.dumps(said), encoding="utf-8")


def read_variables(path: str, folder: str) -> None:
    """Write the variables of a MATLAB file that may hold numbers; cells, text and objects are left unread."""
    matlab: Any = importlib.import_module("scipy.io")
    wanted = [key for key, _, kind in matlab.whosmat(path) if _CLASSES.fullmatch(kind)]
    held = matlab.loadmat(path, variable_names=wanted, simplify_cells=True)
    with (Path(folder) / "variables.pickle").open("wb") as file:
        pickle.dump({key: held[key] for key in wanted if key in held}, file, 5)


def cell_text(cell: object) -> str:
    """A cell as text: whole numbers without a point, dates as ISO 8601, durations in s."""
    if isinstance(cell, float):
        return str(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, datetime.datetime):
        return cell.isoformat()
    if isinstance(cell, datetime.timedelta):
        return f"{cell.total_seconds():.9g}"
    return " ".join(str(cell).replace('"', "'").split())


if __name__ == "__main__":
    with suppress(ImportError, OSError, ValueError):  # Windows has no limits, macOS refuses this one
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MAX_BYTES, MAX_BYTES))
    try:
        {"sheets": convert, "mat": read_variables}[sys.argv[1]](*sys.argv[2:])
    except BaseException as error:  # a panic of the library, which is written in Rust, is not an Exception
        sys.stderr.write(" ".join(str(error).split())[:200])
        sys.exit(1)
