"""The report as one HTML file that needs nothing else, made to print on one sheet of A4."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from kalscope.common.svg import Line, Panel, draw

if TYPE_CHECKING:
    from kalscope.export.report.content import Curves, Report, Rows

# Colours: Wong (2011), Nature Methods 8, 441. The page is paper in both themes: it is made to be printed.
_STYLE = """
@page{size:A4;margin:11mm 12mm}
*{box-sizing:border-box}
:root{color-scheme:light}
body{margin:0;background:#fff;color:#1b1f24;font:12.5px/1.36 system-ui,sans-serif}
main{max-width:186mm;margin:0 auto;padding:6mm 4mm}
h1{font-size:20px;line-height:1.2;margin:0;overflow-wrap:anywhere}
h2{font-size:13px;margin:0 0 1mm}
p{margin:0 0 2mm;overflow-wrap:anywhere}.quiet{color:#57606a}
svg{display:block;width:100%;height:auto;margin:1mm 0 2mm}
svg text{fill:#1b1f24;font:14px system-ui,sans-serif}svg .end{text-anchor:end}svg .mid{text-anchor:middle}
svg .strong{font-weight:600}svg .label{fill:#57606a}svg path{fill:none}
svg .grid{stroke:#e3e7eb;stroke-width:1}svg .line{stroke-width:2;stroke-linejoin:round}
svg .raw{stroke:#8a939d;stroke-width:1}svg .s2{stroke:#D55E00}svg .thick{stroke-width:3}
svg .truth{stroke:#0072B2;stroke-width:1.4;stroke-dasharray:6 4}
.tables{display:grid;grid-template-columns:1fr 1fr;gap:2mm 6mm;margin-bottom:2.5mm}
table{border-collapse:collapse;width:100%;font-size:11.5px;font-variant-numeric:tabular-nums}
td,th{padding:.25mm 0 .25mm 2mm;border-bottom:1px solid #e3e7eb;text-align:right;vertical-align:top;
overflow-wrap:anywhere}
th{font-weight:600}td:first-child{text-align:left;padding-left:0;color:#57606a}
code{display:block;background:#f4f6f8;border:1px solid #d5dae0;border-radius:1mm;padding:1.2mm 2mm;
font:12px ui-monospace,monospace;overflow-wrap:anywhere;margin-bottom:2.5mm}
.origin{font-size:10.5px}.origin td:first-child{width:22mm}.origin td{text-align:left}
@media(max-width:560px){.tables{grid-template-columns:1fr}}
@media print{main{padding:0;max-width:none}body{font-size:10.5px}h1{font-size:17px}h2{font-size:11px}
table,code{font-size:9.5px}.origin{font-size:9px}.tables{gap:1.5mm 6mm}p,code{margin-bottom:1.5mm}}
"""


def as_html(report: Report) -> str:
    """The page as text; every word from outside is escaped, and the page may load and run nothing."""
    charts = draw(
        [_panel(one) for one in report.charts], report.title, height=205 if len(report.charts) > 1 else 330
    )
    tables = "".join(
        f"<div><h2>{escape(one.heading)}</h2>{_table(one.rows, one.columns)}</div>"
        for one in report.tables
        if one.rows
    )
    texts = "".join(f"<h2>{escape(head)}</h2><p>{escape(text)}</p>" for head, text in report.texts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; "
        "base-uri 'none'; form-action 'none'\">"
        f"<title>{escape(report.title)}</title><style>{_STYLE}</style></head><body><main>\n"
        f'<h1>{escape(report.title)}</h1><p class="quiet">{escape(report.subtitle)}</p>\n{charts}\n'
        f'<div class="tables">{tables}</div>\n{texts}\n'
        f"<h2>To open this again</h2><code>{escape(report.command)}</code>\n"
        f'<div class="origin">{_table(report.origin)}</div>\n</main></body></html>\n'
    )


def _panel(curves: Curves) -> Panel:
    lines = [Line(curves.x, curves.raw, "raw", "raw")]
    if curves.truth is not None:
        lines.append(Line(curves.x, curves.truth, "truth", "truth"))
    lines.append(Line(curves.x, curves.filtered, "filtered", "s2"))
    return Panel(curves.title, tuple(lines), curves.x_label, curves.y_label, y_range=y_range(curves))


def y_range(curves: Curves) -> tuple[float, float]:
    """Ends of the ordinate: what raw and truth need; a wild start of the filter may leave the picture."""
    seen = curves.raw if curves.truth is None else np.concatenate([curves.raw, curves.truth])
    seen = seen[np.isfinite(seen)]
    low, high = (float(seen.min()), float(seen.max())) if len(seen) else (0.0, 1.0)
    room = 0.06 * (high - low) or 0.5 * abs(high) or 1.0
    return low - room, high + room


def _table(rows: Rows, columns: tuple[str, ...] = ()) -> str:
    head = "".join(f"<th>{escape(text)}</th>" for text in columns)
    body = "".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows)
    return f"<table>{f'<tr>{head}</tr>' if columns else ''}{body}</table>"
