"""Piecewise polynomial models of K_T(T) and K_delta(T): few continuous segments, breakpoints at
inflections of the curves.

An inflection is where the second derivative of the smooth curve changes sign, significantly so on
both sides; its interval is every temperature around it at which the second derivative may be zero
(Fieller's set, 95 %). Knots, their number and the degree are chosen by BIC with the sigma of the
blocks known; where the inflections do not suffice, segments are halved and the added breakpoints
are marked so. Breakpoints that are found freely (`thermal.fog.knees`) stand against these: where a
curve has knees, it bends there and not at its inflections. Each breakpoint has the interval of its
posterior. Sources: CN 106017511 (segments at inflections), Schwarz (1978).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from infield.thermal.coefficient_curves import (
    Basis,
    CurveFit,
    Reduced,
    derivative_rows,
    smooth_basis,
    spline_basis,
)
from infield.thermal.fog.knees import Known, find_knees, intervals, places_of
from ins.documents import UNWRITTEN

STEP_degC = 0.25
# sigmas: of an interval's end, and of the sign of the second derivative on either side of an
# inflection; 95 %
SURE = 1.96
DEGREES = (1, 2, 3)
MOST_ADDED = 4
# no two breakpoints closer than this, nor to an end; chosen: above the grid of the curves
# (GRID_degC of fog.ramps, 2.5), so that a piece holds more than one step of it
NEAREST_degC = 4.0


@dataclass(frozen=True)
class Breakpoint:
    """Where two segments meet, with its 95 % interval; kind: inflection, knee (found freely), or
    added (a halved segment). called_for: the data tell the place from others; where they do not, a
    breakpoint somewhere in the interval serves as well.
    """

    temperature_degC: float
    low_degC: float = field(metadata=UNWRITTEN)
    high_degC: float = field(metadata=UNWRITTEN)
    interval_95_degC: tuple[float, float] = field(init=False)
    called_for: bool = field(default=True, kw_only=True)
    sigma_degC: float = field(init=False)
    kind: str = field(kw_only=True)

    def __post_init__(self) -> None:
        sigma = (self.high_degC - self.low_degC) / (2.0 * SURE)
        object.__setattr__(self, "interval_95_degC", (self.low_degC, self.high_degC))
        object.__setattr__(self, "sigma_degC", sigma)


@dataclass(frozen=True)
class Piecewise:
    """One curve: edges (m + 1,) with the breakpoints inside, coefficients (m, degree + 1) in (T -
    edge_j)^k, rising k.

    Beyond the edges the end value is held.
    """

    degree: int = field(init=False)
    edges_degC: NDArray
    coefficients: NDArray
    breakpoints: tuple[Breakpoint, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "degree", self.coefficients.shape[1] - 1)

    def __call__(self, temperature_degC: NDArray) -> NDArray:
        T = np.clip(temperature_degC, self.edges_degC[0], self.edges_degC[-1])
        j = np.clip(
            np.searchsorted(self.edges_degC, T, side="right") - 1, 0, len(self.coefficients) - 1
        )
        u, value = T - self.edges_degC[j], np.zeros(np.shape(T))
        for k in range(self.degree, -1, -1):
            value = value * u + self.coefficients[j, k]
        return value


@dataclass(frozen=True)
class PiecewisePair:
    """Both curves fitted together; inflections found, whether or not a breakpoint stands there; BIC
    and chi2 per degree.
    """

    K_T: Piecewise
    K_delta: Piecewise
    inflections: tuple[tuple[Breakpoint, ...], tuple[Breakpoint, ...]]
    bic: float
    scatter: float


def inflections(
    fit: CurveFit, which: int, low_degC: float, high_degC: float
) -> tuple[Breakpoint, ...]:
    """Inflections of a smooth curve, in order of temperature."""
    T = np.arange(low_degC, high_degC + 0.5 * STEP_degC, STEP_degC)
    value, P = fit.linear(which, derivative_rows(fit.bases[which], T, 2))
    z = value / np.sqrt(np.maximum(np.diag(P), 1e-300))
    sure = np.flatnonzero(np.abs(z) > SURE)
    found = []
    for a, b in pairwise(sure):  # the last sure row of one sign, the first of the other
        if z[a] * z[b] < 0:
            crossings = a + np.flatnonzero(np.diff(np.sign(value[a : b + 1])) != 0)
            middle = crossings[len(crossings) // 2]
            share = value[middle] / (value[middle] - value[middle + 1])
            found.append(
                Breakpoint(
                    float(T[middle] + share * STEP_degC),
                    float(T[a]),
                    float(T[b]),
                    kind="inflection",
                )
            )
    return tuple(found)


def piecewise_pair(reduced: Reduced, degrees: Sequence[int] = DEGREES) -> PiecewisePair:
    """The pair of least BIC: K_T first with K_delta smooth, then K_delta, then both together."""
    T = reduced.blocks.temperature_degC
    low, high = float(T.min()), float(T.max())
    basis, penalty = smooth_basis(low, high, order=3)
    smooth = reduced.fit([basis, basis], [penalty, penalty])
    bends = tuple(inflections(smooth, which, low, high) for which in range(2))
    chosen: list[tuple[tuple[Breakpoint, ...], int]] = []
    for which in range(2):
        other: list[Basis] = [basis, basis]
        if which == 1:
            other[0] = _basis(low, high, *chosen[0])
        chosen.append(_choose(reduced, other, which, bends[which], low, high, degrees))
    bases = [_basis(low, high, *choice) for choice in chosen]
    fit = reduced.fit(bases)
    pieces = [_polynomials(fit, which, low, high, *chosen[which]) for which in range(2)]
    return PiecewisePair(
        pieces[0], pieces[1], (bends[0], bends[1]), _bic(fit), fit.chi2 / max(fit.dof, 1.0)
    )


def _choose(
    reduced: Reduced,
    bases: list[Basis],
    which: int,
    bends: tuple[Breakpoint, ...],
    low: float,
    high: float,
    degrees: Sequence[int],
) -> tuple[tuple[Breakpoint, ...], int]:
    """Breakpoints and degree of one curve by BIC: the surest inflections first, then halves of the
    longest segment.
    """
    sure = sorted(bends, key=lambda bend: bend.sigma_degC)
    ladder: list[tuple[Breakpoint, ...]] = [()]
    for bend in sure:
        if _apart(ladder[-1], bend.temperature_degC, low, high):
            ladder.append((*ladder[-1], bend))
    for _ in range(MOST_ADDED):
        edges = [low, *sorted(b.temperature_degC for b in ladder[-1]), high]
        widest = int(np.argmax(np.diff(edges)))
        middle = 0.5 * (edges[widest] + edges[widest + 1])
        if not _apart(ladder[-1], middle, low, high):
            break
        ladder.append((*ladder[-1], Breakpoint(middle, middle, middle, kind="added")))
    tried: list[tuple[float, int, tuple[Breakpoint, ...], int]] = []
    for knots, degree in product(ladder, degrees):
        trial = list(bases)
        trial[which] = _basis(low, high, knots, degree)
        tried.append((_bic(reduced.fit(trial)), len(tried), knots, degree))
    places = {
        degree: places_of(reduced, bases[1 - which], which, degree, NEAREST_degC)
        for degree in degrees
    }
    for degree, of_degree in places.items():
        at = find_knees(of_degree)
        found = tuple(
            Breakpoint(value, value, value, kind="knee")
            for value in of_degree.grid_degC[list(at)].tolist()
        )
        tried.append((of_degree.bic(at), len(tried), found, degree))
    _, _, knots, degree = min(tried)
    knots = tuple(sorted(knots, key=lambda b: b.temperature_degC))
    known = intervals(places[degree], [b.temperature_degC for b in knots])
    return tuple(_with_interval(b, k) for b, k in zip(knots, known)), degree


def _with_interval(knot: Breakpoint, known: Known) -> Breakpoint:
    """A breakpoint with what is known of its place, its own place always within."""
    at = knot.temperature_degC
    low, high = min(known.low_degC, at), max(known.high_degC, at)
    if knot.kind == "inflection":  # of the curve's own bend, whatever the pieces say
        low, high = min(low, knot.low_degC), max(high, knot.high_degC)
    return replace(knot, low_degC=low, high_degC=high, called_for=known.called_for)


def _apart(knots: Sequence[Breakpoint], at: float, low: float, high: float) -> bool:
    return all(
        abs(at - other) >= NEAREST_degC
        for other in (low, high, *(b.temperature_degC for b in knots))
    )


def _basis(low: float, high: float, knots: Sequence[Breakpoint], degree: int) -> Basis:
    edges = np.array([low, *sorted(b.temperature_degC for b in knots), high])
    return spline_basis(edges, degree=degree, multiplicity=degree)


def _bic(fit: CurveFit) -> float:
    return fit.chi2 + len(fit.theta) * float(np.log(fit.rows))


def _polynomials(
    fit: CurveFit, which: int, low: float, high: float, knots: tuple[Breakpoint, ...], degree: int
) -> Piecewise:
    """Local powers of each segment from degree + 1 of its values."""
    edges = np.array([low, *(b.temperature_degC for b in knots), high])
    theta, rows = fit.theta[fit.part(which)], []
    for a, b in pairwise(edges):
        u = np.linspace(0.0, 1.0, degree + 1)
        value = fit.bases[which](a + u * (b - a)) @ theta
        powers = np.linalg.solve(np.vander(u, degree + 1, increasing=True), value)
        rows.append(powers / (b - a) ** np.arange(degree + 1))
    return Piecewise(edges, np.array(rows), knots)
