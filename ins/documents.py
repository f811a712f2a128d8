"""The one codec of results: a frozen dataclass is its own JSON document, a field a key.

`to_json` writes a record, `from_json` reads it through pydantic's TypeAdapter. The writer is a walk
over the fields: pydantic writes 1e-05 as 1e-5, and what is stored or hashed keeps its bytes.
A field may say beside its type what it is made of (`MadeOf`), and `made` fills the record.

Decision: docs/decisions/0091-one-codec.md.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, field, fields, is_dataclass, make_dataclass
from enum import Enum
from functools import lru_cache
from operator import attrgetter
from types import UnionType
from typing import (
    Annotated,
    Any,
    Generic,
    NamedTuple,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
    is_typeddict,
)

R = TypeVar("R")
S = TypeVar("S")
T = TypeVar("T")

# Metadata of a record's field: left out of the JSON where it is None; never in it (what a page is
# drawn from); the keys of its record in the place of its own, which `from_json` cannot read.
OMIT_NONE = {"omit_none": True}
UNWRITTEN = {"unwritten": True}
INLINE = {"inline": True}


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


def written(keys: str) -> Callable[[type[R]], type[R]]:
    """Decorator of a record whose keys in the JSON are these, in this order.

    Parameters
    ----------
    keys : str
        Names of fields and properties, blanks between them; "key=a.b" takes attribute b of a. What
        is not named is not written; `from_json` reads the fields among them.

    Returns
    -------
    decorator : callable
        Of the class; classes derived from it have their own fields as keys.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @written("axis half=half_deg_h")
    ... @dataclass(frozen=True)
    ... class Bias:
    ...     axis: str
    ...     bias_deg_h: float
    ...     @property
    ...     def half_deg_h(self) -> float:
    ...         return 0.5 * self.bias_deg_h
    >>> plain(Bias("x", 0.04))
    {'axis': 'x', 'half': 0.02}
    """

    def decorated(kind: type[R]) -> type[R]:
        KEYS_OF[kind] = tuple(keys.split())
        return kind

    return decorated


KEYS_OF: dict[type, tuple[str, ...]] = {}


class MadeOf(Generic[S]):
    """Declares fields of a document that are made of a record in other units, where they stand.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> class Gyro(NamedTuple):
    ...     axis: str
    ...     bias_rad_s: float
    >>> gyro = MadeOf[Gyro]()
    >>> @dataclass(frozen=True, kw_only=True)
    ... class Bias:
    ...     axis: str = gyro(lambda g: g.axis)
    ...     bias_deg_h: float = gyro(lambda g: g.bias_rad_s / 4.84813681109536e-06)
    ...     run_id: str
    >>> made(Bias, Gyro("x", 4.84813681109536e-08), run_id="monday")
    Bias(axis='x', bias_deg_h=0.01, run_id='monday')
    """

    def __call__(
        self,
        of: Callable[[S], T],
        metadata: Mapping[str, bool] | None = None,
        *,
        default: Any = MISSING,
    ) -> T:
        """A field of a dataclass.

        Parameters
        ----------
        of : callable
            What the field holds, of the record.
        metadata : Mapping, optional
            As `OMIT_NONE`.
        default : object, optional
            Of a file that lacks the key.

        Returns
        -------
        field : T
            `dataclasses.field`, for mypy the value itself.
        """
        return cast(T, field(default=default, metadata={**(metadata or {}), MADE_OF: of}))


MADE_OF = "made_of"


def made(kind: type[R], of: Any, **values: Any) -> R:
    """A document of a record.

    Parameters
    ----------
    kind : type
        A dataclass with fields of `MadeOf`.
    of : object
        What they are made of.
    **values
        The other fields; of the same name as one that is made, in its place.

    Returns
    -------
    document : kind
    """
    parts = [f for f in fields(cast(Any, kind)) if MADE_OF in f.metadata and f.name not in values]
    return kind(**{f.name: f.metadata[MADE_OF](of) for f in parts}, **values)


class Null(Enum):
    """A value that stands in the file as null, where None means that its key is left out."""

    NULL = None

    def __bool__(self) -> bool:
        return False


def to_json(record: Any, *, indent: int | None = 1) -> str:
    """The text of a result, as files and standard output have it.

    Parameters
    ----------
    record : object
        A dataclass, or what is made of them (`plain`).
    indent : int or None
        Of nested values; None: all in one line, without blanks.

    Returns
    -------
    text : str
        With a line feed at the end; numbers that are not finite are null.
    """
    between = (",", ":") if indent is None else None
    values = _written(record, _number_or_null)
    return json.dumps(values, indent=indent, separators=between, allow_nan=False) + "\n"


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
    >>> from dataclasses import dataclass, field
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
    >>> from dataclasses import dataclass
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
    for column in written_of(record.__class__):
        item = attrgetter(column.path)(record)
        if item is None and (column.omit_none or column.inline):
            continue
        if column.inline:
            found |= _record(item, number)
        else:
            found[column.key] = _written(item, number)
    return found


class WrittenKey(NamedTuple):
    """A key of a record, as it is written.

    Parameters
    ----------
    key : str
        As it stands in JSON.
    path : str
        The attribute that it holds ("a.b": b of a).
    omit_none : bool
        Whether it is left out where there is no value.
    inline : bool
        Whether the keys of its record stand among those of this one.
    """

    key: str
    path: str
    omit_none: bool = False
    inline: bool = False


@lru_cache(maxsize=512)
def written_of(kind: type) -> tuple[WrittenKey, ...]:
    """What is written of a record.

    Parameters
    ----------
    kind : type
        A dataclass.

    Returns
    -------
    keys : tuple of WrittenKey
        In their order.
    """
    of_fields = {f.name: _of_field(f) for f in _fields(kind)}
    found = []
    for item in KEYS_OF.get(kind, of_fields):
        key, _, path = item.partition("=")
        plain_key = WrittenKey(key, path or key)
        found.append(plain_key if path else of_fields.get(key, plain_key))
    return tuple(found)


def _of_field(f: Field) -> WrittenKey:
    said = f.metadata
    omitted, inline = bool(said.get("omit_none")), bool(said.get("inline"))
    return WrittenKey(said.get("alias", f.name), f.name, omitted, inline)


@lru_cache(maxsize=512)
def _fields(kind: Any) -> tuple[Field, ...]:
    """The fields of a record that are written where no keys are named."""
    return tuple(f for f in fields(kind) if not f.metadata.get("unwritten"))


def _number(value: float) -> float:
    return float(value)  # a float of numpy's is one too


def _number_or_null(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


@lru_cache(maxsize=64)
def _reader(kind: Any) -> Any:
    """pydantic's validator of a record."""
    from pydantic import TypeAdapter

    return TypeAdapter(_as_read(kind))


