"""The page of `kalscope reproduce`: one HTML file that needs nothing else, in light and dark."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from html import escape
from pathlib import Path

from kalscope.common.charts import document, markup_of_table
from kalscope.papers.parts import Chapter, Check, Figure


def page(chapters: Sequence[Chapter], disagreements: Sequence[dict[str, str]], version: str) -> str:
    """The whole page as text.

    Args:
        chapters: the documents, reproduced.
        disagreements: where they contradict themselves.
        version: of Kalscope, for the foot of the page.
    """
    checks = [check for chapter in chapters for check in chapter.checks]
    contents = "".join(f'<a href="#{c.key}">{escape(c.title)}</a> ' for c in chapters)
    body = [
        "<h1>Three documents, reproduced</h1>",
        "<p>What Kalscope makes of the three documents it implements: their figures and tables, drawn again from"
        " their equations, and what they say when tested.</p>",
        _summary(checks),
        f'<nav>{contents}<a href="#disagreements">Where a paper disagrees with itself</a>'
        ' <a href="#checks">All checks</a></nav>',
        *map(_chapter, chapters),
        _disagreements(disagreements),
        _checks(checks),
        f'<p class="quiet">Kalscope {escape(version)}. The authors published pictures, not data: every recording'
        " here is a re-creation, drawn from a stated model with a fixed seed.</p>",
    ]
    style = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")
    return document("Kalscope: three documents, reproduced", style, "\n".join(body).replace(" %", "&nbsp;%"))


def _summary(checks: Sequence[Check]) -> str:
    failed = [check for check in checks if not check.passed]
    if not failed:
        return f'<p class="sum">All {len(checks)} reproduced numbers are within their stated tolerance.</p>'
    listed = "".join(f"<br>{escape(str(check))}" for check in failed)
    count = f"{len(failed)} of {len(checks)} numbers are outside their tolerance:"
    return f'<p class="sum"><span class="no">{count}</span>{listed}</p>'


def _chapter(chapter: Chapter) -> str:
    blocks = "".join(map(_figure, chapter.blocks))
    intro = "".join(f"<p>{escape(text)}</p>" for text in chapter.intro)
    return (
        f'<section id="{chapter.key}"><h2>{escape(chapter.title)}</h2>'
        f'<p class="quiet">{escape(chapter.citation)}</p>{intro}{blocks}</section>'
    )


def _figure(one: Figure) -> str:
    return (
        f"<h3>{escape(one.title)}</h3><figure>{one.body}<figcaption>{escape(one.caption)}</figcaption></figure>"
        f'<p class="verdict">{escape(one.verdict)}</p>'
    )


def _disagreements(disagreements: Sequence[dict[str, str]]) -> str:
    rows = [[d[key] for key in ("document", "where", "one", "other", "here")] for d in disagreements]
    head = ("document", "where", "it says", "it also says", "done here")
    return (
        '<section id="disagreements"><h2>Where a paper disagrees with itself</h2>'
        f"{markup_of_table(head, rows, 'words')}</section>"
    )


def _checks(checks: Sequence[Check]) -> str:
    rows = [
        (
            check.name,
            f"{check.value:.6g}",
            f"{check.expected:.6g}",
            f"{100 * check.tolerance:g} %" if check.relative else f"{check.tolerance:g}",
            "yes" if check.passed else "NO",
        )
        for check in checks
    ]
    head = ("number", "reproduced", "expected", "tolerance", "within")
    return (
        f'<section id="checks"><h2>All checks</h2>{markup_of_table(head, rows)}'
        '<p class="caption">Expected is what the document prints, or what follows from its equations.</p></section>'
    )


def list_disagreements() -> list[dict[str, str]]:
    """Pairs of statements of one document that cannot both hold, and what is done here."""
    return tomllib.loads((Path(__file__).parent / "disagreements.toml").read_text(encoding="utf-8"))["disagreement"]
