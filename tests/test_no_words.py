"""Nothing in the product decides by the wording of a message or by a verdict written as text.

What is looked for, by syntax tree, in every module of the product:

1. The text of a message: `str(error)` of a name bound by `except`, `reason`, `reasons`, `note`,
   `notes`, `advice`, `why`, `sentence` as attribute or key, `fault.text`, `x.words()`; and a name
   that was assigned from one of them, or that runs over one of them, in the same function.
   It may not be compared (==, !=, in) with words, nor searched for words by a method of texts
   (startswith, find, partition, ...) or of `re`. Words are a literal with a letter in it: to trim
   white space or to take off a path in front is not to tell messages apart.
2. A verdict: `verdict`, `outcome`, `action`, `observability` as name, attribute or key may not be
   compared with a literal: the member of its enum stands there.
"""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("ins", "trajectories", "alignment", "infield", "simreal", "recal")
TEXTS = {"reason", "reasons", "note", "notes", "advice", "why", "sentence"}
LISTS = {"reasons", "notes"}
VERDICTS = {"verdict", "outcome", "action", "observability"}
SEARCHES = set(
    "startswith endswith find rfind index count partition rpartition removeprefix removesuffix"
    " split search match fullmatch findall".split()
)
EQUAL = (ast.Eq, ast.NotEq, ast.In, ast.NotIn)
# module: why it may
ALLOWED = {}


@cache
def modules():
    return [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


def name_of(node):
    """The last name of an attribute, the key of a subscript, a name; of a call of get, its key."""
    if isinstance(node, ast.Attribute):
        return node.attr
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
        key = node.slice.value
        return key if isinstance(key, str) else name_of(node.value)
    if isinstance(node, ast.Subscript):
        return name_of(node.value)
    if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "get" and node.args:
        return getattr(node.args[0], "value", None)
    return None


def has_words(node):
    """A literal with a letter in it, anywhere in the expression."""
    return any(
        isinstance(n, ast.Constant) and isinstance(n.value, str) and any(map(str.isalpha, n.value))
        for n in ast.walk(node)
    )


class Finder(ast.NodeVisitor):
    """Lines of a module that break a rule."""

    def __init__(self):
        self.errors, self.texts, self.found = set(), set(), []

    def visit_FunctionDef(self, node):
        held = set(self.texts)
        self.generic_visit(node)
        self.texts = held

    def visit_ExceptHandler(self, node):
        if node.name:
            self.errors.add(node.name)
        self.generic_visit(node)

    def visit_Assign(self, node):
        self.visit(node.value)
        if self.is_text(node.value):
            self.texts |= {t.id for t in node.targets if isinstance(t, ast.Name)}

    def visit_For(self, node):
        self._runs_over(node)
        self.generic_visit(node)

    def visit_comprehension(self, node):
        self._runs_over(node)
        self.generic_visit(node)

    visit_ListComp = visit_SetComp = visit_GeneratorExp = lambda self, node: self._in_order(node)

    def _in_order(self, node):
        for generator in node.generators:
            self.visit(generator)
        self.visit(node.elt)

    def _runs_over(self, node):
        if self.is_text(node.iter) and isinstance(node.target, ast.Name):
            self.texts.add(node.target.id)

    def is_text(self, node):
        if isinstance(node, ast.Call):
            called = node.func
            if isinstance(called, ast.Name) and called.id in ("str", "repr") and node.args:
                return name_of(node.args[0]) in self.errors or self.is_text(node.args[0])
            if isinstance(called, ast.Attribute):
                return called.attr == "words" or self.is_text(called.value)
            return False
        if isinstance(node, ast.IfExp):
            return self.is_text(node.body) or self.is_text(node.orelse)
        if isinstance(node, ast.Name):
            return node.id in self.texts or node.id in TEXTS
        if isinstance(node, ast.Attribute | ast.Subscript):
            name = name_of(node)
            return name in TEXTS or ast.unparse(node) == "fault.text" or name in self.texts
        return False

    def visit_Compare(self, node):
        sides = [node.left, *node.comparators]
        if any(isinstance(op, EQUAL) for op in node.ops):
            words = any(not self.is_text(side) and has_words(side) for side in sides)
            if words and any(self.is_text(side) for side in sides):
                self.found.append((node.lineno, "compares the text of a message"))
            elif any(map(self.is_searched, node.ops, node.comparators)):
                self.found.append((node.lineno, "searches the text of a message"))
            literal = any(is_literal(side) for side in sides)
            if literal and any(name_of(side) in VERDICTS for side in sides):
                self.found.append((node.lineno, "compares a verdict with a text"))
        self.generic_visit(node)

    def is_searched(self, op, node):
        """Whether `x in node` looks into one message; whether a list holds a line may be asked."""
        one = self.is_text(node) and name_of(node) not in LISTS
        return one and isinstance(op, ast.In | ast.NotIn)

    def visit_Call(self, node):
        called = node.func
        if isinstance(called, ast.Attribute) and called.attr in SEARCHES:
            inside = [called.value, *node.args]
            words = [a for a in inside if not self.is_text(a) and has_words(a)]
            if words and any(self.is_text(a) for a in inside):
                self.found.append((node.lineno, "searches the text of a message"))
            if name_of(called.value) in VERDICTS and any(map(has_words, node.args)):
                self.found.append((node.lineno, "searches a verdict"))
        self.generic_visit(node)


def is_literal(node):
    """A text, or several."""
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return any(is_literal(item) for item in node.elts)
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and has_words(node)


def faults_of(source):
    finder = Finder()
    finder.visit(ast.parse(source))
    return finder.found


def test_nothing_decides_by_words():
    found = [
        f"{path.relative_to(ROOT)}:{line} {what}"
        for path in modules()
        for line, what in faults_of(path.read_text(encoding="utf-8"))
        if str(path.relative_to(ROOT)) not in ALLOWED
    ]
    assert found == []


@pytest.mark.parametrize(
    "line",
    [
        'if str(error).startswith("store "): pass',
        'text = str(error)\n    if text.startswith(STORE + " x"): pass',
        'if "table disagrees" in x["reasons"][0]: pass',
        'any("same content" in r for r in result.reasons)',
        'if reasons[0].endswith("again") or x.reasons[0].endswith("again"): pass',
        'whole = "not known" in fault.text',
        'key = str(error).partition(" revision ")[2]',
        'if term.action == "rate term fitted": pass',
        'if document["verdict"] in ("committed", "proposed"): pass',
        'found = [v for v in x if v.verdict.startswith("separated")]',
        'import re; re.search("stuck", fault.text)',
        'kept = [n for n in notes if "left out" in n]',
        'why = next((n for n in log.notes if any(word in n for word in WORDS)), "")',
    ],
)
def test_the_old_faults_would_be_found(line):
    """Each is how the product once decided, or might."""
    source = f"try:\n    work()\nexcept ValueError as error:\n    {line}\n"
    assert faults_of(source), line


@pytest.mark.parametrize(
    "line",
    [
        'say(" ".join(str(error).split()))',
        'text = str(error).removeprefix(f"{path}: ")',
        "if verdict is Outcome.REFUSED: pass",
        'document["verdict"] == Outcome.REFUSED',
        "if x.reasons == (): pass",
    ],
)
def test_what_tells_nothing_apart_passes(line):
    source = f"try:\n    work()\nexcept ValueError as error:\n    {line}\n"
    assert faults_of(source) == [], line
