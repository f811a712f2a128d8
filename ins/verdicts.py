"""Outcomes and reasons: what every estimator's result is made of.

An estimator says why in codes with values, never in words; `sentence` fills the template that the
code carries, where the reason is shown. A result is a frozen dataclass; `ins.documents` turns it
into JSON.

Decision: docs/decisions/0091-one-codec.md.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from string import Formatter
from typing import Any, Self

import numpy as np

from ins import units

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


_NUMBER = r"\d+(?:\.\d+)?"
# a value and its sigma in a sentence; one with an exponent stands as it is
_MEASURED = re.compile(
    rf"(?P<value>[-+]?{_NUMBER}(?:e[-+]\d+)?) \+- (?P<sigma>{_NUMBER})(?![\de.])"
)
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
    return _MEASURED.sub(_as_fine_as_sigma, _TEMPLATES.vformat(reason.code.whole, (), values))


def _as_fine_as_sigma(measured: re.Match[str]) -> str:
    """A value without the decimals that its sigma does not show."""
    value, sigma = measured["value"], measured["sigma"]
    decimals = len(sigma.partition(".")[2])
    if "e" in value or len(value.partition(".")[2]) <= decimals:
        return measured[0]
    rounded = f"{float(value):{'+' if value[0] == '+' else ''}.{decimals}f}"
    return f"{rounded} +- {sigma}"


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
        (``mrad .2f``; with a minus in front of the unit the other sign). Of flags and counts
        ``this|that``: the first where it holds, or is 1. Of several values what stands between two,
        and the format of each (``and |.0f``). abs, factor, plural, span: see `FORMS`.

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
FORMS: Mapping[str, Callable[..., float | str]] = {
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
