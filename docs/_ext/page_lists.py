"""Lists of the pages that lie in docs/ itself: guides by name, all others are studies and notes;
none must be there.
"""

from pathlib import Path

OF_INDEX = (  # named in index.md itself
    "index",
    "quickstart",
    "tutorial",
    "concepts",
    "theory",
    "which_command",
    "troubleshooting",
    "glossary",
    "faq",
    "figures_of_merit",
)
GUIDES = (
    "log_formats",
    "at_the_aircraft",
    "mems",
    "replay",
    "bridges",
    "store",
    "fleet",
    "serve",
    "environments",
)
TEXTS = {
    "guides": ("Formats, stores and services", "Pages of single parts of the program."),
    "studies": (
        "Studies and notes",
        "What the program reaches, with the numbers, and what was found on the way.",
    ),
}


def page_lists(docs: Path) -> dict[str, str]:
    """Markdown by page name; a list of no pages is left out."""
    there = sorted(p.stem for p in docs.glob("*.md") if p.stem not in OF_INDEX)
    lists = {
        "guides": [g for g in GUIDES if g in there],
        "studies": [p for p in there if p not in GUIDES],
    }
    return {name: _list(*TEXTS[name], pages) for name, pages in lists.items() if pages}


def _list(title: str, text: str, pages: list[str]) -> str:
    entries = "\n".join(f"/{page}" for page in pages)
    return f"# {title}\n\n{text}\n\n```{{toctree}}\n:maxdepth: 1\n\n{entries}\n```\n"
