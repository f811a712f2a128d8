"""docs/claims.md is true: every function in it is there, documented, and used by the program."""

import ast
import importlib
import inspect
import re
from functools import cache
from itertools import groupby
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("ins", "trajectories", "alignment", "infield", "simreal", "recal")
COLUMNS = ["step", "what", "function"]


def table_rows():
    """Heading of the document, step, what and function."""
    rows, document = [], ""
    for line in (ROOT / "docs/claims.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            document = line.removeprefix("## ")
        if line.startswith("|"):
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            assert len(cells) == len(COLUMNS)
            rows.append([document, *cells])
    heads = [row[1:] for row in rows if row[1] == "step"]
    assert heads and all(head == COLUMNS for head in heads)
    return [row for row in rows if row[1] not in ("step", "---")]


@cache
def names_used(path):
    """Every name and attribute that a file reads, and what it imports."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    used |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    return used | {
        a.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for a in node.names
    }


@pytest.mark.parametrize("row", table_rows(), ids=lambda row: f"{row[0]} {row[1]}")
def test_row_names_what_is_there(row):
    match = re.fullmatch(r"`([a-z_.]+)\.(\w+)`", row[3])
    assert match, f"{row[3]}: not a function in backquotes"
    module = importlib.import_module(match[1])
    function = getattr(module, match[2])
    assert callable(function) and inspect.getmodule(function) is module and inspect.getdoc(function)
    source = Path(inspect.getsourcefile(module))
    assert source.is_relative_to(ROOT)
    others = (p for package in PACKAGES for p in (ROOT / package).rglob("*.py") if p != source)
    used_here = source.read_text(encoding="utf-8").count(f"{match[2]}(") > 1
    assert used_here or any(match[2] in names_used(p) for p in others), (
        f"{row[3]} is used by nothing but tests"
    )


def test_rows_of_a_document_stand_together_and_once():
    rows = table_rows()
    documents = [name for name, _ in groupby(rows, key=lambda row: row[0])]
    assert len(documents) == len(set(documents))
    assert len({(row[0], row[1]) for row in rows}) == len(rows)
