"""Makes docs/tutorial.ipynb of the script in docs/python.md, a step a cell, with
what each prints and draws.

Example: python docs/notebook.py
"""

import io
import json
import os
import re
import tempfile
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from figures import svg_of

HERE = Path(__file__).parent.absolute()
STEPS = {  # first words of a cell's code, and what the cell is for
    "import recal": "Load the program.",
    "simulated =": "Simulate the hour of one aged unit. A log of your own: `recal.read_run`.",
    "aligned =": "Find attitude and heading, each with one standard deviation.",
    "result =": "Recalibrate the table. Nothing is stored yet.",
    "result.to_html": "Write the report, and draw both tables with the points of the run.",
    "with recal.open_store": "Commit the new table under a name.",
}


OF_THE_PAGE = "; or as a [notebook](tutorial.ipynb)"  # what only the page says
SHOWN = "result.plot()"  # a line that a notebook shows the value of
SAVED = '.write_html("tables.html")'


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
    head = page.split("```")[0].strip()
    assert OF_THE_PAGE in head, f"docs/python.md: needed {OF_THE_PAGE!r} before its script"
    head = head.replace(OF_THE_PAGE, "")
    cells: list[dict[str, object]] = [_text(head)]
    names: dict[str, Any] = {}
    for lines in cells_of(match[1].replace(SAVED, "")):
        cells.append(
            _text(next(text for words, text in STEPS.items() if lines[0].startswith(words)))
        )
        cells.append(
            {
                "cell_type": "code",
                "execution_count": None,
                "id": f"cell-{len(cells)}",
                "metadata": {},
                "outputs": _outputs(lines, names),
                "source": _lines("\n".join(lines).strip()),
            }
        )
    for k, cell in enumerate(cells):
        cell["id"] = f"cell-{k}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}


def _outputs(lines: list[str], names: dict[str, Any]) -> list[dict[str, object]]:
    """What a cell prints, and what its last line shows."""
    printed, last = io.StringIO(), lines[-1]
    with redirect_stdout(printed):
        exec("\n".join(lines[:-1] if last.startswith(SHOWN) else lines), names)
        shown = eval(last, names) if last.startswith(SHOWN) else None
    found: list[dict[str, object]] = []
    if printed.getvalue():
        text = _lines(printed.getvalue())
        found.append({"output_type": "stream", "name": "stdout", "text": text})
    if shown is not None:
        data = {
            "application/vnd.plotly.v1+json": json.loads(shown.to_json()),
            "image/svg+xml": _lines(svg_of(json.loads(shown.to_json()), "tutorial")),
            "text/plain": [repr(type(shown))],
        }
        found.append({"output_type": "display_data", "data": data, "metadata": {}})
    return found


def _text(markdown: str) -> dict[str, object]:
    return {"cell_type": "markdown", "id": "", "metadata": {}, "source": _lines(markdown)}


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


if __name__ == "__main__":
    page = (HERE / "python.md").read_text("utf-8")
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        made = notebook(page)
    (HERE / "tutorial.ipynb").write_text(json.dumps(made, indent=1) + "\n", "utf-8")
