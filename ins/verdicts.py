"""Outcomes and reasons: what every estimator's result is made of.

An estimator says why in codes with values, never in words; the sentence of a reason is made where
it is shown, from its code (`infield.reports.words.sentences`). A result is a frozen dataclass;
`ins.documents` turns it into JSON.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

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
