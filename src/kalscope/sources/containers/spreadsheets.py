"""Spreadsheets (.xlsx, .xls, .ods), read by python-calamine: a sheet becomes text for the ordinary rules."""

from __future__ import annotations

import json
import re
import zipfile
from functools import reduce
from pathlib import Path

from kalscope.common.files import temporary_folder
from kalscope.common.progress import Progress
from kalscope.errors import BadFile
from kalscope.sources.containers import convert
from kalscope.sources.containers.table import Part, Text, choose_text_part, convert_apart, load_library

_PLACE = re.compile(rb"""\sr\s?=\s?["']([A-Za-z]{0,3})([0-9]{1,7})["']""")


def read_excel(path: Path, name: str, part: str | None, progress: Progress) -> Text:
    """Read one sheet of a spreadsheet as lines of cells separated by tabs, dates as ISO 8601.

    Raises:
        BadFile: no sheet holds numbers, or it is too large.
        BadSetting: there is no such sheet.
    """
    load_library("python_calamine", "python-calamine", name, "a spreadsheet")
    if zipfile.is_zipfile(path):
        _check_size(path, name, progress.part(0.0, 0.3))
    with temporary_folder() as folder:
        convert_apart("sheets", path, folder, progress.part(0.3, 1.0))
        said = json.loads((folder / "sheets.json").read_text(encoding="utf-8"))
        holding = [i for i, sheet in enumerate(said) if sheet["numbers"]]
        parts = [Part(said[i]["name"], said[i]["rows"], said[i]["columns"]) for i in holding]
        chosen, notes, inner = choose_text_part(parts, part, name, "sheet")
        text = (folder / f"{holding[chosen]}.txt").read_text(encoding="utf-8").removesuffix("\n")
    return Text(text.split("\n"), ("a spreadsheet; line numbers are its rows", *notes), "\t", inner)


def _check_size(path: Path, name: str, progress: Progress) -> None:
    """Refuse what would fill the memory, by unpacking it once without keeping it: declared sizes may be false."""
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            info.file_size = 1 << 62  # any
            del info.CRC  # which would be that of the declared size
            rows = columns = 0
            with archive.open(info) as stream:
                before = b""
                while piece := stream.read(1 << 20):
                    progress(0.5, "unpacking")
                    progress.unpack(len(piece))
                    for letters, digits in _PLACE.findall(before + piece):
                        rows = max(rows, int(digits))
                        columns = max(columns, reduce(lambda n, letter: 26 * n + letter - 64, letters.upper(), 0))
                    before = piece[-64:]
            if rows * columns > convert.MAX_CELLS:
                raise BadFile(
                    f"{name} must have at most {convert.MAX_CELLS} cells a sheet (got {rows} × {columns})"
                )
