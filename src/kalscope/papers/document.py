"""A document, reproduced: what opens as an experiment, checks with tolerances, blocks, and the page of them all."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

from kalscope.common.charts import Panel, document, draw_svg, markup_of_table
from kalscope.filtering.params import FilterParams
from kalscope.papers.generalized import GeneralizedParams
from kalscope.recording import Recording

Settings = FilterParams | GeneralizedParams
"""Parameters of one of the filters; the second paper has one of its own."""


@dataclass(frozen=True)
class Experiment:
    """One figure or table of a source document, as something to open."""

    name: str
    """What follows "experiment:", letters, digits and underscores."""
    title: str
    """For a list, such as "Figure 6: R = 1, Q = 0.01"."""
    make: Callable[[], tuple[Recording, Settings | tuple[Settings, ...]]]
    """The recording, and the settings for all channels or of each one; the same at every call."""


@dataclass(frozen=True)
class Check:
    """A reproduced number, what it should be, and how far it may be off."""

    name: str
    """What the number is, in words."""
    value: float
    """The number reproduced."""
    expected: float
    """The number printed, or derived."""
    tolerance: float
    """Largest |value − expected|, in the same unit; with `relative` a share of |expected|."""
    relative: bool = False
    """Whether the tolerance is a share of |expected|."""

    @property
    def passed(self) -> bool:
        """Whether the number stays in its tolerance; NaN never does."""
        allowed = self.tolerance * abs(self.expected) if self.relative else self.tolerance
        return abs(self.value - self.expected) <= allowed

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Name, value, expected value and tolerance as text."""
        share = f"{100 * self.tolerance:g} %" if self.relative else f"{self.tolerance:g}"
        return self.name, f"{self.value:.6g}", f"{self.expected:.6g}", share

    def __str__(self) -> str:
        name, value, expected, tolerance = self.cells
        return f"{name} must be {expected} within {tolerance} (got {value})"


@dataclass(frozen=True)
class Block:
    """A picture or a table with its words."""

    name: str
    """Its name in results.json."""
    title: str
    """The document's own number and what is drawn, or what the table holds."""
    body: str
    """The picture or the table, HTML."""
    caption: str
    """What was drawn, and with which settings; how the numbers were made."""
    verdict: str
    """One sentence: does it look as the document says? What do the numbers say?"""
    rows: tuple[dict[str, Any], ...]
    """The numbers of each row of the table, and those of the words."""


@dataclass(frozen=True)
class Chapter:
    """One document, reproduced."""

    key: str
    """Its name in results.json."""
    title: str
    """Its title."""
    citation: str
    """Authors, place and year."""
    intro: tuple[str, ...]
    """Paragraphs before the first figure."""
    blocks: tuple[Block, ...]
    """Figures and tables, in the order of the document."""
    checks: tuple[Check, ...]
    """What must stay within its tolerance."""


class Prose:
    """The texts of one chapter, from the TOML file beside its module; a {number} is filled in where it is used."""

    def __init__(self, module: str) -> None:
        self._name = module.rpartition(".")[2]

    @cached_property
    def _texts(self) -> dict[str, Any]:
        return tomllib.loads(_file(f"{self._name}.toml"))

    def figure(self, name: str, panels: Sequence[Panel] = (), **numbers: Any) -> Block:
        """The figure of this name: its panels, or the drawing that it names."""
        one = self._texts[name]
        if panels:
            svg = draw_svg(panels, one["alt"], one.get("columns", 1), one.get("height", 250))
        else:
            svg = _file(one["drawing"]).strip()
        return self._block(name, f'<div class="wide">{svg}</div>', [numbers], numbers)

    def table(self, name: str, rows: Iterable[Mapping[str, Any]] = ({},), **numbers: Any) -> Block:
        """The table of this name: its rows once for each of `rows`, whose numbers they take beside `numbers`."""
        one, each = self._texts[name], [{**row, **numbers} for row in rows]
        cells = [[cell.format(**row).replace("-", "−") for cell in line] for row in each for line in one["rows"]]
        return self._block(name, markup_of_table(one["head"], cells), each, numbers)

    def _block(self, name: str, body: str, rows: Sequence[dict[str, Any]], numbers: dict[str, Any]) -> Block:
        one = self._texts[name]
        words = one["caption"].format(**numbers), one["verdict"].format(**numbers)
        return Block(name, one["title"], body, *words, tuple(row for row in rows if row))

    def chapter(self, blocks: tuple[Block, ...], checks: tuple[Check, ...]) -> Chapter:
        """The whole chapter."""
        key, title, citation = (self._texts[name] for name in ("key", "title", "citation"))
        return Chapter(key, title, citation, tuple(self._texts["intro"]), blocks, checks)


