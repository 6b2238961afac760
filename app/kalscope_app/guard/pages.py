"""The small pages besides the dashboard itself, and the security headers of every page. Pure."""

from __future__ import annotations

import base64
import hashlib
import html
import re

from kalscope_app.guard.rules import Policy, Refuse

OPEN_THE_LINK = "Open the link printed in the terminal"

_GO_ON = "location.replace(document.querySelector('a').href)"

_KEEP_ADDRESS = (
    "{ const replace = history.replaceState; history.replaceState = (state) => replace.call(history, state, ''); }"
)
"""Below a path viser appends ?websocket=… to the page's address, which would be refused after a reload."""

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">
<title>{title}</title><style>
:root {{ color-scheme: light dark;
  --ink: #1c2430; --dim: #5a6675; --paper: #f4f6f8; --card: #fff; --line: #d9dfe6 }}
@media (prefers-color-scheme: dark) {{
  :root {{ --ink: #e6eaf0; --dim: #9aa6b5; --paper: #14181e; --card: #1d232b; --line: #323b47 }} }}
body {{ margin: 0; min-height: 100vh; display: grid; place-items: center; background: var(--paper);
  color: var(--ink); font: 16px/1.5 system-ui, sans-serif }}
main {{ max-width: 32rem; margin: 1rem; padding: 1.5rem 2rem; background: var(--card);
  border: 1px solid var(--line); border-radius: 12px }}
li {{ margin: .4rem 0 }} ul {{ padding-left: 1.2rem }}
h1 {{ font-size: 1.25rem; margin: 0 0 .5rem }} p {{ margin: .5rem 0 }} .dim {{ color: var(--dim) }}
code {{ font-size: .9em; overflow-wrap: anywhere }} a {{ color: inherit }}
</style></head><body><main><h1>{title}</h1>{body}</main></body></html>
"""


def refusal_page(policy: Policy, refusal: Refuse) -> str:
    """The page of a refusal: what to do first, then why."""
    return _PAGE.format(
        title=OPEN_THE_LINK,
        body=f"<p>{html.escape(refusal.reason)}</p><p class=dim>When Kalscope starts it prints a line like "
        f"<br><code>Kalscope: http://127.0.0.1:{policy.port}/?token=…</code><br>"
        "Open that address once in this browser. It leads to a page that may be bookmarked.</p>",
    )


def link_page(home: str = "/") -> str:
    """The page behind the printed link; `home` is the path of the dashboard.

    It redirects by script: a browser that follows another site's link to us would not send a Strict cookie
    along a redirect.
    """
    body = f'<p><a href="{home}">Go on to the dashboard</a></p><script>{_GO_ON}</script>'
    return _PAGE.format(title="Opening Kalscope…", body=body)


def dashboard_page(stock: str, script: str = "") -> str:
    """The page of viser, with our name and the scripts that must run before its own.

    Args:
        stock: viser's own page.
        script: JavaScript of the dashboard that must run before viser's.

    Raises:
        ValueError: the page is not as expected.
    """
    head, title = "<head>", "<title>Viser</title>"
    if stock.count(head) != 1 or stock.count(title) != 1:
        raise ValueError("viser's page has another head")
    return stock.replace(title, "<title>Kalscope</title>").replace(
        head, f"{head}<script>{_KEEP_ADDRESS}{script}</script>"
    )


def inline_script_hashes(page: str) -> tuple[str, ...]:
    """The CSP sources of the inline scripts of an HTML page, `'sha256-…'` each, in their order."""
    scripts = re.findall(r"<script\b[^>]*>(.*?)</script>", page, re.DOTALL)
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    return tuple(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)


_NO_FRAMES = "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"


def page_headers(csp: str) -> dict[str, str]:
    """The security headers of every answer that is not a websocket."""
    return {
        "Content-Security-Policy": csp,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
    }


def small_page_csp() -> str:
    """The content policy of our own two small pages."""
    scripts = " ".join(inline_script_hashes(link_page()))
    return f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {scripts}; {_NO_FRAMES}"


def dashboard_csp(script_hashes: tuple[str, ...], own_origin: str | None = None) -> str:
    """The content policy of viser's page: its own loader runs, and nothing that a text injects.

    Args:
        script_hashes: of the inline scripts of viser's page. 'strict-dynamic' lets the loader start the
            program it unpacks, but no script or handler inside a text (a file name, a CSV header) runs.
        own_origin: `http://HOST` or `https://HOST`, with a HOST that `host_allowed` has accepted; some browsers
            do not count our own websocket as 'self' and want it by name.
    """
    scripts = " ".join(script_hashes)
    socket = f" {own_origin.replace('http', 'ws', 1)}" if own_origin else ""
    return (
        f"default-src 'none'; script-src {scripts} 'strict-dynamic' 'wasm-unsafe-eval' blob:; "
        "worker-src blob:; style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
        f"media-src data: blob:; connect-src 'self'{socket} data: blob:; {_NO_FRAMES}"
    )
