"""Writes the pages that come from the code into docs/generated/ before Sphinx reads anything (git
ignores them).
"""

from pathlib import Path
from typing import Any

from api_pages import api_pages
from command_pages import command_pages
from file_pages import file_pages
from page_lists import page_lists
from root_pages import root_pages

DOCS = Path(__file__).parents[1]


def write_pages(app: Any = None) -> None:
    """Each page only where its text changed, so that a second build is quick; pages of code that is
    gone go too.
    """
    made = {
        "commands": command_pages(),
        "files": file_pages(),
        "api": api_pages(),
        "project": root_pages(DOCS.parent),
        "pages": page_lists(DOCS),
    }
    kept = set()
    for folder, pages in made.items():
        for name, text in pages.items():
            path = DOCS / "generated" / folder / f"{name}.md"
            kept.add(path)
            if not path.exists() or path.read_text("utf-8") != text:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, "utf-8")
    for path in (DOCS / "generated").rglob("*.md"):
        if path not in kept:
            path.unlink()


def setup(app: Any) -> dict[str, Any]:
    """Runs before the sources are listed."""
    app.connect("builder-inited", write_pages)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