def _file(name: str) -> str:
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


def list_disagreements() -> list[dict[str, str]]:
    """Pairs of statements of one document that cannot both hold, and what is done here."""
    return tomllib.loads(_file("disagreements.toml"))["disagreement"]


def table_of_disagreements() -> str:
    """The disagreements as an HTML table."""
    rows = [[one[key] for key in ("document", "where", "one", "other", "here")] for one in list_disagreements()]
    return markup_of_table(("document", "where", "it says", "it also says", "done here"), rows, "words")


def table_of_checks(checks: Sequence[Check]) -> str:
    """The checks as an HTML table."""
    rows = [(*check.cells, "yes" if check.passed else "NO") for check in checks]
    return markup_of_table(("number", "reproduced", "expected", "tolerance", "within"), rows)


def page(chapters: Sequence[Chapter], version: str) -> str:
    """The page of `kalscope reproduce`: one HTML file that needs nothing else, in light and dark.

    Args:
        chapters: the documents, reproduced.
        version: of Kalscope, for the foot of the page.
    """
    checks = [check for chapter in chapters for check in chapter.checks]
    failed = "".join(f"<br>{escape(str(check))}" for check in checks if not check.passed)
    sentence = f"All {len(checks)} reproduced numbers are within their stated tolerance."
    if failed:
        sentence = f'<span class="no">Numbers outside their tolerance, of {len(checks)}:</span>{failed}'
    contents = "".join(f'<a href="#{one.key}">{escape(one.title)}</a> ' for one in chapters)
    body = f"""<h1>Three documents, reproduced</h1>
<p>What Kalscope makes of the three documents it implements: their figures and tables, drawn again from their
equations, and what they say when tested.</p><p class="sum">{sentence}</p>
<nav>{contents}<a href="#disagreements">Where a paper disagrees with itself</a>
<a href="#checks">All checks</a></nav>
{"".join(map(_section, chapters))}
<section id="disagreements"><h2>Where a paper disagrees with itself</h2>{table_of_disagreements()}</section>
<section id="checks"><h2>All checks</h2>{table_of_checks(checks)}
<p class="caption">Expected is what the document prints, or what follows from its equations.</p></section>
<p class="quiet">Kalscope {escape(version)}. The authors published pictures, not data: every recording here is a
re-creation, drawn from a stated model with a fixed seed.</p>"""
    return document("Kalscope: three documents, reproduced", _file("page.css"), body.replace(" %", "&nbsp;%"))


def _section(chapter: Chapter) -> str:
    blocks = "".join(
        f"<h3>{escape(one.title)}</h3><figure>{one.body}<figcaption>{escape(one.caption)}</figcaption></figure>"
        f'<p class="verdict">{escape(one.verdict)}</p>'
        for one in chapter.blocks
    )
    intro = "".join(f"<p>{escape(text)}</p>" for text in chapter.intro)
    return (
        f'<section id="{chapter.key}"><h2>{escape(chapter.title)}</h2>'
        f'<p class="quiet">{escape(chapter.citation)}</p>{intro}{blocks}</section>'
    )
