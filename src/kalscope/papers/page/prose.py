"""The prose of the page: titles, captions, verdicts and headings from the TOML files beside the chapters.

The statements in which a document contradicts itself are in disagreements.toml of this folder.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kalscope.papers.parts import Chapter, Check, Figure, ResultTable


class Prose:
    """The texts of one chapter; a text may hold {numbers}, which are filled in where it is used."""

    def __init__(self, file: Path) -> None:
        self._folder, self._texts = file.parent, tomllib.loads(file.read_text(encoding="utf-8"))

    def drawing(self, name: str) -> str:
        """A drawing from the folder of the texts, an <svg> element; its colours are those of `charts.COLOURS`."""
        return (self._folder / name).read_text(encoding="utf-8").strip()

    def figure(self, name: str, svg: str, **numbers: Any) -> Figure:
        """The figure of this name with its picture."""
        one = self._texts[name]
        return Figure(one["title"], svg, one["caption"].format(**numbers), one["verdict"].format(**numbers))

    def table(self, name: str, rows: Iterable[Mapping[str, Any]] = ({},), **numbers: Any) -> ResultTable:
        """The table of this name: its rows once for each of `rows`, whose numbers they take beside `numbers`."""
        one = self._texts[name]
        texts = (one["caption"].format(**numbers), one["verdict"].format(**numbers))
        cells = tuple(tuple(cell.format(**row, **numbers) for cell in line) for row in rows for line in one["rows"])
        return ResultTable(one["title"], tuple(one["head"]), cells, *texts, one.get("words", False))

    def chapter(
        self, blocks: tuple[Figure | ResultTable, ...], checks: tuple[Check, ...], results: dict[str, Any]
    ) -> Chapter:
        """The whole chapter."""
        key, title, citation = (self._texts[name] for name in ("key", "title", "citation"))
        return Chapter(key, title, citation, tuple(self._texts["intro"]), blocks, checks, results)


@dataclass(frozen=True)
class Disagreement:
    """Two statements of one document that cannot both hold."""

    document: str
    """Which document, in short."""
    where: str
    """Equations, figures, sections."""
    one: str
    """The one statement."""
    other: str
    """The other."""
    here: str
    """What Kalscope does."""


def list_disagreements() -> tuple[Disagreement, ...]:
    """All of them, in the order of the documents."""
    texts = tomllib.loads((Path(__file__).parent / "disagreements.toml").read_text(encoding="utf-8"))
    return tuple(Disagreement(**one) for one in texts["disagreement"])
