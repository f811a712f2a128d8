"""Every public name of `ins` says what it takes and gives, and its examples run."""

import ast
import doctest
import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest

import ins

FOLDER = Path(ins.__file__).parent
# Parts of compiled loops are documented by one sentence: what Python calls has all its sections.
KERNELS = [path for path in FOLDER.rglob("*.py") if "ins.jit import" in path.read_text("utf-8")]
KERNELS.append(FOLDER / "strapdown/loop.py")
# Formulas of the list of errors share one signature, which `ins.errors.base.Effect` documents, and
# take one sentence each.
OF_ALL = {FOLDER / f"errors/{name}.py" for name in ("catalogue", "prior", "reference")}
FORMULAS = set((FOLDER / "errors").rglob("*.py")) - OF_ALL
MODULES = sorted(set(FOLDER.rglob("*.py")) - {*KERNELS, *FORMULAS})
CALLED_FROM_PYTHON = {
    "estimation/kernel.py": {"sweep", "respond", "smooth", "system", "transition"},
    "strapdown/body_forces.py": {"turned_forces"},
    "strapdown/loop.py": {"integrate"},
}
HAS_EXAMPLES = [path for path in MODULES if ">>> " in path.read_text("utf-8")]


def name_of(path: Path) -> str:
    return path.relative_to(FOLDER).as_posix()


def public(node: ast.Module | ast.ClassDef, prefix: str = "") -> Iterator[tuple[str, ast.AST]]:
    for inner in node.body:
        if isinstance(inner, ast.FunctionDef | ast.ClassDef) and not inner.name.startswith("_"):
            yield prefix + inner.name, inner
            if isinstance(inner, ast.ClassDef):
                yield from public(inner, f"{prefix}{inner.name}.")


def is_property(node: ast.FunctionDef) -> bool:
    return any(isinstance(d, ast.Name) and d.id == "property" for d in node.decorator_list)


def arguments(node: ast.FunctionDef) -> list[str]:
    of = node.args
    names = [a.arg for a in (*of.posonlyargs, *of.args, *of.kwonlyargs)]
    return [name for name in names if name not in ("self", "cls")]


def returns(node: ast.FunctionDef) -> bool:
    """Whether it gives something back: by its annotation, else by its statements."""
    if node.returns is not None:
        return not (isinstance(node.returns, ast.Constant) and node.returns.value is None)
    return any(isinstance(n, ast.Return) and n.value is not None for n in ast.walk(node))


def fields(node: ast.ClassDef) -> list[str]:
    """What a class is made with: the fields of a record, else the arguments of __init__."""
    for inner in node.body:
        if isinstance(inner, ast.FunctionDef) and inner.name == "__init__":
            return arguments(inner)
    if not (node.decorator_list or any(getattr(b, "id", "") == "NamedTuple" for b in node.bases)):
        return []
    return [i.target.id for i in node.body if isinstance(i, ast.AnnAssign)]


def section(docstring: str, title: str) -> str:
    head = f"{title}\n{'-' * len(title)}\n"
    if head not in docstring:
        return ""
    return docstring.split(head, 1)[1].split("\n\n", 1)[0]


def faults(name: str, node: ast.FunctionDef | ast.ClassDef) -> Iterator[str]:
    docstring = ast.get_docstring(node) or ""
    summary = docstring.split("\n", 1)[0]
    if not summary:
        yield f"{name}: no docstring"
        return
    if not summary.rstrip('"').endswith((".", ":")):
        yield f"{name}: the summary is no sentence of one line: {summary!r}"
    if isinstance(node, ast.FunctionDef) and is_property(node):
        return
    wanted = arguments(node) if isinstance(node, ast.FunctionDef) else fields(node)
    said = section(docstring, "Parameters") + section(docstring, "Attributes")
    missing = [a for a in wanted if not any(a in head for head in heads(said))]
    if missing:
        yield f"{name}: Parameters do not say {missing}"
    if isinstance(node, ast.FunctionDef) and returns(node) and not section(docstring, "Returns"):
        yield f"{name}: no Returns"


def heads(text: str) -> list[set[str]]:
    """The names before the colon of each entry of a section."""
    lines = [line for line in text.splitlines() if line and not line.startswith(" ")]
    return [set(line.split(" : ")[0].replace("*", "").split(", ")) for line in lines]


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_public_names_say_what_they_take_and_give(path):
    tree = ast.parse(path.read_text("utf-8"))
    assert ast.get_docstring(tree)
    assert [fault for name, node in public(tree) for fault in faults(name, node)] == []


@pytest.mark.parametrize("path", sorted(FORMULAS), ids=name_of)
def test_formulas_of_errors_say_what_they_add(path):
    """The reference prints their first sentence."""
    tree = ast.parse(path.read_text("utf-8"))
    assert ast.get_docstring(tree)
    of_run = [n for _, n in public(tree) if getattr(n, "args", None) and "run" in arguments(n)]
    assert [node.name for node in of_run if not ast.get_docstring(node)] == []


@pytest.mark.parametrize("path", KERNELS, ids=name_of)
def test_kernels_that_python_calls_say_what_they_take_and_give(path):
    tree = ast.parse(path.read_text("utf-8"))
    called = CALLED_FROM_PYTHON.get(name_of(path), set())
    assert called <= {name for name, _ in public(tree)}
    found = []
    for name, node in public(tree):
        if name in called:
            found += faults(name, node)
        elif not ast.get_docstring(node):
            found.append(f"{name}: no docstring")
    assert found == []


@pytest.mark.parametrize("path", HAS_EXAMPLES, ids=name_of)
def test_examples_run(path):
    module = importlib.import_module(f"ins.{name_of(path)[:-3].replace('/', '.')}")
    assert doctest.testmod(module).failed == 0


def test_a_docstring_that_leaves_something_out_is_found():
    """Test of the test."""
    text = 'def f(a, b):\n    """Sum.\n\n    Parameters\n    ----------\n    a : int\n    """\n'
    (node,) = ast.parse(text + "    return a + b\n").body
    assert list(faults("f", node)) == ["f: Parameters do not say ['b']", "f: no Returns"]
