"""Makes docs/tutorial.ipynb of docs/tutorial.md: the session of the tutorial, a step a cell.

Example: python docs/notebook.py
"""

import json
import re
from pathlib import Path

HERE = Path(__file__).parent
STEPS = {  # first words of a cell's code, and what the cell is for
    "import recal": "Load the program.",
    "simulated =": "Simulate the hour of one aged unit. A log of your own: `recal.read_run`.",
    "aligned =": "Find attitude and heading, each with one standard deviation.",
    "result =": "Recalibrate the table. Nothing is stored yet.",
    "result.to_html": "Write the report, and draw both tables.",
    "with recal.open_store": "Commit the new table under a name.",
}


def cells_of(code: str) -> list[list[str]]:
    """The lines of each step."""
    found: list[list[str]] = []
    for line in code.strip().splitlines():
        if any(line.startswith(words) for words in STEPS):
            found.append([])
        found[-1].append(line)
    return found


def notebook(page: str) -> dict[str, object]:
    """The tutorial's title and each step as a cell with a sentence before it."""
    match = re.search(r"^```python\n(.*?)^```$", page, re.M | re.S)
    assert match is not None
    cells: list[dict[str, object]] = [_text(page.split("```")[0].strip())]
    for lines in cells_of(match[1]):
        cells.append(
            _text(next(text for words, text in STEPS.items() if lines[0].startswith(words)))
        )
        cells.append(
            {
                "cell_type": "code",
                "execution_count": None,
                "id": f"cell-{len(cells)}",
                "metadata": {},
                "outputs": [],
                "source": _lines("\n".join(lines)),
            }
        )
    for k, cell in enumerate(cells):
        cell["id"] = f"cell-{k}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}


def _text(markdown: str) -> dict[str, object]:
    return {"cell_type": "markdown", "id": "", "metadata": {}, "source": _lines(markdown)}


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


if __name__ == "__main__":
    made = notebook((HERE / "tutorial.md").read_text("utf-8"))
    (HERE / "tutorial.ipynb").write_text(json.dumps(made, indent=1) + "\n", "utf-8")
