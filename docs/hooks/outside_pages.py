"""Pages of the site that are kept at the top of the repository, and links to its other files.

A page is read in the repository, where its links are files, and on the site. Links to what the site does not hold
lead to the repository.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from mkdocs.structure.files import File, Files

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
OUTSIDE = {
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security-policy.md",
}
"""Pages outside of docs, and their names on the site."""
LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)#\s]+)")
"""The file that a link names, without its anchor."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are kept outside of docs."""
    for source, page in OUTSIDE.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=_on_site(text, PurePosixPath(), config)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:  # noqa: ARG001
    """Lead links that leave docs to the page or the repository."""
    if page.file.generated_by:
        return markdown
    return _on_site(markdown, PurePosixPath("docs", page.file.src_uri).parent, config)


def _on_site(text: str, folder: PurePosixPath, config: MkDocsConfig) -> str:
    """The text with the links of a page in `folder` of the repository as the site has them.

    Raises:
        FileNotFoundError: A link leads to no file: a wrong link to the repository would break only there.
    """

    def link(found: re.Match[str]) -> str:
        target = PurePosixPath(posixpath.normpath(folder / found[1]))
        if target.parts[:1] == ("docs",) and folder.parts[:1] == ("docs",):
            return found[1]
        if target.parts[:1] == ("docs",):
            return str(target.relative_to("docs"))
        if str(target) in OUTSIDE:
            return "../" * (len(folder.parts) - 1) + OUTSIDE[str(target)]
        if not (ROOT / target).exists():
            raise FileNotFoundError(f"link to {found[1]} in {folder} leads to no file")
        return f"{config.repo_url}/blob/main/{target}"

    return LINK.sub(link, text)
