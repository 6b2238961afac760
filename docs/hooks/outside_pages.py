"""Links of a page to files that the site does not have point to the repository.

A page is read in the repository, where its links are files, and on the site.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"(?<=\]\()(\.\./[^)#\s]+)")
"""The file outside of docs that a link names, without its anchor."""


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, **_: object) -> str:
    """Called by mkdocs.

    Raises:
        FileNotFoundError: A link points to no file: a wrong link to the repository would break only there.
    """

    def link(found: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join("docs", posixpath.dirname(page.file.src_uri), found[1]))
        if not (ROOT / target).exists():
            raise FileNotFoundError(f"link to {found[1]} in {page.file.src_uri} points to no file")
        return f"{config.extra['repository']}/blob/main/{target}"

    return LINK.sub(link, markdown)
