"""Each page forbids the browser to load anything from another host, so no other host learns who reads it."""

from __future__ import annotations

POLICY = "default-src 'self' 'unsafe-inline' data: blob:"
"""The theme has scripts and styles in its pages, and the charts are in them too."""


def on_post_page(output: str, **_: object) -> str:
    """Called by mkdocs."""
    return output.replace("<head>", f'<head><meta http-equiv="Content-Security-Policy" content="{POLICY}">', 1)
