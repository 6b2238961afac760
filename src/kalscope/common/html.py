"""HTML pages that need nothing else: they load nothing, run nothing, and show every word from outside as text."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

_PAGE = """\
<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width,initial-scale=1">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'">
<title>{title}</title><style>{style}</style></head>
<body><main>
{body}
</main></body></html>
"""


def document(title: str, style: str, body: str) -> str:
    """A whole page: `title` is text, `style` CSS and `body` HTML."""
    return _PAGE.format(title=escape(title), style=style, body=body)


def table(head: Sequence[str], rows: Sequence[Sequence[str]], kind: str = "") -> str:
    """A table element of CSS class `kind`, every cell escaped; without headings where `head` is empty."""
    top = "".join(f'<th scope="col">{escape(text)}</th>' for text in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows)
    head_rows = f"<thead><tr>{top}</tr></thead>" if head else ""
    css = f' class="{kind}"' if kind else ""
    return f'<div class="wide"><table{css}>{head_rows}<tbody>{body}</tbody></table></div>'
