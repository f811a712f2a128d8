"""Is a session of the unit that its serial number names? Its marks against those of the sessions
that the unit's table holds.

What the history says of the unit is its weighted mean; a session of the same unit is off that by
the scatter of both. Where the history itself scatters by more than declared, by that.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.session.identity.marks import FORCE, UnitMarks
from infield.session.reasons import SessionReason
from infield.session.wrong_facts import ANOMALY_ug
from ins.robust import chi2
from ins.verdicts import Reason, because

# gravity anomalies repeat within so much of the Earth [rad]: 10 km; they change over 20 to 50 km
# (physics.md 8.4)
SAME_PLACE_rad = 10e3 / 6.37e6
# of its heating pattern, what a unit may still have as it is switched on again: from nothing to
# all, so that of either of two power-ons 0.4 and of their difference 0.8 is one sigma to spare
STILL_WARM = 0.8
# of a unit's own sessions, that may be beyond the limit: 1 in 200; another unit in its table costs
# more than a session that has to be flown again (99.9 % let 1 of 100 through, docs/reliability.md)
BELONGS = 0.995
MARK_UNITS = ("degC", "ug")  # the marks that share a scatter: by the unit at the end of their names


@dataclass(frozen=True)
class Likeness:
    """How far a session's marks are off the unit's history: chi2 over dof degrees of freedom, the
    limit, the number of sessions compared with, and the mark that is furthest off, in its
    own sigmas.
    """

    chi2: float
    dof: int
    limit: float
    sessions: int
    furthest: str
    off: float
    sigma: float

    @property
    def same(self) -> bool:
        return self.chi2 <= self.limit

    @property
    def reason(self) -> Reason:
        mark, unit = self.furthest.rsplit("_", 1)
        return because(
            SessionReason.UNLIKE_THE_UNIT,
            chi2=self.chi2,
            dof=self.dof,
            limit=self.limit,
            sessions=self.sessions,
            mark="specific force" if mark == "force" else mark,
            off=self.off,
            sigma=self.sigma,
            unit={"degC": "degC", "ug": "micro-g"}[unit],
        )


def likeness(marks: UnitMarks | None, known: Sequence[UnitMarks]) -> Likeness | None:
    """A session against the unit's history; None where there is nothing to compare."""
    if marks is None:
        return None
    shared = [name for name in marks.names if any(name in one.names for one in known)]
    names = _compared(tuple(shared))
    if not names:
        return None
    wider = _scatter(names, known)
    mean, P = _of_history(names, known, wider)
    now = marks.of(names)
    S = P + now.covariance * np.outer(wider, wider) + _warm(names, [*known, marks])
    if FORCE in names and not _same_place(marks, known):
        k = names.index(FORCE)
        S[k, k] += ANOMALY_ug**2
    off = now.value - mean
    if "degC" in {_kind(name) for name in names}:  # the weather's share is no degree of freedom
        readings = np.array([_kind(name) == "degC" for name in names])
        off = off - readings * off[readings].mean()
    squared = float(off @ np.linalg.solve(S, off))
    dof = len(names) - int(any(_kind(name) == "degC" for name in names))
    sigma = np.sqrt(np.maximum(np.diag(S) - _weather(names, S), 0.0))
    worst = int(np.argmax(np.abs(off) / np.maximum(sigma, 1e-12)))
    return Likeness(
        chi2=squared,
        dof=dof,
        limit=float(chi2.ppf(BELONGS, dof)),
        sessions=len(known),
        furthest=names[worst],
        off=float(off[worst]),
        sigma=float(sigma[worst]),
    )


def _kind(name: str) -> str:
    return name.rsplit("_", 1)[1]


def _compared(names: tuple[str, ...]) -> tuple[str, ...]:
    """The marks that say something: one thermometer alone tells the weather."""
    readings = [name for name in names if _kind(name) == "degC"]
    return names if len(readings) != 1 else tuple(n for n in names if n not in readings)


def _weather(names: tuple[str, ...], S: NDArray) -> NDArray:
    """What of each variance all thermometers share: the smallest covariance between two."""
    at = [k for k, name in enumerate(names) if _kind(name) == "degC"]
    shared = np.zeros(len(names))
    if at:
        shared[at] = S[np.ix_(at, at)].min()
    return shared


def _warm(names: tuple[str, ...], sessions: Sequence[UnitMarks]) -> NDArray:
    """Covariance (k, k) of what two power-ons of a unit may differ by where one was still warm, by
    the patterns of all its sessions.
    """
    patterns = []
    for one in sessions:
        heat = dict(zip(one.names, one.heat))
        patterns.append([heat.get(name, 0.0) for name in names])
    H = np.array(patterns)
    return np.asarray(STILL_WARM**2 * H.T @ H / len(sessions))


def _of_history(
    names: tuple[str, ...], known: Sequence[UnitMarks], wider: NDArray
) -> tuple[NDArray, NDArray]:
    """The unit's own marks: weighted mean (k,) and covariance (k, k) of all sessions."""
    information, vector = np.zeros((len(names),) * 2), np.zeros(len(names))
    for one in known:
        at = [k for k, name in enumerate(names) if name in one.names]
        if not at:
            continue
        part = one.of(tuple(names[k] for k in at))
        W = np.linalg.inv(part.covariance * np.outer(wider[at], wider[at]))
        information[np.ix_(at, at)] += W
        vector[at] += W @ part.value
    P = np.linalg.inv(information)
    return P @ vector, 0.5 * (P + P.T)


def _scatter(names: tuple[str, ...], known: Sequence[UnitMarks]) -> NDArray:
    """By how much (k,) the sessions of the history scatter more than declared, each kind by itself;
    1 where that may be chance.
    """
    wider = np.ones(len(names))
    for kind in MARK_UNITS:
        at = [k for k, name in enumerate(names) if _kind(name) == kind]
        of_kind = tuple(names[k] for k in at)
        told = [one for one in known if set(of_kind) <= set(one.names)]
        dof = (len(told) - 1) * (len(of_kind) - int(kind == "degC"))
        if dof < 1:
            continue
        mean, _ = _of_history(of_kind, told, np.ones(len(at)))
        warm = _warm(of_kind, told)
        squared = 0.0
        for one in told:
            part = one.of(of_kind)
            off = part.value - mean
            squared += float(off @ np.linalg.solve(part.covariance + warm, off))
        if squared > chi2.ppf(BELONGS, dof):
            wider[at] = np.sqrt(squared / dof)
    return wider


def _same_place(marks: UnitMarks, known: Sequence[UnitMarks]) -> bool:
    here = [
        np.hypot(one.lat_rad - marks.lat_rad, (one.lon_rad - marks.lon_rad) * np.cos(marks.lat_rad))
        for one in known
    ]
    return bool(max(here) < SAME_PLACE_rad)
