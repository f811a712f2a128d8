"""Links that only the site has: a page reads well on a code host, and gets them when the site is
built.

`` `package.module.function` `` in a page becomes a link to the Python reference; *words* followed
by the comment `<!-- site: PAGE -->` become a link to that page; links to the project's own pages
beside docs/ lead to their copies.
"""

import posixpath
import re
from typing import Any

from api_pages import NAME, cited_entries
from root_pages import PAGES

FENCE = re.compile(r"^(`{3,})[^\n]*\n.*?^\1[ \t]*$", re.M | re.S)
SITE = re.compile(r"\*([^*\n]+)\*<!-- site: (\S+) -->")
ROOT_PAGE = re.compile(
    rf"\]\((?:\.\./)+({'|'.join(file.replace('.', '[.]') for file in PAGES.values())})(#[^)]*)?\)"
)


def with_site_links(text: str, docname: str) -> str:
    """The page as the site shows it; code blocks stay as they are."""
    folder = posixpath.dirname(docname)
    parts, end = [], 0
    for block in FENCE.finditer(text):
        parts += [_linked(text[end : block.start()], folder), block[0]]
        end = block.end()
    return "".join([*parts, _linked(text[end:], folder)])


def _linked(text: str, folder: str) -> str:
    def name(match: re.Match[str]) -> str:
        if match[1] not in cited_entries():
            return match[0]
        page = posixpath.relpath("generated/api/cited.md", folder or ".")
        return f"[{match[0]}]({page}#{match[1].replace('.', '').lower()})"

    def root(match: re.Match[str]) -> str:
        copy = next(
            f"generated/project/{name}.md" for name, file in PAGES.items() if file == match[1]
        )
        return f"]({posixpath.relpath(copy, folder or '.')}{match[2] or ''})"

    return ROOT_PAGE.sub(root, SITE.sub(r"[\1](\2)", NAME.sub(name, text)))


def setup(app: Any) -> dict[str, Any]:
    """Reads every page but the generated ones."""

    def read(app: Any, docname: str, content: list[str]) -> None:
        if not docname.startswith("generated/"):
            content[0] = with_site_links(content[0], docname)

    app.connect("source-read", read)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
