"""Pages of the site that are kept at the top of the repository, and links to its other files.

A page is read in the repository, where its links are files, and on the site. Links to files that the site does not
have point to the repository.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import TYPE_CHECKING

from mkdocs.structure.files import File, Files

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
OUTSIDE = {
    "CHANGELOG.md": "project/changelog.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "SECURITY.md": "project/security-policy.md",
}
"""Pages outside of docs, and their places on the site."""
LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)#\s]+)")
"""The file that a link names, without its anchor."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are kept outside of docs."""
    for source, page in OUTSIDE.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=_on_site(text, source, page, config)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:  # noqa: ARG001
    """Point links that leave docs to the page or the repository."""
    if page.file.generated_by:
        return markdown
    return _on_site(markdown, f"docs/{page.file.src_uri}", page.file.src_uri, config)


def _on_site(text: str, source: str, page: str, config: MkDocsConfig) -> str:
    """The text of a file of the repository, with the links that it needs as a page of the site.

    Raises:
        FileNotFoundError: A link points to no file: a wrong link to the repository would break only there.
    """

    def link(found: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(source), found[1]))
        if not (ROOT / target).exists():
            raise FileNotFoundError(f"link to {found[1]} in {source} points to no file")
        on_site = target.removeprefix("docs/") if target.startswith("docs/") else OUTSIDE.get(target)
        if on_site is None:
            return f"{config.extra['repository']}/blob/main/{target}"
        return posixpath.relpath(on_site, posixpath.dirname(page))

    return LINK.sub(link, text)
