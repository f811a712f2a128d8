"""The terms of the ring-laser gradient model, their Gram matrices over blocks, and which of them
the data hold apart::

    b = K1 + K2 T + K3 T^2 + K4 dT/dt + K5 T dT/dt + sum_i K6i Tdiff_i        [deg/h]

(US 8,781,778, claim 1.) T is centred: T = temperature - reference; dT/dt in degC/min. What of the
bias follows temperature but no parabola is a rest of straight pieces between nodes, each N(0, s^2):
without it a wave of the curve passes for a gradient where heater and ramp keep step (squared
normalised error of K6 1.5 on average, up to 5 sigma). Source of the form: physics.md section 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from infield.table.least_squares import NormalEquations, scaled
from infield.thermal.reasons import ThermalNote
from ins.documents import UNWRITTEN, written_as
from ins.verdicts import Reason, because, sentence

LINE_TERMS = ("K6x", "K6y", "K6z")
TERMS = ("K1", "K2", "K3", "K4", "K5", *LINE_TERMS)
TERM_UNITS = {
    "K1": "deg/h",
    "K2": "deg/h per degC",
    "K3": "deg/h per degC^2",
    "K4": "deg/h per degC/min",
    "K5": "deg/h per degC and degC/min",
    **dict.fromkeys(LINE_TERMS, "deg/h per degC"),
}
NEEDS = {"K3": "K2", "K5": "K4"}  # a term that is not there without another
# condition index from which on a dependency is strong (Belsley, Kuh, Welsch (1980), section 3.2)
COLLINEAR = 30.0
INVOLVED = 0.3  # of a column of length 1: what another must carry of it to be named
REST_degC = 10.0
# s over the twin's turn-on: what is tried; no curve is a parabola to less than that
REST_OF_TURN_ON = (1.0, 2.0, 4.0)
# share of what a column has of its own that may be noise of the thermometers; noise in a column
# takes as much off its coefficient, here 5 %
NOISY_SHARE = 0.05


def solve_terms(
    normal: NormalEquations, use: NDArray, rest_deg_h: float = 0.0
) -> tuple[NDArray, NDArray]:
    """Coefficients (p,), 0 for terms not used, and their covariance (p, p); rest_deg_h: s of the
    nodes, 0: none.
    """
    count = normal.b.size
    prior = np.zeros(count)
    prior[len(TERMS) :] = rest_deg_h**-2.0 if rest_deg_h else 0.0
    at = np.flatnonzero(np.r_[use, np.full(count - len(TERMS), rest_deg_h > 0)])
    found = normal.of(at).solve(np.diag(prior[at]))
    theta, P = np.zeros(count), np.zeros((count, count))
    theta[at] = found.x
    P[np.ix_(at, at)] = found.covariance
    return theta, P


@dataclass(frozen=True, kw_only=True)
class Collinear:
    """A term that was dropped: with which others it goes, the condition number with it, the share
    of its own that is noise, and why.
    """

    term: str
    others: tuple[str, ...] = field(metadata=written_as("with"))
    condition: float
    noise_share: float
    why: Reason = field(metadata=UNWRITTEN)
    text: str
    code: str


def columns(
    T: NDArray,
    rate: NDArray,
    gradient: NDArray,
    reference_degC: float,
    nodes_degC: NDArray | None = None,
) -> NDArray:
    """Columns (n, 8) of TERMS from one gyro's temperature and rate (n,) and the lines (n, 3); then
    of the rest's nodes.
    """
    t = T - reference_degC
    terms = [np.ones_like(t), t, t**2, rate, t * rate, gradient]
    return np.column_stack(terms if nodes_degC is None else [*terms, rest_columns(T, nodes_degC)])


def rest_nodes(low_degC: float, high_degC: float) -> NDArray:
    """Nodes of the rest over a range, as far apart as those of a thermal table."""
    return REST_degC * np.arange(np.floor(low_degC / REST_degC), np.ceil(high_degC / REST_degC) + 1)


def rest_columns(T: NDArray, nodes_degC: NDArray) -> NDArray:
    """Weights (n, m) of the nodes at temperatures (n,), straight between them, the ends held
    beyond.
    """
    return np.stack([np.interp(T, nodes_degC, unit) for unit in np.eye(nodes_degC.size)], axis=1)


def term_sets(allowed: Sequence[str]) -> list[NDArray]:
    """Every set of terms with K1 whose members' needs are met, as masks (p,); the smallest
    first.
    """
    free = [name for name in TERMS[1:] if name in allowed]
    found = []
    for chosen in product((False, True), repeat=len(free)):
        names = {"K1", *(n for n, yes in zip(free, chosen) if yes)}
        if all(NEEDS.get(n, "K1") in names for n in names):
            found.append(np.array([t in names for t in TERMS]))
    return sorted(found, key=lambda use: int(use.sum()))


def hold_apart(
    A: NDArray, noise: NDArray, allowed: Sequence[str], own: str
) -> tuple[list[str], list[Collinear]]:
    """Terms that the data hold apart, and those dropped: each joins, the most wanted first, if it
    is none of those before it.

    noise (p,): what errors of the readings alone make of the diagonal of A. own: the gyro's own
    line, wanted before others.
    """
    wanted = ["K2", "K4", "K3", "K5", own, *(line for line in LINE_TERMS if line != own)]
    kept, dropped = ["K1"], []
    for name in wanted:
        if name not in allowed or NEEDS.get(name, "K1") not in kept:
            continue
        found = _collinear(A, noise, [*kept, name])
        dropped += [found] if found else []
        kept += [] if found else [name]
    return [name for name in TERMS if name in kept], dropped


def _collinear(A: NDArray, noise: NDArray, names: list[str]) -> Collinear | None:
    """What is against the last of some terms, None where it stands apart from the others."""
    at = [TERMS.index(name) for name in names]
    unit, length = scaled(A[np.ix_(at, at)])
    values = np.linalg.eigvalsh(unit)
    condition = float(np.sqrt(values[-1] / max(values[0], 1e-30)))
    on_others = np.linalg.lstsq(unit[:-1, :-1], unit[:-1, -1])[0]
    own = max(1.0 - float(unit[:-1, -1] @ on_others), 1e-30)  # of its length 1
    of_noise = float(np.r_[on_others, 1.0] ** 2 @ (noise[at] / length**2)) / own
    if condition <= COLLINEAR and of_noise <= NOISY_SHARE:
        return None
    others = tuple(n for n, c in zip(names, on_others) if abs(c) > INVOLVED)
    told = {"term": names[-1], "others": others or ("the rest",)}
    if condition > COLLINEAR:
        why = because(ThermalNote.COLLINEAR, **told, condition=condition, limit=COLLINEAR)
    else:
        why = because(ThermalNote.OF_NOISE, **told, noise_share=of_noise, limit=NOISY_SHARE)
    return Collinear(
        term=names[-1],
        others=others,
        condition=condition,
        noise_share=of_noise,
        why=why,
        text=sentence(why),
        code=why.code.value,
    )
