"""The rooms of the product keep their order, where no rule of ruff or import-linter says it
(pyproject.toml, run by .ci/run): sizes of folders, empty doors, untyped results that only fall,
thresholds with a reason. A ceiling is the count of today; whoever lowers the count lowers it too.
"""

import ast
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("ins", "trajectories", "alignment", "infield", "simreal", "recal")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
MODULES_IN_A_FOLDER = 15
FRONT_DOOR = "recal/__init__.py"  # the one package file with code

# Mappings from text to anything in the product, by whatever name; the goal is 60.
UNTYPED_RESULTS = 59
MAPPINGS = {"dict", "Dict", "Mapping", "MutableMapping", "defaultdict", "OrderedDict"}
ANYTHING = {"Any", "object"}
CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*(degC)?")

# One concept, one home. The simulator shares no formula with the estimators, so it has its own.
HOMES = {
    r"1\.4826": {"ins/robust.py"},
    r"np\.flatnonzero\(\s*np\.diff\(\s*np\.concatenate": {
        "ins/robust.py",
        "trajectories/runs/streams.py",
    },
    r"\b0\.664\b": {"ins/noise.py"},
    r"np\.arctan2\(-y, -z\)": {"ins/attitude.py"},
}


def test_no_folder_holds_too_many_modules():
    count: dict[Path, int] = defaultdict(int)
    for path in SOURCES:
        count[path.parent] += path.name != "__init__.py"
    full = {str(k.relative_to(ROOT)): n for k, n in count.items() if n > MODULES_IN_A_FOLDER}
    assert full == {}


def test_package_files_hold_a_docstring_alone():
    """What a package means is said there; code in it would run on every import below it."""
    with_code = set()
    for path in SOURCES:
        if path.name == "__init__.py":
            body = ast.parse(path.read_text(encoding="utf-8")).body
            docstring = bool(body) and isinstance(getattr(body[0], "value", None), ast.Constant)
            if len(body) > docstring:
                with_code.add(str(path.relative_to(ROOT)))
    assert with_code <= {FRONT_DOOR}


def name_of(node: ast.AST) -> str | None:
    return getattr(node, "id", getattr(node, "attr", None))


def is_untyped(node: ast.AST) -> bool:
    """`dict[str, Any]`, `Mapping[str, object]`, `dict[Any, Any]`, ..."""
    if not isinstance(node, ast.Subscript) or name_of(node.value) not in MAPPINGS:
        return False
    of = node.slice.elts if isinstance(node.slice, ast.Tuple) else []
    return len(of) == 2 and name_of(of[1]) in ANYTHING


@dataclass(frozen=True)
class Source:
    """A module: its text, its tree and all nodes of that."""

    text: str
    tree: ast.Module
    nodes: tuple[ast.AST, ...]


def source_of(text: str) -> Source:
    tree = ast.parse(text)
    return Source(text, tree, tuple(ast.walk(tree)))


@pytest.fixture(scope="module")
def sources() -> dict[str, Source]:
    """Every module by its path; read once, for that takes longer than to ask them."""
    return {
        str(path.relative_to(ROOT)): source_of(path.read_text(encoding="utf-8")) for path in SOURCES
    }


def annotations(nodes: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """What arguments, results, fields and variables are said to be."""
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from [node.returns] if node.returns else []
        elif isinstance(node, ast.arg | ast.AnnAssign):
            yield from [node.annotation] if node.annotation else []


def aliases(trees: Iterable[ast.Module]) -> set[str]:
    """Names that stand for such a mapping, or for another one that does."""
    found: set[str] = set()
    for tree in trees:
        for node in tree.body:
            if isinstance(node, ast.Assign) and is_untyped(node.value):
                found |= {str(name_of(target)) for target in node.targets}
    return found


def untyped(source: Source, other_names: set[str]) -> int:
    """How often a module says such a mapping: in full, by an alias, or as a bare dict."""
    count = sum(map(is_untyped, source.nodes))
    for annotation in annotations(source.nodes):
        inside = list(ast.walk(annotation))
        named = {id(node.value) for node in inside if isinstance(node, ast.Subscript)}
        bare = [n for n in inside if isinstance(n, ast.Name) and id(n) not in named]
        count += sum(n.id in MAPPINGS | other_names for n in bare)
    return count


def test_untyped_results_only_fall(sources):
    names = aliases(source.tree for source in sources.values())
    count = {path: untyped(source, names) for path, source in sources.items()}
    most = sorted(count.items(), key=lambda item: -item[1])[:20]
    assert sum(count.values()) <= UNTYPED_RESULTS, most


@pytest.mark.parametrize("pattern", HOMES)
def test_each_of_these_is_written_in_one_place(pattern):
    places = {
        str(path.relative_to(ROOT))
        for path in SOURCES
        if re.search(pattern, path.read_text(encoding="utf-8"))
    }
    assert places <= HOMES[pattern]


# A threshold is a number of a module that something is compared with by size. What stands beside it
# or above it is its unit and where it comes from: a page or paper, a figure one can check, a test.
REASONED_THRESHOLDS = 1.0  # share of all: every one
SOURCE = re.compile(r"\d|\.md\b|tests/")


def is_number(node: ast.expr) -> bool:
    """A number, or several, written out or made of others."""
    match node:
        case ast.Constant():
            return isinstance(node.value, int | float) and not isinstance(node.value, bool)
        case ast.UnaryOp():
            return is_number(node.operand)
        case ast.BinOp():
            return is_number(node.left) or is_number(node.right)
        case ast.Tuple():
            return bool(node.elts) and all(map(is_number, node.elts))
    return False


def comments(text: str) -> dict[int, str]:
    """Comment of each line that has one."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return {t.start[0]: t.string for t in tokens if t.type == tokenize.COMMENT}


def beside(node: ast.stmt, said: dict[int, str], lines: list[str]) -> str:
    """Comments on the lines of a statement and those directly above it."""
    found = [said.get(k, "") for k in range(node.lineno, node.end_lineno + 1)]
    above = node.lineno - 1
    while above in said and lines[above - 1].lstrip().startswith("#"):
        found.append(said[above])
        above -= 1
    return " ".join(found)


def numbers(source: Source) -> Iterator[tuple[str, str]]:
    """Name of each constant of a module that is a number, and what is said beside it."""
    assigned = [node for node in source.tree.body if isinstance(node, ast.Assign)]
    said = comments(source.text) if assigned else {}
    lines = source.text.splitlines()
    for node in assigned:
        words = beside(node, said, lines)
        for target in node.targets:
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(target.elts, node.value.elts, strict=True))
            for name, value in pairs:
                if isinstance(name, ast.Name) and CONSTANT.fullmatch(name.id) and is_number(value):
                    yield name.id, words


def compared_by_size(sources: Iterable[Source]) -> set[str]:
    """Names of constants within a comparison with <, <=, > or >=."""
    found = set()
    ordered = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
    for source in sources:
        for node in source.nodes:
            if isinstance(node, ast.Compare) and any(isinstance(o, ordered) for o in node.ops):
                for part in ast.walk(node):
                    found.add(getattr(part, "id", None) or getattr(part, "attr", ""))
    return found


def test_reasoned_thresholds_only_rise(sources):
    names = compared_by_size(sources.values())
    found = [
        (path, name, words)
        for path, source in sources.items()
        for name, words in numbers(source)
        if name in names
    ]
    bare = [f"{path}: {name}" for path, name, words in found if not SOURCE.search(words)]
    assert 1 - len(bare) / len(found) >= REASONED_THRESHOLDS, bare
