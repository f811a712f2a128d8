"""The one codec of results: a frozen dataclass is its own JSON document, a field a key.

`to_json` writes a record, `from_json` reads it through pydantic's TypeAdapter. The writer is a walk
over the fields: pydantic writes 1e-05 as 1e-5, and what is stored or hashed keeps its bytes.

Decision: docs/decisions/0091-one-codec.md.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, fields, is_dataclass
from enum import Enum
from functools import lru_cache
from typing import Any, TypeVar, cast

R = TypeVar("R")

# Metadata of a record's field: left out of the JSON where it is None; never in it (what a page is
# drawn from); the keys of its record in the place of its own, which `from_json` cannot read.
OMIT_NONE = {"omit_none": True}
UNWRITTEN = {"unwritten": True}
INLINE = {"inline": True}
NO_SCHEMA = ("default", "metadata", "serialization")  # of a schema's keys
TRIED = "str"  # place of a kind that was tried, which `ins.json_file` leaves out of the key


def written_as(key: str) -> dict[str, str]:
    """Metadata of a field whose key in the JSON is no name in Python.

    Parameters
    ----------
    key : str
        Its key.

    Returns
    -------
    metadata : dict of str
        For `dataclasses.field(metadata=...)`; pydantic reads it too.
    """
    return {"alias": key}


class Null(Enum):
    """A value that stands in the file as null, where None means that its key is left out."""

    NULL = None

    def __bool__(self) -> bool:
        return False


@dataclass(frozen=True)
class AsRead:
    """Mark of a type in `Annotated`: `from_json` takes the value as JSON holds it.

    For a part with a reader of its own, such as a table within a report.
    """

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.any_schema()


@dataclass(frozen=True)
class NullStands:
    """Mark of a field in `Annotated`: `from_json` reads a null in the file as `Null.NULL`.

    The field's type is a record, `Null` or None.
    """

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return handler(source)["schema"]  # what None was an alternative to


def to_json(record: Any) -> str:
    """The text of a result, as files and standard output have it.

    Parameters
    ----------
    record : object
        A dataclass, or what is made of them (`plain`).

    Returns
    -------
    text : str
        Indented by 1, with a line feed at the end; numbers that are not finite are null.
    """
    return json.dumps(_written(record, _number_or_null), indent=1, allow_nan=False) + "\n"


def plain(record: Any) -> Any:
    """A record as dicts, lists, texts and numbers; those that are not finite stay what they are.

    Parameters
    ----------
    record : object
        Dataclasses, enums, arrays, tuples, dicts and what JSON knows itself.

    Returns
    -------
    value : object
        Dataclasses as dicts in the order of their fields, enums as their values, arrays and tuples
        as lists. A field with metadata `OMIT_NONE` is left out where it is None, one with
        `UNWRITTEN` always; `INLINE` puts the keys of its record in its place, and `written_as`
        gives it another key.

    Examples
    --------
    >>> from dataclasses import field
    >>> @dataclass(frozen=True)
    ... class Point:
    ...     axis: str
    ...     time_s: float
    ...     phase: str | None = field(default=None, metadata=OMIT_NONE)
    >>> plain(Point("x", 900.0))
    {'axis': 'x', 'time_s': 900.0}
    """
    return _written(record, _number)


def from_json(kind: type[R], document: str | Mapping[str, Any], *, name: str) -> R:
    """What `to_json` made of a record of this kind, as that record again.

    Parameters
    ----------
    kind : type
        A dataclass. Of a field that may be one of several kinds, the first that holds the value.
    document : str or Mapping
        The text, or what JSON makes of it. A key that no field has is passed over.
    name : str
        Where it comes from; the error line begins with it.

    Returns
    -------
    record : kind
        A null in the place of a number is None.

    Raises
    ------
    InputError
        Names the key, what it holds and what was needed.

    Examples
    --------
    >>> @dataclass(frozen=True)
    ... class Point:
    ...     axis: str
    ...     span_s: tuple[float, ...]
    >>> from_json(Point, '{"axis": "x", "span_s": [0.0, 900.0]}', name="point.json")
    Point(axis='x', span_s=(0.0, 900.0))
    """
    from pydantic import ValidationError

    from ins.json_file import complaints
    from ins.records import InputError

    try:
        data = json.loads(document) if isinstance(document, str) else document
    except ValueError as error:
        raise InputError(f"{name}: not valid JSON ({error})") from None
    try:
        return cast(R, _reader(cast(Any, kind)).validate_python(data))
    except ValidationError as error:
        raise InputError(complaints(error, kind, name=name)[0]) from None


def _written(value: Any, number: Callable[[float], Any]) -> Any:
    """The value as JSON holds it; number: what becomes of a float."""
    if isinstance(value, Enum):
        return value.value
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return number(value)
    if isinstance(value, list | tuple):
        return [_written(item, number) for item in value]
    if isinstance(value, Mapping):
        return {str(_written(key, _number)): _written(item, number) for key, item in value.items()}
    if is_dataclass(value):
        return _record(value, number)
    if hasattr(value, "tolist"):  # of numpy, which is not loaded for this
        return _written(value.tolist(), number)
    return value


def _record(record: Any, number: Callable[[float], Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for f in _fields(record.__class__):
        item = getattr(record, f.name)
        if item is None and (f.metadata.get("omit_none") or f.metadata.get("inline")):
            continue
        if f.metadata.get("inline"):
            found |= _record(item, number)
        else:
            found[f.metadata.get("alias", f.name)] = _written(item, number)
    return found


@lru_cache(maxsize=512)
def _fields(kind: Any) -> tuple[Field, ...]:
    """The fields of a record that are written."""
    return tuple(f for f in fields(kind) if not f.metadata.get("unwritten"))


def _number(value: float) -> float:
    return float(value)  # a float of numpy's is one too


def _number_or_null(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


@lru_cache(maxsize=64)
def _reader(kind: Any) -> Any:
    """pydantic's validator of a record."""
    from pydantic import TypeAdapter
    from pydantic_core import SchemaValidator

    return SchemaValidator(_as_written(TypeAdapter(kind).core_schema))


def _as_written(schema: Any) -> Any:
    """A schema of pydantic's with what it has no option for: a number may be null, since one that
    is not finite was written so; of several kinds the first that holds the value counts; a
    sequence is a tuple, since records are frozen.
    """
    if isinstance(schema, list | tuple):
        return type(schema)(_as_written(part) for part in schema)
    if not isinstance(schema, dict):
        return schema
    changed = {key: _as_written(part) for key, part in schema.items() if key not in NO_SCHEMA}
    changed |= {key: schema[key] for key in schema.keys() & {"default"}}
    if "json_schema" in changed and changed["json_schema"].get("type") == "list":
        items = [changed["json_schema"].get("items_schema", {"type": "any"})]
        return {"type": "tuple", "items_schema": items, "variadic_item_index": 0}
    if schema.get("type") == "union":
        choices = [(choice, TRIED) for choice in changed["choices"]]
        return {**changed, "choices": choices, "mode": "left_to_right"}
    if schema.get("type") == "float":
        return {"type": "nullable", "schema": changed}
    return changed
