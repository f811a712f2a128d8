"""Long tables of the studies as JSON, one file a study in benchmarks/results; pages of docs give
the short ones.
"""

import json
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks.study import ROOT, commit

FOLDER = ROOT / "benchmarks" / "results"
HEADING = re.compile(r"#+ (.*)")
BAR = re.compile(r"(?<!\\)\|")


def tables_of(text: str) -> list[dict[str, Any]]:
    """The Markdown tables of a text: the heading above each, its columns, its rows of cells."""
    found: list[dict[str, Any]] = []
    title, inside = "", False
    for line in text.splitlines():
        if heading := HEADING.fullmatch(line):
            title = heading[1]
        if not line.startswith("|"):
            inside = False
            continue
        cells = [cell.strip() for cell in BAR.split(line.strip())[1:-1]]
        if not inside:
            found.append({"title": title, "columns": cells, "rows": []})
        elif any(set(cell) - set("-: ") for cell in cells):
            found[-1]["rows"].append(cells)
        inside = True
    return found


def write(name: str, command: str, text: str) -> Path:
    """Put the tables of a study's text into NAME.json, with the command that made them."""
    document = {
        "study": name,
        "command": command,
        "commit": commit(),
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "tables": tables_of(text),
    }
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / f"{name}.json"
    path.write_text(dumped(document), "utf-8")
    return path


def dumped(document: dict[str, Any]) -> str:
    """JSON with a row of a table on each line."""
    text = json.dumps(document, indent=1, ensure_ascii=False)
    return re.sub(r"\[\s+(\"[^\[\]{}]*\")\s+\]", _one_line, text) + "\n"


def _one_line(found: re.Match[str]) -> str:
    cells = re.sub(r'",\s+"', '", "', found[1])
    return f"[{cells}]"
