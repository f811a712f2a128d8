"""Outcomes, reasons and plain records: what every estimator's result is made of.

An estimator says why in codes with values, never in words; `sentence` fills the template that the
code carries, where the reason is shown. A result is a frozen dataclass; `plain` turns it into what
JSON holds.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, is_dataclass
from enum import Enum, StrEnum
from functools import lru_cache
from string import Formatter
from types import NoneType, UnionType
from typing import Any, Self, Union, get_args, get_origin, get_type_hints

import numpy as np

from ins import units

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


SIGMAS_APART = 2.0  # 95 % of normal errors lie within; U(k=2) of the reports is the same band
MEASURED, NOT_FROM_ZERO = "measured", "measured, not different from zero"


def differs(value: float, sigma: float) -> bool:
    """Whether a value is further from zero than chance takes it in 19 of 20 cases.

    Parameters
    ----------
    value, sigma : float
        In one unit.

    Returns
    -------
    differs : bool
    """
    return abs(value) >= SIGMAS_APART * sigma


def measured_words(verdict: str, value: float, sigma: float) -> str:
    """What is said of a measured value: `observed` alone would say that it is not zero.

    Parameters
    ----------
    verdict : Observability
    value, sigma : float
        In one unit.

    Returns
    -------
    words : str
    """
    if verdict == Observability.NOT_OBSERVABLE:
        return "not observable"
    said = MEASURED if differs(value, sigma) else NOT_FROM_ZERO
    return f"weakly {said}" if verdict == Observability.WEAK else said


class ReasonCode(StrEnum):
    """A reason: its code, the template of its sentence, and what is to be done about it.

    A package declares its reasons as members of subclasses, in its module `reasons`. The code is
    the member's value (formats.md). Both templates are filled by the reason's values, as
    `str.format` does and by the formats of `worded`.

    Parameters
    ----------
    code : str
        The member's value.
    template : str
        What was measured and what was needed.
    what_to_do : str
        Advice; it follows the template after a semicolon, or after the template's own colon,
        question mark or full stop.

    Examples
    --------
    >>> class Why(ReasonCode):
    ...     TOO_SHORT = "too_short", "{measured_s:.0f} s at rest", "park for {needed_s:min g} min"
    >>> sentence(because(Why.TOO_SHORT, measured_s=20.0, needed_s=300.0))
    '20 s at rest; park for 5 min'
    """

    template: str
    what_to_do: str

    def __new__(cls, code: str, template: str = "", what_to_do: str = "") -> Self:
        member = str.__new__(cls, code)
        member._value_ = code
        member.template = template
        member.what_to_do = what_to_do
        return member

    @property
    def whole(self) -> str:
        """Both templates as one."""
        if not self.what_to_do:
            return self.template
        joint = " " if self.template.endswith((":", "?", ".")) else "; "
        return f"{self.template}{joint}{self.what_to_do}"


@dataclass(frozen=True)
class Reason:
    """Why a verdict is what it is: a code, and what was measured and needed.

    Parameters
    ----------
    code : ReasonCode
        A member of an enum of reasons, which carries the template.
    values : Mapping[str, Any]
        What the template names, units in the keys (`measured_s`, `needed_s`).
    """

    code: ReasonCode
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


def because(code: ReasonCode, **values: Any) -> Reason:
    """The reason of a code with its values.

    Parameters
    ----------
    code : ReasonCode
        A member of an enum of reasons.
    **values
        What its template names, units in the keys.

    Returns
    -------
    reason : Reason

    Examples
    --------
    >>> class Why(ReasonCode):
    ...     TOO_SHORT = "too_short", "{measured_s:.0f} s at rest"
    >>> because(Why.TOO_SHORT, measured_s=20.0).values["measured_s"]
    20.0
    """
    return Reason(code, values)


def sentence(reason: Reason) -> str:
    """The reason in words.

    A reason among its values stands there as its own sentence, a code among them as its own
    templates, filled by the other values.

    Parameters
    ----------
    reason : Reason

    Returns
    -------
    words : str

    Raises
    ------
    KeyError
        A value that the template names and the reason lacks (a test goes over all codes).
    """
    values = dict(reason.values)
    for name, value in reason.values.items():
        if isinstance(value, ReasonCode):
            values[name] = _TEMPLATES.vformat(value.whole, (), reason.values)
    return _TEMPLATES.vformat(reason.code.whole, (), values)


def sentences(reasons: Iterable[Reason | str]) -> list[str]:
    """Reasons in words.

    Parameters
    ----------
    reasons : Iterable[Reason | str]
        A text stands as it is.

    Returns
    -------
    words : list of str
    """
    return [reason if isinstance(reason, str) else sentence(reason) for reason in reasons]


def codes(reasons: Iterable[Reason | str]) -> list[str | None]:
    """The codes of reasons: what programs compare instead of words.

    Parameters
    ----------
    reasons : Iterable[Reason | str]

    Returns
    -------
    codes : list of str or None
        Of each reason, with that of a reason among its values (not of several) after a dot; None
        for a text.
    """
    return [None if isinstance(reason, str) else _code(reason) for reason in reasons]


def _code(reason: Reason) -> str:
    inner = [_code(value) for value in reason.values.values() if isinstance(value, Reason)]
    return ".".join([reason.code.value, *inner])


def worded(value: Any, form: str) -> str:
    """A value by its format in a template.

    Parameters
    ----------
    value : object
        A number or a text; a `Reason`; a sequence or mapping of these; None.
    form : str
        Of numbers what `format` takes, after the unit that a number in SI is to be shown in
        ("mrad .2f"; with a minus in front of the unit the other sign). Of flags and counts
        "this|that": the first where it holds, or is 1. Of several values what stands between two,
        and the format of each ("and |.0f"). "abs", "factor", "plural", "span": see `FORMS`.

    Returns
    -------
    words : str
        9370 where format writes 9.37e+03.

    Examples
    --------
    >>> worded(0.00123, "mrad .2f"), worded(0.5, "-% .0f"), worded(3, "row|rows")
    ('1.23', '-50', 'rows')
    >>> worded((90.0, 270.0), ", |.0f"), worded({"x": 1.0}, ", |.1f")
    ('90, 270', 'x 1.0')
    """
    if value is None:
        return "none"
    if isinstance(value, Reason):
        return sentence(value)
    unit, _, rest = form.partition(" ")
    if unit in FORMS:
        return worded(FORMS[unit](value), rest)
    if isinstance(value, Mapping):
        pairs = [f"{key} {worded(item, form.partition('|')[2])}" for key, item in value.items()]
        return form.partition("|")[0].join(pairs)
    if isinstance(value, tuple | list):
        between, _, of_each = form.partition("|")
        return (between or "; ").join(worded(item, of_each) for item in value)
    if isinstance(value, int | np.integer | np.bool_) and "|" in form:
        this, _, that = form.partition("|")
        return this if value == 1 else that
    shown_in = unit.removeprefix("-")
    if unit and shown_in in UNIT_WORDS:
        sign = -1.0 if unit.startswith("-") else 1.0
        return worded(sign * value / UNIT_WORDS[shown_in], rest)
    return plain_number(value, form)


def plain_number(value: Any, form: str) -> str:
    """As format, but 9370 where that writes 9.37e+03.

    Parameters
    ----------
    value : object
    form : str
        What `format` takes.

    Returns
    -------
    words : str
        Numbers from `LARGEST_PLAIN` on keep their exponent.
    """
    text = format(value, form)
    if not isinstance(value, float) or "e+" not in text or abs(value) >= LARGEST_PLAIN:
        return text
    return f"{float(text):+.0f}" if form[0] == "+" else f"{float(text):.0f}"


def _factor(value: float) -> str:
    return f"{value:.2g}" if value < 10.0 else f"{value:.0f}"


def _plural(word: str) -> str:
    return f"{word[:-1]}ies" if word.endswith("y") else f"{word}s"


def _span(span_s: tuple[float, float]) -> str:
    start_s, end_s = span_s
    return f"{end_s - start_s:.0f} s, from {start_s:.0f} to {end_s:.0f} s"


LARGEST_PLAIN = 1e6  # chosen: people read 9370 deg/h, not 9.37e+03; larger ones with an exponent
# by the word in a template: a number in SI over it is shown
UNIT_WORDS: Mapping[str, float] = {
    "": 1.0,
    "%": 0.01,
    "arcsec": units.ARCSEC,
    "deg": units.DEG,
    "min": units.MINUTE,
    "mrad": units.MILLIRADIAN,
    "ms": units.MILLISECOND,
}
# what else a template does to a value, before the format that follows
FORMS: Mapping[str, Callable[[Any], Any]] = {
    "abs": abs,
    "factor": _factor,  # 2.5 times, 123 times
    "plural": _plural,  # of a word
    "span": _span,  # of (start, end) [s]
}


class _TemplateFormatter(Formatter):
    """As str.format, with the formats of `worded`."""

    def format_field(self, value: Any, format_spec: str) -> str:
        return worded(value, format_spec)


_TEMPLATES = _TemplateFormatter()


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
