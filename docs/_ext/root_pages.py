"""The project's own pages beside docs/ (conventions, architecture, changes), with their links made
good for the site.
"""

import re
from pathlib import Path

PAGES = {
    "conventions": "CONVENTIONS.md",
    "architecture": "ARCHITECTURE.md",
    "changelog": "CHANGELOG.md",
    "security": "SECURITY.md",
}
LINK = re.compile(r"\]\(([^)#\s]+)(#[^)]*)?\)")


def root_pages(root: Path) -> dict[str, str]:
    """Markdown by page name, of the pages that exist."""
    return {
        name: _relinked((root / file).read_text("utf-8"), root)
        for name, file in PAGES.items()
        if (root / file).exists()
    }


def _relinked(text: str, root: Path) -> str:
    """Links from the project's folder, as seen from docs/generated/project/; what is not on the
    site becomes its name.
    """
    by_file = {file: f"{name}.md" for name, file in PAGES.items() if (root / file).exists()}

    def relink(match: re.Match[str]) -> str:
        target, anchor = match[1], match[2] or ""
        if "://" in target:
            return match[0]
        if target in by_file:
            return f"]({by_file[target]}{anchor})"
        if target.startswith("docs/") and (root / target).exists():
            return f"](../../{target.removeprefix('docs/')}{anchor})"
        return "](../../index.md)"

    return LINK.sub(relink, text)
