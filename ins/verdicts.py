"""Outcomes, reasons and plain records: what every estimator's result is made of.

An estimator says why in codes with values, never in words; the sentence of a reason is made where
it is shown, from its code (`infield.reports.words.sentences`). A result is a frozen dataclass;
`plain` turns it into what JSON holds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, is_dataclass
from enum import Enum, StrEnum
from functools import lru_cache
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

# Metadata of a record's field: left out of the JSON where it is None; never in it (what a page is
# drawn from); under another key, where the key is no name in Python.
OMIT_NONE = {"omit_none": True}
UNWRITTEN = {"unwritten": True}
INLINE = {"inline": True}  # a record whose keys stand among those of the record that holds it
AS_READ = (float, int, str, bool)  # kinds whose values JSON holds as they are


class Null(Enum):
    """A value that stands in the file as null, where None means that its key is left out."""

    NULL = None

    def __bool__(self) -> bool:
        return False


def written_as(key: str) -> dict[str, str]:
    """Metadata of a field whose key in the JSON is not its name.

    Parameters
    ----------
    key : str
        Its key.

    Returns
    -------
    metadata : dict of str
        For `dataclasses.field(metadata=...)`.
    """
    return {"key": key}


OBSERVED_BELOW, WEAK_BELOW = 0.5, 0.9  # sigma after over before; formats.md, section 5


class Outcome(StrEnum):
    """The verdict on an update, or on one session of it (formats.md, section 5)."""

    ACCEPTED = "accepted"
    COMMITTED = "committed"
    PROPOSED = "proposed"
    REFUSED = "refused"
    INCONSISTENT = "inconsistent"


class Observability(StrEnum):
    """What a measurement says of a quantity: sigma after over before (formats.md, section 5)."""

    OBSERVED = "observed"
    WEAK = "weak"
    NOT_OBSERVABLE = "not_observable"

    @classmethod
    def of(cls, ratio: float) -> "Observability":
        """The verdict on a ratio of sigmas.

        Parameters
        ----------
        ratio : float
            Sigma after the measurement over sigma before.

        Returns
        -------
        verdict : Observability

        Examples
        --------
        >>> Observability.of(0.49).value, Observability.of(0.95).value
        ('observed', 'not_observable')
        """
        if ratio < OBSERVED_BELOW:
            return cls.OBSERVED
        return cls.WEAK if ratio < WEAK_BELOW else cls.NOT_OBSERVABLE


@dataclass(frozen=True)
class Reason:
    """Why a verdict is what it is: a code, and what was measured and needed.

    Parameters
    ----------
    code : StrEnum
        A member of an enum of reasons; its sentence stands in `infield.reports.words`.
    values : Mapping[str, Any]
        What the sentence names, units in the keys (`measured_s`, `needed_s`).
    """

    code: StrEnum
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """A stretch of time that an estimator did not use, and why.

    Parameters
    ----------
    start_s, end_s : float
        Seconds from the run's start.
    reason : Reason
    """

    start_s: float
    end_s: float
    reason: Reason


def because(code: StrEnum, **values: Any) -> Reason:
    """The reason of a code with its values.

    Parameters
    ----------
    code : StrEnum
        A member of an enum of reasons.
    **values
        What its sentence names, units in the keys.

    Returns
    -------
    reason : Reason

    Examples
    --------
    >>> class Why(StrEnum):
    ...     TOO_SHORT = "too_short"
    >>> because(Why.TOO_SHORT, measured_s=20.0).values["measured_s"]
    20.0
    """
    return Reason(code, values)


def plain(value: Any) -> Any:
    """A record as JSON holds it.

    Parameters
    ----------
    value : object
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
    >>> @dataclass(frozen=True)
    ... class Point:
    ...     axis: str
    ...     time_s: float
    ...     phase: str | None = field(default=None, metadata=OMIT_NONE)
    >>> plain(Point("x", 900.0))
    {'axis': 'x', 'time_s': 900.0}
    """
    if is_dataclass(value) and not isinstance(value, type):
        return _plain_record(value)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(plain(key)): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def _plain_record(record: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for f in fields(record):
        item = getattr(record, f.name)
        left_out = f.metadata.get("unwritten") or (item is None and f.metadata.get("omit_none"))
        if f.metadata.get("inline"):
            found |= {} if item is None else plain(item)
        elif not left_out:
            found[_key(f)] = plain(item)
    return found


def record_of(kind: Any, value: Any) -> Any:
    """What `plain` made of a record of this kind, as that record again.

    Parameters
    ----------
    kind : type
        A dataclass whose fields are records, enums, plain values, tuples or sequences of one kind,
        mappings from text, or one of several of these: then the first that holds the value.
    value : Any
        From JSON. A key that no field has is passed over.

    Returns
    -------
    record : kind

    Raises
    ------
    TypeError, ValueError, AttributeError
        Where a key without default is missing, an enum has no such member, or a value is no object.

    Examples
    --------
    >>> @dataclass(frozen=True)
    ... class Point:
    ...     axis: str
    ...     span_s: tuple[float, ...]
    >>> record_of(Point, {"axis": "x", "span_s": [0.0, 900.0]})
    Point(axis='x', span_s=(0.0, 900.0))
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return _one_of(arguments, value)
    if value is None:
        return None
    if origin in (tuple, Sequence):
        of = arguments[0]
        return tuple(value) if of in AS_READ else tuple(record_of(of, item) for item in value)
    if origin is Mapping:
        return {key: record_of(arguments[1], item) for key, item in value.items()}
    if is_dataclass(kind) and isinstance(kind, type):
        kinds = _kinds(kind)
        known = [f for f in fields(kind) if _key(f) in value]
        return kind(**{f.name: record_of(kinds[f.name], value[_key(f)]) for f in known})
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind(value)
    return value


def _one_of(kinds: Sequence[Any], value: Any) -> Any:
    """The value as the first of some kinds that holds it; the last one says what is wrong."""
    if value is None:
        return Null.NULL if Null in kinds else None
    held = [kind for kind in kinds if kind not in (Null, NoneType)]
    for kind in held[:-1]:
        try:
            return record_of(kind, value)
        except (TypeError, ValueError, AttributeError):
            continue
    return record_of(held[-1], value)


@lru_cache(maxsize=256)
def _kinds(kind: Any) -> Mapping[str, Any]:
    """The kinds of a record's fields, looked up once."""
    return get_type_hints(kind)


def _key(f: Field) -> str:
    return str(f.metadata.get("key", f.name))
