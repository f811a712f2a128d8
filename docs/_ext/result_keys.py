"""The keys of every result document, read from the dict literals of the functions that make
them.
"""

import ast
from dataclasses import dataclass
from pathlib import Path

from api_pages import parsed

SCHEMA_KEY = "schema"
DEEPEST = 4


@dataclass(frozen=True)
class Document:
    """One result: its schema, the function that makes it, its keys as an indented tree."""

    schema: str
    function: str
    doc: str
    tree: str


def documents(sources: dict[str, Path]) -> list[Document]:
    """Every document with a schema of its own that the functions of these modules return, by
    schema.
    """
    found: dict[str, Document] = {}
    for module, path in sources.items():
        reader = _Reader(parsed(path))
        for name, function in reader.functions.items():
            keys = reader.returned(function)
            schema = keys.get(SCHEMA_KEY)
            if isinstance(schema, str) and schema.startswith("recal."):
                made = Document(
                    schema, f"{module}.{name}", ast.get_docstring(function) or "", _text(keys)
                )
                before = found.get(schema)
                if before is None or len(before.tree) < len(made.tree):
                    found[schema] = made
    return [found[key] for key in sorted(found)]


Keys = dict[str, "Keys | str | None"]


class _Reader:
    """Resolves dict literals, calls of functions of the same module, comprehensions and conditional
    values.
    """

    def __init__(self, tree: ast.Module) -> None:
        self.functions = {n.name: n for n in tree.body if isinstance(n, ast.FunctionDef)}
        self.texts = {
            n.targets[0].id: n.value.value
            for n in tree.body
            if isinstance(n, ast.Assign)
            and isinstance(n.targets[0], ast.Name)
            and isinstance(n.value, ast.Constant)
        }

    def returned(self, function: ast.FunctionDef, depth: int = 0) -> Keys:
        """What a function returns; a name stands for the last dict assigned to it."""
        named = {
            n.targets[0].id: n.value
            for n in ast.walk(function)
            if isinstance(n, ast.Assign) and isinstance(n.targets[0], ast.Name)
        }
        keys: Keys = {}
        for node in ast.walk(function):
            if isinstance(node, ast.Return) and node.value is not None:
                value = (
                    named.get(node.value.id, node.value)
                    if isinstance(node.value, ast.Name)
                    else node.value
                )
                keys |= self.keys(value, depth)
        return keys

    def keys(self, node: ast.expr, depth: int) -> Keys:
        """The keys of an expression that is a dict, or a list of dicts; none where it is something
        else.
        """
        if depth > DEEPEST:
            return {}
        if isinstance(node, ast.Dict):
            return self._dict(node, depth)
        if isinstance(node, ast.IfExp):
            return self.keys(node.body, depth) | self.keys(node.orelse, depth)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr):
            return self.keys(node.left, depth) | self.keys(node.right, depth)
        if isinstance(node, ast.ListComp | ast.DictComp):
            return self._each(node, depth)
        if isinstance(node, ast.List):
            return self.keys(node.elts[0], depth) if node.elts else {}
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id in self.functions
        ):
            return self.returned(self.functions[node.func.id], depth + 1)
        return {}

    def _each(self, node: ast.ListComp | ast.DictComp, depth: int) -> Keys:
        """Of a comprehension's elements; a plain name stands for what it runs over."""
        element = node.elt if isinstance(node, ast.ListComp) else node.value
        if isinstance(element, ast.Name):
            over = [
                g.iter
                for g in node.generators
                if isinstance(g.target, ast.Name) and g.target.id == element.id
            ]
            element = over[0] if over else element
        return self.keys(element, depth)

    def _dict(self, node: ast.Dict, depth: int) -> Keys:
        keys: Keys = {}
        for key, value in zip(node.keys, node.values):
            if key is None:
                keys |= self.keys(value, depth + 1)
            elif isinstance(key, ast.Constant) and isinstance(key.value, str):
                inner = self.keys(value, depth + 1)
                many = isinstance(value, ast.List | ast.ListComp) and bool(inner)
                keys[key.value + ("[]" if many else "")] = inner or self._text(value)
        return keys

    def _text(self, value: ast.expr) -> str | None:
        if isinstance(value, ast.Constant) and isinstance(value.value, str):
            return value.value
        return self.texts.get(value.id) if isinstance(value, ast.Name) else None


def _text(keys: Keys, indent: str = "") -> str:
    lines = []
    for key, inner in keys.items():
        lines.append(
            f"{indent}{key}"
            + (f'  "{inner}"' if key == SCHEMA_KEY and isinstance(inner, str) else "")
        )
        if isinstance(inner, dict):
            lines.append(_text(inner, indent + "  "))
    return "\n".join(lines)
