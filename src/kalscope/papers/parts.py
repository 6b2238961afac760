"""What a reproduced document consists of: an entry to open, checks with tolerances, figures and tables."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from kalscope.common.charts import Panel, draw_svg, markup_of_table
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
    paper: str
    """The document, in short."""
    figure: str
    """Where in the document, such as "Figure 6"."""
    summary: str
    """One line: what it shows."""
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

    def __str__(self) -> str:
        share = f"{100 * self.tolerance:g} %" if self.relative else f"{self.tolerance:g}"
        return f"{self.name} must be {self.expected:.6g} within {share} (got {self.value:.6g})"


@dataclass(frozen=True)
class Figure:
    """A picture or a table with its words."""

    title: str
    """The document's own number and what is drawn, or what the table holds."""
    body: str
    """The picture or the table, HTML."""
    caption: str
    """What was drawn, and with which settings; how the numbers were made."""
    verdict: str
    """One sentence: does it look as the document says? What do the numbers say?"""


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
    blocks: tuple[Figure, ...]
    """Figures and tables, in the order of the document."""
    checks: tuple[Check, ...]
    """What must stay within its tolerance."""
    results: dict[str, Any]
    """The numbers, as JSON takes them."""


@dataclass(frozen=True)
class Effort:
    """How many random draws an average is taken over."""

    table_draws: int
    """Signals behind each simulated number of Table 1."""
    limit_draws: int
    """Signals behind each point of the tests of the advice."""
    estimate_draws: int
    """Recordings whose q and r are estimated."""


FULL = Effort(table_draws=4000, limit_draws=200, estimate_draws=200)
"""Averages accurate to a few parts in a thousand."""
QUICK = Effort(table_draws=1000, limit_draws=40, estimate_draws=60)
"""Rougher averages, inside the same tolerances."""


class Prose:
    """The texts of one chapter, from the TOML file beside its module; a {number} is filled in where it is used."""

    def __init__(self, module: str) -> None:
        self._name = module.rpartition(".")[2]

    @cached_property
    def _texts(self) -> dict[str, Any]:
        return tomllib.loads(_file(f"{self._name}.toml"))

    def words(self, name: str, *keys: str) -> list[str]:
        """The texts of this name as they are."""
        return [self._texts[name][key] for key in keys]

    def figure(self, name: str, panels: Sequence[Panel] = (), **numbers: Any) -> Figure:
        """The figure of this name: its panels, or the drawing that it names."""
        one = self._texts[name]
        if panels:
            svg = draw_svg(panels, one["alt"], one.get("columns", 1), one.get("height", 250))
        else:
            svg = _file(one["drawing"]).strip()
        return self._block(one, f'<div class="wide">{svg}</div>', numbers)

    def table(self, name: str, rows: Iterable[Mapping[str, Any]] = ({},), **numbers: Any) -> Figure:
        """The table of this name: its rows once for each of `rows`, whose numbers they take beside `numbers`."""
        one = self._texts[name]
        cells = [[cell.format(**row, **numbers) for cell in line] for row in rows for line in one["rows"]]
        return self._block(one, markup_of_table(one["head"], cells, "words" if one.get("words") else ""), numbers)

    def _block(self, one: dict[str, Any], body: str, numbers: dict[str, Any]) -> Figure:
        return Figure(one["title"], body, one["caption"].format(**numbers), one["verdict"].format(**numbers))

    def chapter(self, blocks: tuple[Figure, ...], checks: tuple[Check, ...], results: dict[str, Any]) -> Chapter:
        """The whole chapter."""
        key, title, citation = (self._texts[name] for name in ("key", "title", "citation"))
        return Chapter(key, title, citation, tuple(self._texts["intro"]), blocks, checks, results)


def _file(name: str) -> str:
    return (Path(__file__).parent / name).read_text(encoding="utf-8")
