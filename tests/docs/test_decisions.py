"""Each decision names modules that exist, and their docstrings name it back."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DECISIONS = ROOT / "docs/decisions"
FOLDERS = ("ins", "trajectories", "alignment", "infield", "simreal", "recal", "benchmarks")
SOURCES = [p for f in (*FOLDERS, "docs/_ext") for p in (ROOT / f).rglob("*.py")]

# title; date and modules; what was decided and why
FORM = re.compile(r"# \S[^\n]*\n\n\d{4}-\d\d-\d\d, (`[\w/.]+`(?:, `[\w/.]+`)*)\n\n\S")
BACK = re.compile(r"^Decision: docs/decisions/(\d{4}-[a-z0-9-]+)\.md\.$", re.M)


def decisions():
    return {p.stem: p.read_text("utf-8") for p in DECISIONS.glob("[0-9]*.md")}


def docstring(path):
    return ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""


def test_decisions_and_docstrings_name_each_other():
    bound = set()
    for name, text in decisions().items():
        form = FORM.match(text)
        assert form, name
        bound |= {(name, module) for module in re.findall(r"`([^`]+)`", form[1])}
    named = {
        (name, path.relative_to(ROOT).as_posix())
        for path in SOURCES
        for name in BACK.findall(docstring(path))
    }
    assert bound - named == set(), "module gone, or silent about its decision"
    assert named - bound == set(), "decision gone, or silent about its module"


def test_numbers_are_used_once():
    names = sorted(decisions())
    assert len({name[:4] for name in names}) == len(names)
