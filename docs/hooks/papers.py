"""The chapters of `kalscope reproduce` at the end of the page on the papers, computed while the site is built."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from kalscope.papers.document import Chapter, table_of_checks, table_of_disagreements
from kalscope.papers.reproduction import Reproduction, reproduce

if TYPE_CHECKING:
    from mkdocs.structure.pages import Page


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Called by mkdocs."""
    if page.file.src_uri != "papers.md":
        return markdown
    done = reproduce()
    return "\n\n".join([markdown, *map(_chapter, done.chapters), _checks(done)])


def _chapter(chapter: Chapter) -> str:
    parts = [f"## {escape(chapter.title)}", _paragraph(chapter.citation), *map(_paragraph, chapter.intro)]
    for block in chapter.blocks:
        body = block.body.replace("\n", " ")  # an empty line ends HTML
        parts += [f"### {escape(block.title)}", body, _paragraph(block.caption, "caption")]
        parts.append(_paragraph(block.verdict, "verdict"))
    return "\n\n".join(parts)


def _checks(done: Reproduction) -> str:
    """Where the documents contradict themselves, and every number with its tolerance."""
    return "\n\n".join(
        [
            "## Where a document disagrees with itself",
            table_of_disagreements(),
            f"## {len(done.checks)} reproduced numbers, {len(done.failed)} of them outside of their tolerance",
            table_of_checks(done.checks),
            _paragraph("Expected is what the document prints, or what follows from its equations."),
        ]
    )


def _paragraph(text: str, kind: str = "") -> str:
    """A paragraph whose text is not Markdown."""
    css = f' class="{kind}"' if kind else ""
    return f"<p{css}>{escape(text)}</p>"
