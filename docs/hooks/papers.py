"""The chapters of `kalscope reproduce` as pages of the site, computed while it is built."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from mkdocs.structure.files import File, Files

from kalscope.papers.document import Chapter, table_of_checks, table_of_disagreements
from kalscope.papers.reproduction import Reproduction, reproduce

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig

PAGES = {"noise_reducer": "maarif-2019", "generalized": "khan", "lis302dl": "interactive-matter-2009"}
"""Names of the chapters' pages."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each document, and one on what all of them state."""
    done = reproduce()
    pages = {PAGES[chapter.key]: _chapter(chapter) for chapter in done.chapters} | {"checks": _checks(done)}
    for name, text in pages.items():
        files.append(File.generated(config, f"papers/{name}.md", content=text))
    return files


def _chapter(chapter: Chapter) -> str:
    parts = [f"# {escape(chapter.title)}", _paragraph(chapter.citation), *map(_paragraph, chapter.intro)]
    for block in chapter.blocks:
        body = block.body.replace("\n", " ")  # an empty line ends HTML
        parts += [f"## {escape(block.title)}", body, _paragraph(block.caption, "caption")]
        parts.append(_paragraph(block.verdict, "verdict"))
    return "\n\n".join(parts)


def _checks(done: Reproduction) -> str:
    """Where the documents contradict themselves, and every number with its tolerance."""
    return "\n\n".join(
        [
            "# Contradictions and checks",
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