def _as_read(kind: Any) -> Any:
    """The type of what JSON holds of a type: a number may be null, since one that is not finite
    was written so; a list becomes a tuple, since records are frozen; a TypedDict has a reader of
    its own.
    """
    if kind is float:
        return float | None
    if is_typeddict(kind):
        return Any
    if isinstance(kind, type) and is_dataclass(kind):
        return _keys_of(kind)
    parts, origin = get_args(kind), get_origin(kind)
    if not parts or origin is Annotated:
        return kind
    read = tuple(part if part is Ellipsis else _as_read(part) for part in parts)
    if origin in (Union, UnionType):
        return _first_of(read)
    if origin is Sequence:
        return tuple[read[0], ...]  # type: ignore[valid-type]
    return (dict if origin is Mapping else origin)[read]


def _first_of(kinds: tuple[Any, ...]) -> Any:
    """The first kind that holds the value, and None where that is one of them; beside `Null` a
    null is that, and None is left to keys that are missing.
    """
    from pydantic import AfterValidator, Field

    if Null in kinds:
        known = _first_of(tuple(kind for kind in kinds if kind is not Null))
        return Annotated[known, AfterValidator(lambda read: Null.NULL if read is None else read)]
    several: Any = tuple(kind for kind in kinds if kind is not type(None))
    first: Any = Union[several]  # noqa: UP007
    if len(several) > 1:
        first = Annotated[first, Field(union_mode="left_to_right")]
    return Union[first, None] if type(None) in kinds else first  # noqa: UP007


@lru_cache(maxsize=512)
def _keys_of(kind: Any) -> Any:
    """A record of the same fields as JSON holds them, which becomes the record once it is read."""
    from pydantic import AfterValidator

    hints = get_type_hints(kind, include_extras=True)
    found = make_dataclass(
        kind.__name__,
        [
            (
                f.name,
                _as_read(hints[f.name]),
                field(default=f.default, default_factory=f.default_factory, metadata=f.metadata),
            )
            for f in _fields(kind)
        ],
        kw_only=True,
    )
    return Annotated[found, AfterValidator(lambda read: kind(**vars(read)))]
