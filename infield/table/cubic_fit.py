"""The thermal table of one unit as one cubic a gyro, which is all that small autopilots can hold,
and what that costs::

    bias(T) = c0 + c1 x + c2 x^2 + c3 x^3 [deg/h], x = T - reference

Fitted by generalised least squares with the table's own covariance P over its valid range, on a
grid of temperatures with rows H of the table: S = H P H' + D. D is MISFIT of each variance as
independent errors of the cubic: a table that is smooth by its prior has nearly no variance in its
rough directions, and without D the fit would follow those alone.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from infield.table.least_squares import fit_correlated
from infield.table.thermal_table import ThermalTable
from ins.documents import UNWRITTEN
from ins.records import AXES, InputError

GRID = 121  # temperatures that fit and error are taken at
MISFIT = 0.1  # of each variance, taken as independent errors of the cubic
# the valid range: where an axis is known at most this many times worse than where it is known
# best; chosen: it has 1/9 of the weight there
KNOWN = 3.0
LEAST_DEG_H = 1e-3  # of sigma: below it no autopilot's gyro shows a difference
# chosen: half of what ArduPilot's own calibration asks for (TEMP_RANGE_MIN, 10 degC)
SHORTEST_DEGC = 5.0
FORCED = "WRITTEN ALTHOUGH TOO STIFF"  # before a fit's words in a file that was forced
# of the largest term at the end of the range: a smaller one is none; the autopilots' float32
# keeps 6e-8
NO_TERM = 1e-12
_NUMBER = r"\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_TELLS = re.compile(r"gyro [xyz]: (?:cubic less table|the cubic is the table)")
_FIT = re.compile(
    rf"gyro (?P<axis>[xyz]): cubic less table at most (?P<error>{_NUMBER}) deg/h.*table sigma of"
    rf" (?P<sigma>{_NUMBER}) deg/h"
)
_EXACT = re.compile(
    rf"gyro (?P<axis>[xyz]): the cubic is the table .*table sigma (?P<sigma>{_NUMBER}) deg/h"
)


@dataclass(frozen=True, kw_only=True)
class CubicFit:
    """One gyro: coefficients (4,) [deg/h per degC^k], constant first, and the fit against the table
    over the range.

    Errors are cubic less table; `worst_sigmas`: the largest of them in the table's own sigma there.
    rms_sigma: of the table.
    """

    axis: str = field(metadata=UNWRITTEN)
    reference_degC: float = field(metadata=UNWRITTEN)
    coefficients: NDArray = field(metadata=UNWRITTEN)
    max_error_deg_h: float
    max_error_degC: float
    rms_error_deg_h: float
    rms_sigma_deg_h: float
    worst_sigmas: float
    worst_degC: float

    def value_deg_h(self, temperature_degC: NDArray) -> NDArray:
        return np.polynomial.polynomial.polyval(
            temperature_degC - self.reference_degC, self.coefficients
        )

    def words(self) -> str:
        if self.max_error_deg_h < 1e-6:
            return (
                f"gyro {self.axis}: the cubic is the table to 1e-6 deg/h; table sigma"
                f" {self.rms_sigma_deg_h:.3g} deg/h RMS"
            )
        return (
            f"gyro {self.axis}: cubic less table at most {self.max_error_deg_h:.3g} deg/h (at"
            f" {self.max_error_degC:.1f} degC), RMS {self.rms_error_deg_h:.3g}, against a table"
            f" sigma of {self.rms_sigma_deg_h:.3g} deg/h RMS; at worst {self.worst_sigmas:.2g}"
            f" sigma (at {self.worst_degC:.1f} degC)"
        )


def stated_fit(comments: Iterable[tuple[int, str]], *, file: str) -> tuple[NDArray, NDArray]:
    """Largest error and table sigma (3,) [deg/h] that `words` told in a file's comments (line
    number, text), 0 where none.

    InputError where a comment tells of a fit, but not its numbers.
    """
    error_deg_h, sigma_deg_h = np.zeros((2, len(AXES)))
    for number, text in comments:
        if not (FORCED in text or _TELLS.search(text)):
            continue
        told = _FIT.search(text) or _EXACT.search(text)
        if told is None:
            needed = (
                'needed "gyro x: cubic less table at most E deg/h ..., against a table sigma of S'
                ' deg/h RMS"'
            )
            raise InputError(
                f"{file}: line {number}: the fit error cannot be read: got {text[:60]!r}, {needed}"
            )
        found, axis = told.groupdict(), AXES.index(told["axis"])
        error_deg_h[axis] = max(error_deg_h[axis], float(found.get("error") or 0.0))
        sigma_deg_h[axis] = max(sigma_deg_h[axis], float(found["sigma"]))
    return error_deg_h, sigma_deg_h


def shared_nodes(table: ThermalTable) -> tuple[float, float]:
    """Lowest and highest temperature that all three axes have nodes for."""
    low = max(float(nodes[0]) for nodes in table.temperature_degC)
    return low, min(float(nodes[-1]) for nodes in table.temperature_degC)


def valid_range(table: ThermalTable) -> tuple[float, float]:
    """Where every axis is known, its level and its slope within KNOWN times their best sigma
    [degC]; about the best place.

    A table's outer nodes may be mere belief; an autopilot holds the end value beyond its range, as
    a table does. The level alone would not tell: all of it may be as uncertain as one turn-on,
    while its shape was measured over a warm-up only.
    """
    low, high = shared_nodes(table)
    if high <= low:
        raise InputError(
            f"table: the nodes of x, y and z share no temperature ({low:g} to {high:g} degC)"
        )
    T = np.linspace(low, high, 4 * GRID)
    middle = 0.5 * (T[1:] + T[:-1])
    worse = np.max(
        [
            [
                _ratio(table, table.basis(axis, middle)),
                _ratio(table, np.diff(table.basis(axis, T), axis=0)),
            ]
            for axis in AXES
        ],
        axis=(0, 1),
    )
    best, good = int(np.argmin(worse)), np.append(worse <= KNOWN, False)
    if not good[best]:
        raise InputError(
            "table: no temperature at which all gyros are known well, needed a range (--range LOW"
            " HIGH)"
        )
    return float(T[best - int(np.argmin(np.append(good[best::-1], False))) + 1]), float(
        T[best + int(np.argmin(good[best:]))]
    )


def _ratio(table: ThermalTable, rows: NDArray) -> NDArray:
    """Sigma of what some rows give over nearly the smallest of them (a slope across one node is the
    mean of two).
    """
    sigma = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", rows, table.covariance, rows), 0.0))
    return np.asarray(sigma / np.maximum(np.quantile(sigma, 0.02), LEAST_DEG_H))


def fit_cubics(
    table: ThermalTable,
    *,
    low_degC: float,
    high_degC: float,
    reference_degC: float,
    constant: bool = True,
) -> tuple[CubicFit, CubicFit, CubicFit]:
    """One cubic for each of x, y, z over low to high.

    constant False: the autopilot takes the constant itself at each start, so error and sigma are
    those of the shape, less their mean over the range; the coefficients hold the constant all the
    same.
    """
    if high_degC - low_degC < SHORTEST_DEGC:
        raise InputError(
            f"range {low_degC:g} to {high_degC:g} degC, needed at least {SHORTEST_DEGC:g} degC for"
            " a cubic"
        )
    for axis, nodes in zip(AXES, table.temperature_degC):
        if low_degC < nodes[0] or high_degC > nodes[-1]:
            held = f"gyro {axis} has nodes over {nodes[0]:g} to {nodes[-1]:g} degC"
            raise InputError(
                f"range {low_degC:g} to {high_degC:g} degC is beyond the table: {held}"
            )
    T = np.linspace(low_degC, high_degC, GRID)
    x, y, z = (_fit(table, axis, T, reference_degC, constant) for axis in AXES)
    return x, y, z


def _fit(
    table: ThermalTable, axis: str, T: NDArray, reference_degC: float, constant: bool
) -> CubicFit:
    rows = table.basis(axis, T)
    bias, P = rows @ table.parameters, rows @ table.covariance @ rows.T
    span = max(abs(T[0] - reference_degC), abs(T[-1] - reference_degC))
    A = np.vander((T - reference_degC) / span, 4, increasing=True)
    S = P + np.diag(MISFIT * np.diag(P) + LEAST_DEG_H**2)
    scaled = fit_correlated(A, bias, S).x
    scaled = np.where(np.abs(scaled) > NO_TERM * np.abs(scaled).max(), scaled, 0.0)
    error = A @ scaled - bias
    if not constant:
        level = np.eye(T.size) - 1.0 / T.size
        error, P = level @ error, level @ P @ level
    sigma = np.sqrt(np.maximum(np.diag(P), 0.0))
    ratio = np.abs(error) / np.maximum(sigma, LEAST_DEG_H)
    largest, worst = int(np.argmax(np.abs(error))), int(np.argmax(ratio))
    return CubicFit(
        axis=axis,
        reference_degC=reference_degC,
        coefficients=scaled / span ** np.arange(4),
        max_error_deg_h=float(abs(error[largest])),
        max_error_degC=float(T[largest]),
        rms_error_deg_h=float(np.sqrt(np.mean(error**2))),
        rms_sigma_deg_h=float(np.sqrt(np.mean(sigma**2))),
        worst_sigmas=float(ratio[worst]),
        worst_degC=float(T[worst]),
    )
