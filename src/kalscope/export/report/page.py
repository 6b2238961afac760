"""The report as one HTML file that needs nothing else, made to print on one sheet of A4."""

from __future__ import annotations

from html import escape
from pathlib import Path

from kalscope.common.charts import draw_svg
from kalscope.common.html import document, table
from kalscope.export.report.content import Report


def as_html(report: Report) -> str:
    """The page as text; every word from outside is escaped, and the page may load and run nothing."""
    height = (205 if len(report.charts) > 1 else 330) - 6 * len(report.tables[-1].rows)  # the pins need the space
    tables = "".join(
        "<div>"
        + "".join(f"<h2>{escape(one.heading)}</h2>{table(one.columns, one.rows)}" for one in column)
        + "</div>"
        for column in report.table_columns
    )
    texts = "".join(f"<h2>{escape(head)}</h2><p>{escape(text)}</p>" for head, text in report.texts)
    body = (
        f'<h1>{escape(report.title)}</h1><p class="quiet">{escape(report.subtitle)}</p>\n'
        f'{draw_svg(report.charts, report.title, height=height)}\n<div class="tables">{tables}</div>\n{texts}\n'
        f"<h2>Reopen this session</h2><code>{escape(report.command)}</code>\n"
        f'<div class="origin">{table((), report.origin)}</div>\n'
    )
    return document(report.title, (Path(__file__).parent / "page.css").read_text(encoding="utf-8"), body)
