"""The keys of every result document: of a typed record its fields, of a plain dict the literals of
the functions that make it.
"""

import ast
import collections.abc
import importlib
import inspect
import re
import typing
from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from api_pages import parsed
from key_units import unit_of

from ins.documents import written_of

SCHEMA_KEY = "schema"
WORDS = ""  # the key under which a record's own words stand
UNKNOWN = "?"
MAPPINGS = (dict, collections.abc.Mapping)
KINDS = {bool: "true or false", str: "text"}
OBJECT = "object"  # a table or a noise model, as the page of files has it
DEEPEST = 4


@dataclass(frozen=True)
class Document:
    """One result: its schema, the function that makes it, its keys as an indented tree; `typed`:
    read from a record, which holds all of them.
    """

    schema: str
    function: str
    tree: str
    typed: bool = False


def documents(sources: dict[str, Path]) -> list[Document]:
    """Every document with a schema of its own that the functions of these modules return, by
    schema.
    """
    found: dict[str, Document] = {}
    for module, path in sources.items():
        if SCHEMA_KEY not in path.read_text("utf-8"):
            continue
        found |= {made.schema: made for made in _typed(module, parsed(path))}
        reader = _Reader(parsed(path))
        for name, function in reader.functions.items():
            keys = reader.returned(function)
            schema = keys.get(SCHEMA_KEY)
            if isinstance(schema, str) and schema.startswith("recal."):
                made = Document(schema, f"{module}.{name}", _text(keys))
                before = found.get(schema)
                if before is None or (not before.typed and len(before.tree) < len(made.tree)):
                    found[schema] = made
    return [found[key] for key in sorted(found)]


def _typed(module: str, tree: ast.Module) -> Iterator[Document]:
    """Documents that are frozen records: with a schema of their own, or given one where they are
    made.
    """
    for record, function in _records_made(tree):
        imported = importlib.import_module(module)
        kind = getattr(imported, record, None)
        schema = getattr(kind, SCHEMA_KEY, getattr(imported, "SCHEMA", None))
        if is_dataclass(kind) and isinstance(schema, str) and schema.startswith("recal."):
            keys = _fields(typing.cast(type, kind)) | {SCHEMA_KEY: schema}
            yield Document(schema, f"{module}.{function}", _text(keys), typed=True)


def _records_made(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Names of the records with a schema, and the function that makes each."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and SCHEMA_KEY in _annotated(node):
            yield node.name, _maker(tree, node.name)
        if not isinstance(node, ast.FunctionDef):
            continue
        for call in ast.walk(node):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name):
                if SCHEMA_KEY in [k.arg for k in call.keywords]:
                    made = call.args[0] if call.func.id == "made" else call.func
                    yield getattr(made, "id", ""), node.name


def _annotated(node: ast.ClassDef) -> list[str]:
    """Names of the fields of a class."""
    found = [n.target for n in node.body if isinstance(n, ast.AnnAssign)]
    return [target.id for target in found if isinstance(target, ast.Name)]


def _maker(tree: ast.Module, record: str) -> str:
    """The function that returns the record; the record itself where none here does."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and isinstance(node.returns, ast.Name):
            if node.returns.id == record:
                return node.name
    return record


def _fields(kind: type) -> "Keys":
    """Fields of a record that are written, with those of the records in them."""
    keys: Keys = {WORDS: _first_sentence(kind)}
    for key, path, *_ in written_of(kind):
        hint = _hint_of(kind, path)
        inner, many = _record_in(hint)
        listed = key + ("[]" if many else "")
        keys[listed] = measure_of(key, hint) if inner is None else _fields(inner)
    return keys


def _hint_of(kind: type, path: str) -> Any:
    """The type of an attribute of a record, or of an attribute of that."""
    hint: Any = kind
    for name in path.split("."):
        owner = _record_in(hint)[0] or hint
        hints = typing.get_type_hints(owner)
        if name not in hints:
            made = inspect.getattr_static(owner, name)
            hints = typing.get_type_hints(getattr(made, "fget", None) or made.func)
        hint = hints.get(name, hints.get("return"))
    return hint


def measure_of(key: str, hint: Any) -> str:
    """The unit of a key, or what it holds where it is no number; UNKNOWN where nobody says."""
    kinds = _kinds(hint)
    if not kinds & {float, int}:
        known = [word for kind, word in KINDS.items() if kind in kinds]
        return known[0] if known else OBJECT
    unit = unit_of(key)
    if unit is None:
        return "count" if float not in kinds else UNKNOWN
    return unit


def _kinds(hint: Any) -> set[Any]:
    """The types that an annotation names, inside out."""
    inner = typing.get_args(hint)
    if typing.get_origin(hint) is np.ndarray:
        return {float}
    if not inner:
        return {str} if isinstance(hint, type) and issubclass(hint, Enum) else {hint}
    found: set[Any] = set()
    for part in inner[1:] if typing.get_origin(hint) in MAPPINGS else inner:
        found |= _kinds(part)
    return found


def _first_sentence(kind: type) -> str:
    """What a record is, in the first sentence of its docstring; empty where it has none."""
    text = " ".join((kind.__doc__ or "").split())
    if text.startswith(f"{kind.__name__}("):  # what dataclasses write where there is none
        return ""
    return re.split(r"(?<=[.;]) ", text)[0].rstrip(".;")


def _record_in(hint: Any) -> tuple[type | None, bool]:
    """The record of an annotation, and whether it is a list of them."""
    if isinstance(hint, type) and is_dataclass(hint):
        return hint, False
    origin = typing.get_origin(hint)
    for inner in typing.get_args(hint):
        found, many = _record_in(inner)
        if found is not None:
            listed = isinstance(origin, type) and not issubclass(origin, typing.Mapping)
            return found, many or (listed and issubclass(origin, typing.Sequence))
    return None, False


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
        if key == WORDS:
            continue
        lines.append(f"{indent}{key}" + _said(key, inner))
        if isinstance(inner, dict):
            lines.append(_text(inner, indent + "  "))
    return "\n".join(lines)


def _said(key: str, inner: "Keys | str | None") -> str:
    """What stands behind a key: its schema, or its unit."""
    if isinstance(inner, dict) and inner.get(WORDS):
        return f"  # {inner[WORDS]}"
    if not isinstance(inner, str):
        return ""
    return f'  "{inner}"' if key == SCHEMA_KEY else f"  [{inner}]"
