"""Lists of the pages that lie in docs/ itself: evidence and guides by name, all others are notes;
none must be there.
"""

from pathlib import Path

OF_INDEX = (  # named in index.md itself
    "index",
    "python",
    "quickstart",
    "concepts",
    "troubleshooting",
    "glossary",
)
EVIDENCE = ("accuracy", "flights", "gap", "real_logs", "real_evidence", "reliability", "speed")
GUIDES = (
    "at_the_aircraft",
    "log_formats",
    "twin_fit",
    "flight_update",
    "replay",
    "mems",
    "store",
    "serve",
    "environments",
    "claims",
)
TEXTS = {
    "evidence": ("Evidence", "What the program reaches, with intervals, and what it misses."),
    "guides": ("Topics", "Logs, noise models, flights, replay, MEMS units, store."),
    "studies": ("Notes", "Other pages."),
}


def page_lists(docs: Path) -> dict[str, str]:
    """Markdown by page name; a list of no pages is left out."""
    there = sorted(p.stem for p in docs.glob("*.md") if p.stem not in OF_INDEX)
    lists = {
        "evidence": [e for e in EVIDENCE if e in there],
        "guides": [g for g in GUIDES if g in there],
        "studies": [p for p in there if p not in (*GUIDES, *EVIDENCE)],
    }
    return {name: _list(*TEXTS[name], pages) for name, pages in lists.items() if pages}


def _list(title: str, text: str, pages: list[str]) -> str:
    entries = "\n".join(f"/{page}" for page in pages)
    return f"# {title}\n\n{text}\n\n```{{toctree}}\n:maxdepth: 1\n\n{entries}\n```\n"
