"""The chapters of `kalscope reproduce` as pages of the site, computed while it is built."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from mkdocs.structure.files import File, Files

from kalscope.common.charts import markup_of_table
from kalscope.papers.page import list_disagreements
from kalscope.papers.parts import Chapter
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
    where = [[one[key] for key in ("document", "where", "one", "other", "here")] for one in list_disagreements()]
    checks = [
        (one.name, f"{one.value:.6g}", f"{one.expected:.6g}", "yes" if one.passed else "no") for one in done.checks
    ]
    return "\n\n".join(
        [
            "# Contradictions and checks",
            "## Where a document disagrees with itself",
            markup_of_table(("document", "where", "it says", "it also says", "done here"), where),
            f"## {len(checks)} reproduced numbers, {len(done.failed)} of them outside of their tolerance",
            markup_of_table(("number", "reproduced", "expected", "within its tolerance"), checks),
            _paragraph("Expected is what the document prints, or what follows from its equations."),
        ]
    )


def _paragraph(text: str, kind: str = "") -> str:
    """A paragraph whose text is not Markdown."""
    css = f' class="{kind}"' if kind else ""
    return f"<p{css}>{escape(text)}</p>"
