"""The page of `kalscope reproduce`: one HTML file that needs nothing else, in light and dark."""

from __future__ import annotations

from html import escape as escape_html
from typing import TYPE_CHECKING

from kalscope.papers.parts import Chapter, Check, Figure, Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from kalscope.papers.disagreements import Disagreement

# Colours: Wong (2011), Nature Methods 8, 441; told apart with every common colour vision. In the dark theme the
# blue is its lighter sister.
_STYLE = """
:root{color-scheme:light dark;--paper:#fff;--ink:#1b1f24;--quiet:#57606a;--edge:#d5dae0;--tint:#f4f6f8;
--raw:#8a939d;--s1:#0072B2;--s2:#D55E00;--s3:#009E73;--s4:#CC79A7;--truth:#1b1f24;--link:#0072B2}
@media(prefers-color-scheme:dark){:root{--paper:#14171b;--ink:#e6e9ed;--quiet:#a0a8b2;--edge:#363c44;
--tint:#1d2127;--raw:#7d8792;--s1:#56B4E9;--s2:#E8762D;--s3:#1FBF93;--s4:#DB93BB;--truth:#e6e9ed;--link:#56B4E9}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.55 system-ui,sans-serif}
main{max-width:64rem;margin:0 auto;padding:1.5rem 1rem 4rem}
h1{font-size:1.9rem;line-height:1.2;margin:.5rem 0}h2{font-size:1.45rem;line-height:1.25;margin:3rem 0 .3rem}
h3{font-size:1.08rem;margin:2rem 0 .4rem}
a{color:var(--link)}p{max-width:46rem;margin:.5rem 0}.quiet{color:var(--quiet)}
figure{margin:0}.wide{overflow-x:auto}svg{display:block;width:100%;min-width:44rem;height:auto}
svg text{fill:var(--ink);font:13px system-ui,sans-serif}svg .end{text-anchor:end}svg .mid{text-anchor:middle}
svg .strong{font-weight:600}svg .label{fill:var(--quiet)}
svg path,svg rect{fill:none}svg .grid{stroke:var(--edge);stroke-width:1}
svg .mark{stroke:var(--ink);stroke-width:1;stroke-dasharray:4 3}
svg .box{stroke:var(--quiet);stroke-width:1.3;fill:var(--tint)}
svg .arrow{stroke:var(--quiet);stroke-width:1.5}svg .head{fill:var(--quiet)}
svg .slip{stroke:var(--s2);stroke-width:2;stroke-dasharray:6 4}svg .slip-word{fill:var(--s2);font-weight:600}
svg .line{stroke-width:1.8;stroke-linejoin:round}svg .thick{stroke-width:3}
svg .raw{stroke:var(--raw);stroke-width:1.1}svg .thick.raw{stroke-width:3}
svg .truth{stroke:var(--truth);stroke-width:1.3;stroke-dasharray:6 4}
svg .s1{stroke:var(--s1)}svg .s2{stroke:var(--s2)}svg .s3{stroke:var(--s3)}svg .s4{stroke:var(--s4)}
figcaption,.caption{color:var(--quiet);font-size:.92rem;max-width:46rem;margin:.3rem 0}
.verdict{border-left:3px solid var(--s3);padding-left:.7rem}
table{border-collapse:collapse;font-size:.93rem;font-variant-numeric:tabular-nums}
th,td{padding:.32rem .7rem;border-bottom:1px solid var(--edge);text-align:right;vertical-align:top}
th{background:var(--tint);font-weight:600}th:first-child,td:first-child{text-align:left}
.words td,.words th{text-align:left}.no{color:var(--s2);font-weight:700}
.sum{background:var(--tint);border:1px solid var(--edge);border-radius:.4rem;padding:.6rem .9rem;max-width:46rem}
nav a{margin-right:1rem}
"""


def escape(text: str) -> str:
    """Text as HTML, with a number and its % sign kept on one line."""
    return escape_html(text).replace(" %", "&nbsp;%")


def page(chapters: Sequence[Chapter], disagreements: Sequence[Disagreement], version: str) -> str:
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
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">"
        f"<title>Kalscope: three documents, reproduced</title><style>{_STYLE}</style></head>"
        f"<body><main>\n{chr(10).join(body)}\n</main></body></html>\n"
    )


def _summary(checks: Sequence[Check]) -> str:
    failed = [check for check in checks if not check.passed]
    if not failed:
        return f'<p class="sum">All {len(checks)} reproduced numbers stay in their stated tolerance.</p>'
    listed = "".join(f"<br>{escape(str(check))}" for check in failed)
    count = f"{len(failed)} of {len(checks)} numbers left their tolerance:"
    return f'<p class="sum"><span class="no">{count}</span>{listed}</p>'


def _chapter(chapter: Chapter) -> str:
    blocks = "".join(_figure(b) if isinstance(b, Figure) else _table(b) for b in chapter.blocks)
    intro = "".join(f"<p>{escape(text)}</p>" for text in chapter.intro)
    return (
        f'<section id="{chapter.key}"><h2>{escape(chapter.title)}</h2>'
        f'<p class="quiet">{escape(chapter.citation)}</p>{intro}{blocks}</section>'
    )


def _figure(figure: Figure) -> str:
    return (
        f'<h3>{escape(figure.title)}</h3><figure><div class="wide">{figure.svg}</div>'
        f"<figcaption>{escape(figure.caption)}</figcaption></figure>"
        f'<p class="verdict">{escape(figure.verdict)}</p>'
    )


def _table(table: Table) -> str:
    return (
        f"<h3>{escape(table.title)}</h3>{rows_of(table.head, table.rows, 'words' if table.words else '')}"
        f'<p class="caption">{escape(table.caption)}</p><p class="verdict">{escape(table.verdict)}</p>'
    )


def rows_of(head: Sequence[str], rows: Sequence[Sequence[str]], kind: str = "") -> str:
    """A table element, every cell escaped."""
    top = "".join(f'<th scope="col">{escape(text)}</th>' for text in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows)
    return (
        f'<div class="wide"><table class="{kind}"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def _disagreements(disagreements: Sequence[Disagreement]) -> str:
    rows = [(d.document, d.where, d.one, d.other, d.here) for d in disagreements]
    head = ("document", "where", "it says", "it also says", "done here")
    return (
        '<section id="disagreements"><h2>Where a paper disagrees with itself</h2>'
        f"{rows_of(head, rows, 'words')}</section>"
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
        f'<section id="checks"><h2>All checks</h2>{rows_of(head, rows)}'
        '<p class="caption">Expected is what the document prints, or what follows from its equations.</p></section>'
    )
